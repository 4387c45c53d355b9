"""A recording has what cables were and did: it is drawn without the model, and a run goes on from it to the bit."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cable_block import LINK, STEPS, TENDON, cable_scene, control, run_cables

from taichisoft import Output, Simulation, State, StepReport
from taichisoft.mechanics import CABLES
from taichisoft.scene import scene_from_toml
from taichisoft_outputs import Recording, read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import ResumeError, resumed_simulation, state_at


class Kept(Output):
    """Keeps all states and reports."""

    def begin(self, model: Any, state: State) -> None:
        self.model, self.states = model, [state]
        self.reports: list[StepReport] = []

    def record(self, state: State, report: StepReport) -> None:
        self.states.append(state)
        self.reports.append(report)

    def end(self, outcome: str) -> None:
        pass


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Recording, Kept]]:
    folder, kept = tmp_path_factory.mktemp("cables"), Kept()
    run_cables(folder, [RecordingOutput(folder), kept])
    with read_recording(folder / "recording.h5") as recording:
        yield recording, kept


def test_every_state_comes_back_bit_for_bit(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    assert [state_at(recording, frame) for frame in range(STEPS + 1)] == kept.states


def test_tensions_lengths_and_pulls_stand_in_named_columns(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    assert recording.cables == [TENDON, LINK]
    for column, seen in (("tension", "cable_tensions"), ("cable_length", "cable_lengths"), ("pull", "cable_pulls")):
        for frame, report in enumerate(kept.reports, start=1):
            expected = getattr(report.observation, seen)
            assert dict(zip(recording.cables, recording.row(column, frame), strict=True)) == expected
    assert recording.row("pull", 0).tolist() == [0.0, 0.0]
    assert recording.row("pull", STEPS)[0] == pytest.approx(0.2 * STEPS, rel=0.01)
    assert recording.row("tension", STEPS)[1] == pytest.approx(5.0 * STEPS)


def test_points_are_those_of_the_state_without_the_model(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    paths = kept.model.cables.lines
    for frame in (0, 5, STEPS):
        for recorded, path in zip(recording.cable_points(frame), paths, strict=True):
            np.testing.assert_allclose(recorded, path.points(kept.states[frame], kept.model.frames), atol=1e-5)
    for recorded_path, path in zip(recording.lines(CABLES), paths, strict=True):
        assert vars(recorded_path).keys() == vars(path).keys()
        for name, value in vars(path).items():
            np.testing.assert_array_equal(getattr(recorded_path, name), value, err_msg=name)
    moved = recording.cable_points(STEPS)[0] - recording.cable_points(0)[0]
    assert np.linalg.norm(moved, axis=1).min() > 0.5, "there is something to see"
    tendon, link = recording.segment_efforts(CABLES, STEPS)
    assert tendon[-1] == recording.row("tension", STEPS)[0] - recording.row("tension_loss", STEPS).sum()
    assert link.tolist() == [recording.row("tension", STEPS)[1]]


def test_a_run_without_cables_has_none(tmp_path: Path) -> None:
    run_cables(tmp_path, [RecordingOutput(tmp_path)], cables=False)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert (recording.cables, recording.cable_points(1), recording.segment_efforts(CABLES, 1)) == ([], [], [])
        assert recording.column("tension").shape == (STEPS + 1, 0)


def test_a_run_goes_on_to_the_bit(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    simulation = resumed_simulation(recording, 5, recording.scene)
    for step in range(5, STEPS):
        simulation.step(control(step))
    assert simulation.state == kept.states[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("points=[[-10.0, 2.0, 4.0], [18.0, 0.0, 4.0]]", "'block.tendon' is not as it was recorded: its places were 5"),
        ("pull_point=[-31.0, 0.0, 4.0]", "'block.tendon' is not as it was recorded: its places differ by up to 1 mm"),
        (
            "points=[[-10.0, 2.0, 4.0], [0.0, -2.0, 3.5], [10.0, 1.0, 4.5], [18.0, 0.5, 4.0]]",
            "'block.tendon' is not as it was recorded: its points differ by up to 0.5 mm",
        ),
        ("friction=0.0", "its actuator_loss has shape (3,), the model's (0,)"),
    ],
)
def test_another_cable_is_refused(run: tuple[Recording, Kept], change: str, message: str) -> None:
    recording, _ = run
    scene = scene_from_toml(recording.scene_text, "scene", [f"soft_bodies.block.cables.tendon.{change}"])
    with pytest.raises(ResumeError) as caught:
        resumed_simulation(recording, 5, scene)
    assert message in str(caught.value)


def test_another_limit_is_the_same_cable(run: tuple[Recording, Kept]) -> None:
    recording, _ = run
    scene = scene_from_toml(recording.scene_text, "scene", ["soft_bodies.block.cables.tendon.highest_pull=1.0"])
    assert isinstance(resumed_simulation(recording, 2, scene), Simulation)
    assert cable_scene(recording.path.parent) == recording.scene
