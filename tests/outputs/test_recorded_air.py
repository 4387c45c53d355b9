"""Air in a run's recording and in its CSV file: there, and carried on by a run that is resumed."""

import csv
from pathlib import Path

import numpy as np
import pytest
from tiny_run import make_run

from taichisoft import Control, Simulation, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.csv_output import CsvOutput
from taichisoft_outputs.plots import PANELS, expected
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import recorded_scene, resumed_simulation, state_at

LINE = (
    "{supply = 60.0, conductance = 0.02, tube_length = 200.0, tube_diameter = 2.0, delay = 0.03, response_time = 0.02}"
)
AIR = [
    f'soft_bodies.left.cavities.cavity={{group = "cavity", air = "line", line = {LINE}}}',
    'soft_bodies.right.cavities.cavity={group = "cavity"}',
]
STEPS = 14
ATMOSPHERE = 101.325


def control(step: int) -> Control:
    return Control(pressure={"right.cavity": 1.0 * step}, valve={"left.cavity": 1.0 - 0.1 * step})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Outputs of a run with one finger on a line and one with regulated air."""
    folder = tmp_path_factory.mktemp("run")
    simulation = Simulation(load_scene(TINY_GRIPPER, AIR))
    make_run(simulation, [RecordingOutput(folder), CsvOutput(folder)], map(control, range(STEPS)))
    return folder


def recording(folder: Path) -> Recording:
    return read_recording(folder / "recording.h5")


@pytest.mark.parametrize("frame", [0, 7, STEPS])
def test_a_resumed_run_has_the_air(folder: Path, frame: int) -> None:
    """A run that goes on from any frame ends in the state of the one that was recorded, to the bit."""
    with recording(folder) as opened:
        simulation = resumed_simulation(opened, frame, recorded_scene(opened, (), None))
        assert simulation.state == state_at(opened, frame)
        for step in range(frame, STEPS):
            simulation.step(control(step))
        assert simulation.state == state_at(opened, STEPS)


def test_a_finger_can_be_shut_where_a_run_is_resumed(folder: Path) -> None:
    """What a regulator let in is what is shut in: pressure and shape go on from where they were."""
    with recording(folder) as opened:
        scene = recorded_scene(opened, ['soft_bodies.right.cavities.cavity.air="sealed"'], None)
        simulation = resumed_simulation(opened, STEPS, scene)
        before = simulation.state
        simulation.step()
        assert simulation.state.air_mass[1] == before.air_mass[1] > simulation.model.initial_state().air_mass[1]
        after = simulation.state
        work = (before.actuator_effort[1] + ATMOSPHERE) * before.actuator_value[1]
        assert after.actuator_effort[1] < before.actuator_effort[1]  # the walls still move outwards
        assert (after.actuator_effort[1] + ATMOSPHERE) * after.actuator_value[1] == pytest.approx(work, rel=1e-3)


def test_columns_and_panels(folder: Path) -> None:
    with recording(folder) as opened, (folder / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
        for name, unit in (("air_mass", "kg"), ("air_flow", "kg/s"), ("valve", "1")):
            column = opened.column(name)
            assert column.shape == (STEPS + 1, 2) and expected(name, opened)
            for place, cavity in enumerate(opened.cavities):
                written = [float(row[f"{name} {cavity} [{unit}]"]) for row in rows]
                assert written == pytest.approx(column[1:, place], rel=1e-6)
        flow, mass = opened.column("air_flow"), opened.column("air_mass")
        assert (flow[4:10] > 0.0).all() and not opened.column("valve")[:4].any()
        assert np.diff(mass, axis=0) == pytest.approx(0.01 * flow[1:], rel=1e-9, abs=1e-18)
        assert {"air_mass", "air_flow", "valve"} <= PANELS.keys()
