"""What changes in a run is in its recording and carried on by a run that is resumed: frames, air, moduli, signals."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import fake_run
import numpy as np
import pytest
import pyvista
from tiny_run import make_run, tiny_run

from taichisoft import Control, Simulation, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_from_dict
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.csv_output import CsvOutput
from taichisoft_outputs.drawing.colouring import contact_pressure, stress
from taichisoft_outputs.paraview import export_vtu
from taichisoft_outputs.plots import PANELS, PlotError, RunCurves, draw_plots, expected
from taichisoft_outputs.recording.layout import SIGNAL_COUNT
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import ResumeError, recorded_scene, resumed_simulation, state_at
from taichisoft_outputs.report import collect, report_page
from taichisoft_outputs.stress import StressLaw, nodal_mean, von_mises

# Frames beside the base.


FRAME_STEPS = 25
SCENE = {
    "frames": {
        "jaw": {"follows": "base", "speed": 30.0},
        "lid": {"follows": "jaw", "hinge": {"axis": [0.0, 1.0, 0.0]}, "turning_speed": 90.0},
        "belt": {"path": {"times": [0.05, 0.2], "translations": [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]}},
    },
    "rigid_bodies": {
        "belt": {"box": [80.0, 80.0, 10.0], "position": [0.0, 0.0, -5.0], "follows": "belt"},
        "mark": {"box": [4.0, 4.0, 4.0], "position": [0.0, 0.0, 50.0], "follows": "lid"},
        "cube": {"box": [20.0, 20.0, 20.0], "mass": 0.05, "position": [0.0, 0.0, 11.0]},
    },
}


def frame_control(step: int) -> Control:
    motion = {"frame_translation": {"jaw": np.array([0.0, 9.0, 0.0])}} if step == 3 else {}
    return Control(base_velocity=np.array([0.0, 0.0, 1.0]), frame_angle={"lid": 0.1 * step}, **motion)  # type: ignore[arg-type]


def test_frames_are_recorded_and_go_on_from_every_frame(tmp_path: Path) -> None:
    simulation = Simulation(scene_from_dict(SCENE))
    states = make_run(
        simulation, [RecordingOutput(tmp_path, every=4), CsvOutput(tmp_path)], map(frame_control, range(FRAME_STEPS))
    )
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    seen = simulation.observe()
    assert float(last["frame_translation jaw y [mm]"]) == pytest.approx(30.0 * 0.01 * (FRAME_STEPS - 3))
    assert float(last["frame_rotation lid y [degrees]"]) == pytest.approx(np.degrees(seen.frame_angles["lid"]))
    assert float(last["frame_force belt z [mN]"]) == pytest.approx(-0.05 * 9810.0, rel=1e-3)
    assert last["clipped"] == "jaw_translation|lid_rotation"
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.frames.names == ("base", "jaw", "belt", "lid")
        assert recording.row("frame_pose", -1).tolist() == states[-1].frame_pose.tolist()
        panel = PANELS["frame-force"](RunCurves(recording))
        belt = next(curve for curve in panel.curves if curve.label == "belt")
        assert belt.y[-1] == pytest.approx(0.05 * 9810.0, rel=1e-3)
        frame = recording.instant_at(0.08)
        assert not recording.has_state(frame)
        assert state_at(recording, frame) == states[8]
        resumed = resumed_simulation(recording, frame, recorded_scene(recording, (), None))
        for step in range(8, FRAME_STEPS):
            resumed.step(frame_control(step))
        assert resumed.state == states[-1]
        fewer = recorded_scene(recording, ['rigid_bodies.mark.follows="jaw"', "frames.lid.pivot=[1.0,0.0,0.0]"], None)
        with pytest.raises(ResumeError, match="'lid' is not as it was recorded: its pivots differ by up to 1 mm"):
            resumed_simulation(recording, frame, fewer)


# Air.


LINE = (
    "{supply = 60.0, conductance = 0.02, tube_length = 200.0, tube_diameter = 2.0, delay = 0.03, response_time = 0.02}"
)
AIR = [
    f'soft_bodies.left.cavities.cavity={{group = "cavity", air = "line", line = {LINE}}}',
    'soft_bodies.right.cavities.cavity={group = "cavity"}',
]
AIR_STEPS = 14
ATMOSPHERE = 101.325


def air_control(step: int) -> Control:
    return Control(pressure={"right.cavity": 1.0 * step}, valve={"left.cavity": 1.0 - 0.1 * step})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Outputs of a run with one finger on a line and one with regulated air."""
    folder = tmp_path_factory.mktemp("run")
    simulation = Simulation(load_scene(TINY_GRIPPER, AIR))
    make_run(simulation, [RecordingOutput(folder), CsvOutput(folder)], map(air_control, range(AIR_STEPS)))
    return folder


def recording_of(folder: Path) -> Recording:
    return read_recording(folder / "recording.h5")


@pytest.mark.parametrize("frame", [0, 7, AIR_STEPS])
def test_a_resumed_run_has_the_air(folder: Path, frame: int) -> None:
    """A run that goes on from any frame ends in the state of the one that was recorded, to the bit."""
    with recording_of(folder) as opened:
        simulation = resumed_simulation(opened, frame, recorded_scene(opened, (), None))
        assert simulation.state == state_at(opened, frame)
        for step in range(frame, AIR_STEPS):
            simulation.step(air_control(step))
        assert simulation.state == state_at(opened, AIR_STEPS)


NETWORK = [
    'soft_bodies.left.cavities.cavity={group = "cavity", air = "network"}',
    'soft_bodies.right.cavities.cavity={group = "cavity", air = "network"}',
    "air.sources.pump={delay = 0.02, response_time = 0.03}",
    "air.tanks.manifold={volume = 500.0}",
    'air.valves.supply={inlet = "pump", outlet = "manifold", exhaust = "atmosphere", conductance = 0.02, delay = 0.03}',
    'air.tubes.to_left={inlet = "manifold", outlet = "left.cavity", length = 200.0, diameter = 2.0}',
    'air.orifices.to_right={inlet = "manifold", outlet = "right.cavity", conductance = 0.01}',
    "limits.pressure_rate=100.0",
]


def network_control(step: int) -> Control:
    return Control(pressure={"pump": 2.0 * step}, valve={"supply": 1.0 - 0.1 * step})


@pytest.mark.parametrize("every", [1, 4])
def test_a_recording_has_the_air_network(tmp_path: Path, every: int) -> None:
    """A run goes on from any instant, to the bit; columns of CSV, plots and recording have what was observed."""
    simulation = Simulation(load_scene(TINY_GRIPPER, NETWORK))
    outputs = [RecordingOutput(tmp_path, every=every), CsvOutput(tmp_path)]
    states = make_run(simulation, outputs, map(network_control, range(AIR_STEPS)))
    seen = simulation.observe()
    assert seen.pressures["left.cavity"] > 0.1 and seen.clipped == ("pump",)
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    assert float(last["network_pressure manifold [kPa]"]) == pytest.approx(seen.network_pressures["manifold"])
    assert float(last["network_opening supply [1]"]) == pytest.approx(seen.network_openings["supply"])
    with recording_of(tmp_path) as opened:
        assert opened.column("network_flow")[-1].tolist() == [*seen.network_flows.values()]
        curves = PANELS["network-pressure"](RunCurves(opened)).curves
        assert {curve.label: curve.y[-1] for curve in curves} == seen.network_pressures
        for instant in range(1, opened.instant_count):
            step = int(opened.row("step", instant))
            resumed = resumed_simulation(opened, instant, recorded_scene(opened, (), None))
            assert resumed.state == states[step]
            for later in range(step, AIR_STEPS):
                resumed.step(network_control(later))
            assert resumed.state == states[-1]
        leak = '{inlet = "manifold", outlet = "atmosphere", conductance = 0.1}'
        other = recorded_scene(opened, [f"air.orifices.leak={leak}"], None)
        with pytest.raises(ResumeError, match=r"has part of the air network manifold, .*, the scene .* leak"):
            resumed_simulation(opened, 0, other)


def test_a_run_is_resumed_with_a_longer_delay(tmp_path: Path) -> None:
    """The regulator holds the pressure that it was asked for while the delay grows: no older request comes back."""
    steady = Control(pressure={"pump": 5.0}, valve={"supply": 1.0})
    simulation = Simulation(load_scene(TINY_GRIPPER, NETWORK))
    make_run(simulation, [RecordingOutput(tmp_path)], [steady] * AIR_STEPS)
    for delay in (0.0, 0.03):
        with recording_of(tmp_path) as opened:
            scene = recorded_scene(opened, [f"air.sources.pump.delay={delay}"], None)
            resumed = resumed_simulation(opened, AIR_STEPS, scene)
        seen = [resumed.observe().network_pressures["pump"]]
        for _ in range(4):
            seen.append(resumed.step(steady).observation.network_pressures["pump"])
        assert np.diff(seen).min() > 0.0


def test_a_finger_can_be_shut_where_a_run_is_resumed(folder: Path) -> None:
    """What a regulator let in is what is shut in: pressure and shape go on from where they were."""
    with recording_of(folder) as opened:
        scene = recorded_scene(opened, ['soft_bodies.right.cavities.cavity.air="sealed"'], None)
        simulation = resumed_simulation(opened, AIR_STEPS, scene)
        before = simulation.state
        simulation.step()
        assert simulation.state.air_mass[1] == before.air_mass[1] > simulation.model.initial_state().air_mass[1]
        after = simulation.state
        work = (before.actuator_effort[1] + ATMOSPHERE) * before.actuator_value[1]
        assert after.actuator_effort[1] < before.actuator_effort[1]  # the walls still move outwards
        assert (after.actuator_effort[1] + ATMOSPHERE) * after.actuator_value[1] == pytest.approx(work, rel=1e-3)


def test_columns_and_panels(folder: Path) -> None:
    with recording_of(folder) as opened, (folder / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
        for name, unit in (("air_mass", "kg"), ("air_flow", "kg/s"), ("valve", "1")):
            column = opened.column(name)
            assert column.shape == (AIR_STEPS + 1, 2) and expected(name, opened)
            for place, cavity in enumerate(opened.cavities):
                written = [float(row[f"{name} {cavity} [{unit}]"]) for row in rows]
                assert written == pytest.approx(column[1:, place], rel=1e-6)
        flow, mass = opened.column("air_flow"), opened.column("air_mass")
        assert (flow[4:10] > 0.0).all() and not opened.column("valve")[:4].any()
        assert np.diff(mass, axis=0) == pytest.approx(0.01 * flow[1:], rel=1e-9, abs=1e-18)
        assert {"air_mass", "air_flow", "valve"} <= PANELS.keys()


# Young's moduli.


REGION = "{box = [[-100.0, -100.0, -100.0], [100.0, 100.0, 0.0]], young_modulus = 300.0}"
CONTROLS = (
    {},
    {"left": 50.0, "left.regions.0": 900.0},
    {"right": 40.0},
)  # fmt: skip
MODULI = (
    {"left": 100.0, "left.regions.0": 300.0, "right": 100.0},
    {"left": 100.0, "left.regions.0": 300.0, "right": 100.0},
    {"left": 50.0, "left.regions.0": 900.0, "right": 100.0},
    {"left": 50.0, "left.regions.0": 900.0, "right": 40.0},
)
"""What is asked for in each step, and the moduli [kPa] of each frame: that before the first step, then the others."""


def test_map_of_contact_pressure_has_the_recorded_peak(tmp_path: Path) -> None:
    """The highest value of each instant is the highest of all pairs, and values are zero but where fingers touch."""
    observed = tiny_run(tmp_path)
    with recording_of(tmp_path) as recording:
        values, peaks = contact_pressure(recording), recording.column("peak_pressure")
        assert peaks[-1].max() > 0.5
        for instant in (0, 20, recording.instant_count - 1):
            pressure = values(instant)[:, 0]
            assert pressure.max() == pytest.approx(peaks[instant].max(), rel=2e-3)
            assert set(observed[instant].peak_pressures) == set() or 0.5 < (pressure == 0.0).mean() < 1.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    """A run in which the fingers are inflated and change their stiffness, one of them with a stiff lower half."""
    regions = [f"soft_bodies.left.regions=[{REGION}]", "soft_bodies.right.regions=[]"]
    simulation = Simulation(load_scene(TINY_GRIPPER, regions))
    output = RecordingOutput(tmp_path_factory.mktemp("run"))
    pressure = dict.fromkeys(simulation.model.cavities.names, 5.0)
    make_run(simulation, [output], [Control(pressure=pressure, young_modulus=moduli) for moduli in CONTROLS])
    with read_recording(output.path) as opened:
        yield opened


def element_moduli(recording: Recording, frame: int) -> list[np.ndarray]:
    """Young's modulus of each element of each body [kPa], from what the fixture asks for."""
    moduli = []
    for body in recording.soft_bodies:
        of_body = np.full(len(body.elements), MODULI[frame][body.name])
        if body.name == "left":
            of_body[body.mesh_nodes[body.elements].mean(axis=1)[:, 2] < 0.0] = MODULI[frame]["left.regions.0"]
            assert len(set(of_body)) == 2
        moduli.append(of_body)
    return moduli


def element_stress(recording: Recording, frame: int) -> list[np.ndarray]:
    """Von Mises stress of each element of each body [kPa]."""
    position = recording.row("position", frame)
    laws = [
        StressLaw(body.rest_position, body.elements, body.poisson_ratio, corotation="polar")
        for body in recording.soft_bodies
    ]
    return [
        von_mises(law.stress(position[body.nodes], moduli))
        for law, body, moduli in zip(laws, recording.soft_bodies, element_moduli(recording, frame), strict=True)
    ]


def test_moduli_are_recorded_frame_by_frame(recording: Recording) -> None:
    for frame, moduli in enumerate(MODULI):
        assert dict(zip(recording.materials, recording.row("young_modulus", frame), strict=True)) == moduli


@pytest.mark.parametrize("frame", [1, 2, 3])
def test_colours_of_stress_are_those_of_the_present_stiffness(recording: Recording, frame: int) -> None:
    expected = np.full((len(recording.row("position", frame)), len(recording.materials)), np.nan)
    for body, values in zip(recording.soft_bodies, element_stress(recording, frame), strict=True):
        for material in set(body.material):
            own = body.material == material
            expected[body.nodes, material] = nodal_mean(values[own], body.elements[own], body.rest_position)
    np.testing.assert_allclose(stress(recording)(frame), expected, rtol=1e-12)


def test_the_export_has_stiffness_and_stress_of_each_frame(recording: Recording, tmp_path: Path) -> None:
    export_vtu(recording, [1, 2, 3], tmp_path)
    for frame in (1, 2, 3):
        cells = pyvista.read(tmp_path / "soft_bodies" / f"{frame:05d}.vtu").cell_data
        np.testing.assert_array_equal(cells["young_modulus [kPa]"], np.concatenate(element_moduli(recording, frame)))
        expected = np.concatenate(element_stress(recording, frame))
        np.testing.assert_allclose(cells["von_mises [kPa]"], expected, rtol=1e-5, atol=1e-6 * expected.max())


@pytest.mark.parametrize("frame", [1, 2])
def test_a_resumed_run_is_the_one_that_went_on(recording: Recording, frame: int) -> None:
    """From before and from between two changes, which are made again."""
    simulation = resumed_simulation(recording, frame, recording.scene)
    for step in range(frame, len(CONTROLS)):
        simulation.step(Control(young_modulus=CONTROLS[step]))
        assert simulation.state == state_at(recording, step + 1)


@pytest.mark.parametrize(
    ("overrides", "changed"),
    [
        (["contact.friction=0.3"], {}),
        (["soft_bodies.right.young_modulus=200.0"], {"right": 200.0}),
        (["soft_bodies.left.regions.0.young_modulus=120.0"], {"left.regions.0": 120.0}),
        ([f"soft_bodies.right.regions=[{REGION}]"], {"right.regions.0": 300.0}),
    ],
)
def test_a_modulus_that_is_set_for_the_rest_is_that_of_the_rest(
    recording: Recording, overrides: list[str], changed: dict[str, float]
) -> None:
    """Others stay what the controller made of them."""
    simulation = resumed_simulation(recording, 3, recorded_scene(recording, overrides, None))
    moduli = dict(zip(simulation.model.material_names, simulation.state.young_modulus.tolist(), strict=True))
    assert moduli == MODULI[3] | changed


# Signals of the controller.


SIGNALS = [{"phase": 1.0}, {"phase": 2.0, "$late$ <b>": 7.5}, {}, {"phase": 3.0}]


def record(folder: Path, signals: Sequence[Mapping[str, float]]) -> Path:
    """A made-up run with these signals in its steps; one frame each."""
    output = fake_run.begun(RecordingOutput(folder))
    for step, values in enumerate(signals, start=1):
        report = fake_run.fake_report(step)
        report.signals = values
        output.record(fake_run.fake_state(step), report)
    output.end("completed")
    return output.path


@pytest.mark.parametrize("repaired", [False, True])
def test_signals_come_back_also_one_that_comes_late(tmp_path: Path, repaired: bool) -> None:
    """NaN stands where the controller gave nothing, and before the first step."""
    path = record(tmp_path, SIGNALS)
    if repaired:
        with read_recording(path) as recording:
            recording.rescue(path := tmp_path / "new.h5")
    with read_recording(path) as recording:
        assert recording.signals == ["phase", "$late$ <b>"]
        none = np.nan
        np.testing.assert_array_equal(recording.column("signals")[:, 0], [none, 1.0, 2.0, none, 3.0])
        np.testing.assert_array_equal(recording.column("signals")[:, 1], [none, none, 7.5, none, none])


def test_plots_have_a_panel_for_each_signal(tmp_path: Path) -> None:
    with read_recording(record(tmp_path, SIGNALS)) as recording:
        plots = draw_plots(recording, "svg")
        assert {"signal phase", "signal $late$ <b>"} < set(plots.shown)
        assert draw_plots(recording, "svg", ["signal phase"]).shown == ("signal phase",)
        with pytest.raises(PlotError, match=r"--only signal place: there are: .*, signal phase, "):
            draw_plots(recording, "svg", ["signal place"])


def test_the_report_has_a_table_of_the_signals(tmp_path: Path) -> None:
    with read_recording(record(tmp_path, SIGNALS)) as recording:
        page = report_page(collect(recording), tmp_path)
    assert "<th>phase</th><td>3 at last, from 1 to 3</td>" in page
    assert "<th>$late$ &lt;b&gt;</th>" in page
    with read_recording(record(tmp_path, [{}])) as recording:
        assert "Signals of the controller" not in report_page(collect(recording), tmp_path)


def test_signals_beyond_the_room_are_named_once(tmp_path: Path) -> None:
    many = {f"signal {number}": float(number) for number in range(SIGNAL_COUNT + 1)}
    with pytest.warns(UserWarning, match=f"room for {SIGNAL_COUNT} .*'signal {SIGNAL_COUNT}' is left") as warned:
        path = record(tmp_path, [many, many])
    assert len(warned) == 1
    with read_recording(path) as recording:
        assert recording.signals == list(many)[:SIGNAL_COUNT]


def test_the_signals_of_a_real_run(tmp_path: Path) -> None:
    controls = [Control(signals={"set point": 10.0 * step}) for step in range(4)]
    make_run(Simulation(load_scene(TINY_GRIPPER)), [RecordingOutput(tmp_path, every=2)], controls)
    with read_recording(tmp_path / "recording.h5") as recording:
        np.testing.assert_array_equal(recording.column("signals")[:, 0], [np.nan, 10.0, 30.0])
