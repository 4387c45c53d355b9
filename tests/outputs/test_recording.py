"""A recording gives back what was computed; every N-th step, in bounded space, and of another layout refused."""

import gc
import os
import platform
import tracemalloc
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import Controller, Simulation, State, load_scene, run
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_to_toml
from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.recording import bodies, recording_output
from taichisoft_outputs.recording.layout import LAYOUT
from taichisoft_outputs.recording.recording_file import RunningFile
from taichisoft_outputs.recording.recording_output import (
    USUAL_LIMIT,
    NeededRecording,
    RecordingNeeded,
    RecordingOutput,
    limit_endless_recordings,
)
from taichisoft_outputs.rendering.drawn_outputs import PicturesOutput, VideoOutput
from taichisoft_outputs.run_figures import RESOLUTION, StepFigures

STEPS = 113


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    fake_run.fake_run([RecordingOutput(folder)], steps=STEPS, floor=True)
    with read_recording(folder / "recording.h5") as opened:
        yield opened


def test_every_number_of_every_frame_comes_back(recording):
    assert recording.instant_count == STEPS + 1
    for frame in range(STEPS + 1):
        fake_run.check_instant(recording, frame, frame)
    assert np.array_equal(recording.column("iterations"), np.arange(STEPS + 1))
    assert np.array_equal(recording.column("converged")[1:], np.arange(1, STEPS + 1) % 2 == 0)


def test_every_tenth_step_has_a_whole_state(recording):
    with_state = [frame for frame in range(STEPS + 1) if recording.has_state(frame)]
    assert with_state == [*range(0, STEPS + 1, 10), STEPS]
    with pytest.raises(RecordingError, match="instant 7 has no state of its own"):
        recording.state(7)


def test_velocity_between_states_is_a_mean(recording):
    assert np.array_equal(recording.velocity(20), fake_run.fake_state(20).velocity)
    assert np.allclose(recording.velocity(22), [[1.0 / fake_run.STEP, 0.0, 0.0]] * 4, atol=2e-3)


def test_meshes_and_materials_come_back(recording):
    (finger,) = recording.soft_bodies
    assert (finger.name, finger.nodes) == ("finger", slice(0, 4))
    assert np.array_equal(finger.rest_position, fake_run.REST) and finger.elements.tolist() == [[0, 1, 2, 3]]
    assert recording.materials == ["finger"] and recording.row("young_modulus", 7).tolist() == [507.0]
    assert finger.material.tolist() == [0] and np.allclose(finger.poisson_ratio, 0.3, rtol=1e-14)
    assert np.array_equal(finger.surface_groups["outer"], fake_run.FACES)
    assert finger.element_groups["tip"].tolist() == [0]
    assert np.array_equal(finger.mesh("a").nodes, fake_run.REST)


def test_figures_stand_in_named_columns(recording):
    cavity, pair = recording.cavities.index("finger.cavity"), recording.pairs.index(("finger", "cube"))
    assert recording.row("pressure", 7)[cavity] == 14.0
    assert recording.row("volume", 7)[cavity] == 107.0
    assert recording.row("normal_force", 7)[pair] == 21.0  # reported as "cube|finger"
    assert recording.row("friction_force", 7)[pair] == 7.0
    assert recording.row("slip_speed", 7)[pair] == 3.5
    assert recording.row("pressure", 0)[cavity] == 0.0


@pytest.mark.parametrize("frame", [0, 1, 2, 3, 50, 51, 62, 63])
def test_contacts_of_a_frame(recording, frame):
    points, forces = recording.contacts(frame)
    assert np.array_equal(points, np.full((frame % 3, 3), float(frame)))
    assert np.array_equal(forces, fake_run.fake_report(frame).contact_forces)
    assert recording.contact_pairs(frame) == [("finger", "cube")] * (frame % 3)


def test_header(recording):
    assert recording.outcome == "completed"
    assert recording.step_size == fake_run.STEP
    assert recording.scene_text == scene_to_toml(fake_run.fake_model().scene)
    assert recording.scene == fake_run.fake_model().scene
    assert [plane.name for plane in recording.planes] == ["floor"]
    assert recording.versions["taichi"] == version("taichi")
    assert recording.versions["machine"].startswith(platform.system())


def test_surfaces_follow_their_bodies(recording):
    surfaces = {surface.name: surface for surface in recording.surfaces}
    assert {name: surface.kind for name, surface in surfaces.items()} == {
        "finger": "soft",
        "finger.cavity": "cavity",
        "cube": "rigid",
    }
    lift = np.array([15.0, 0.0, 0.0])
    assert np.array_equal(surfaces["finger"].vertices(20), fake_run.REST + lift)
    shrunk = fake_run.REST.mean(axis=0) + 0.7 * (fake_run.REST - fake_run.REST.mean(axis=0))
    assert np.allclose(surfaces["finger.cavity"].vertices(20), shrunk + lift, atol=1e-12)
    # A turn of 2 * 0.2 rad about x takes y to (0, cos, sin).
    corner = fake_run.CUBE[3]
    c, s = np.cos(0.4), np.sin(0.4)
    turned = [corner[0], c * corner[1] - s * corner[2], s * corner[1] + c * corner[2]]
    assert np.allclose(surfaces["cube"].vertices(20)[3], turned + lift + [0, 30, 30], atol=1e-12)


def test_a_moment_is_found_and_one_outside_the_run_is_an_error(recording):
    assert recording.instant_at(0.204) == 20
    with pytest.raises(RecordingError, match=r"nothing at 9 s; .* from 0 s to 1\.13 s"):
        recording.instant_at(9.0)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        (None, "not readable as HDF5"),
        ({}, "not a recording"),
        ({"taichisoft_version": "0.1", "layout": LAYOUT + 1}, f"taichisoft 0.1 wrote it in layout {LAYOUT + 1}, this"),
        ({"taichisoft_version": "0.1"}, "wrote it in layout none"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, attributes, message):
    import h5py

    path = tmp_path / "recording.h5"
    with pytest.raises(RecordingError, match="no such recording"):
        read_recording(path)
    path.write_text("no HDF5")
    if attributes is not None:
        with h5py.File(path, "w") as file:
            file.attrs.update(attributes)
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_a_folder_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RecordingError, match="cannot be written"):
        fake_run.begun(RecordingOutput(tmp_path / "file"))


@pytest.mark.parametrize(
    ("every", "before", "after", "steps"),
    [(1, 3, 2, [0, 1, 2, 3, 0, 1, 2]), (4, 6, 4, [0, 4, 6, 0, 4])],
)
def test_a_restart_stays_in_the_same_recording(tmp_path, every, before, after, steps):
    """With the last step before it, whatever its number."""
    writer = fake_run.begun(RecordingOutput(tmp_path, every=every), range(1, before + 1))
    writer.restart(fake_run.fake_state(0))
    fake_run.make_steps(writer, range(1, after + 1)).end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.column("step").tolist() == steps
        assert recording.last_start == steps.index(0, 1)
        assert recording.instant_at(every * fake_run.STEP) == recording.last_start + 1, "that of the last start"
        with pytest.raises(RecordingError, match=r"nothing at 0\.2 s"):
            recording.instant_at(0.2)


# Every N-th step; other layouts.


def record(folder, steps, **settings):
    fake_run.fake_run([RecordingOutput(folder, **settings)], steps)
    return read_recording(folder / "recording.h5")


def test_every_nth_step_and_the_last_one_are_frames(tmp_path):
    with record(tmp_path, steps=17, every=5) as recording:
        assert recording.every == 5
        assert recording.column("step").tolist() == [0, 5, 10, 15, 17]
        for frame, step in enumerate((0, 5, 10, 15, 17)):
            fake_run.check_instant(recording, frame, step)
        assert recording.instant_at(0.1) == 2 and recording.instant_at(0.16) == 3


def test_solver_figures_are_the_worst_of_all_steps(tmp_path):
    reports = [fake_run.fake_report(step) for step in range(1, 7)]
    for report, iterations, converged, seconds in zip(
        reports, (3, 90, 4, 5, 6, 7), (True, False, True, True, True, True), (1, 2, 6, 1, 1, 1), strict=True
    ):
        report.iterations, report.converged, report.step_time = iterations, converged, seconds
        report.residual, report.max_penetration = iterations * 1e-7, iterations * 1e-3
    output = RecordingOutput(tmp_path, every=3)
    output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step, report in enumerate(reports, start=1):
        output.record(fake_run.fake_state(step), report)
    output.end("completed")
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.column("iterations").tolist() == [0, 90, 7]
        assert recording.column("converged").tolist() == [True, False, True]
        assert recording.column("residual").tolist() == [0.0, 90 * 1e-7, 7 * 1e-7]
        assert recording.column("max_penetration").tolist() == [0.0, 90 * 1e-3, 7 * 1e-3]
        assert recording.column("step_time").tolist() == [0.0, 3.0, 1.0], "their mean"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"every": 0}, "--every 0: must be at least 1"),
        ({"limit": 0.0}, "--record-limit 0: must be a positive number of gigabytes"),
    ],
)
def test_impossible_settings_are_refused(tmp_path, settings, message):
    with pytest.raises(RecordingError, match=message):
        RecordingOutput(tmp_path, **settings)


def test_an_unknown_quantity_is_answered_with_all(tmp_path):
    with (
        record(tmp_path, steps=2) as recording,
        pytest.raises(RecordingError, match=r"no .presure.; there are: .*time"),
    ):
        recording.column("presure")


@pytest.mark.parametrize("ended", [True, False])
def test_another_layout_is_told_from_damage(tmp_path, monkeypatch, ended):
    monkeypatch.setattr(bodies, "LAYOUT", LAYOUT - 1)
    output = fake_run.begun(RecordingOutput(tmp_path), [1])
    if ended:
        output.end("completed")
    expected = rf"taichisoft [\d.]+ wrote it in layout {LAYOUT - 1}, this version reads layout {LAYOUT}; run"
    with pytest.raises(RecordingError, match=expected):
        read_recording(tmp_path / "recording.h5")


# Outputs that are made of the recording.


class Still(Controller):
    def control(self, observation):
        pytest.fail("a step was made")


@pytest.mark.parametrize(("output", "name"), [(PicturesOutput, "pictures"), (VideoOutput, "video")])
def test_drawing_outputs_need_a_recording_before_them(tmp_path: Path, taichisoft_scene, output, name) -> None:
    for outputs in ([output(tmp_path)], [output(tmp_path), RecordingOutput(tmp_path)]):
        with pytest.raises(RecordingNeeded, match=f"output '{name}' needs .*'recording' before it: recording,{name}"):
            run(Simulation(taichisoft_scene), Still(), outputs, duration=0.1)
    assert not [path for path in tmp_path.iterdir() if path.name != "recording.h5"]


def test_the_recording_of_another_run_will_not_do(tmp_path: Path) -> None:
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    with pytest.raises(RecordingNeeded):
        fake_run.fake_run([PicturesOutput(tmp_path)], steps=3)
    needed, recording = NeededRecording(tmp_path), fake_run.begun(RecordingOutput(tmp_path))
    needed.require("pictures")
    recording.end("completed")


# Runs without an end.


@given(st.lists(st.tuples(st.integers(0, 50), st.floats(1e-4, 10.0)), min_size=1))
def test_medians_of_a_run_are_exact_to_their_resolution(steps: list[tuple[int, float]]) -> None:
    figures = StepFigures(1.0, 1e-3)
    rest = {"max_penetration": 0, "inverted_elements": 0, "linearisations": 1, "time": 0.0, "newton_residual": None}
    for iterations, seconds in steps:
        figures.add(SimpleNamespace(iterations=iterations, step_time=seconds, converged=True, **rest))
    counts, times = map(np.array, zip(*steps, strict=True))
    assert figures.metrics(0.01)["iterations_median"] == np.median(counts)
    low, high = (np.quantile(times, 0.5, method=end) for end in ("lower", "higher"))
    median = 1e-3 * figures.metrics(0.01)["step_time_median_ms"]
    assert low * (1.0 - RESOLUTION) <= median <= high * (1.0 + RESOLUTION)


def test_steps_leave_nothing_in_memory(tmp_path: Path) -> None:
    """Of 200 further steps less than 500 bytes each: kept reports alone were 6000."""
    simulation = Simulation(load_scene(TINY_GRIPPER))
    outputs = [RecordingOutput(tmp_path), MetricsOutput(tmp_path)]
    for output in outputs:
        output.begin(simulation.model, simulation.state)

    def go_on(steps: int) -> int:
        for _ in range(steps):
            report = simulation.step()
            for output in outputs:
                output.record(simulation.state, report)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    go_on(20)  # loads the kernels, which would take several times as long while memory is traced
    tracemalloc.start()
    try:
        before = go_on(100)
        grown = go_on(200) - before
    finally:
        tracemalloc.stop()
    assert grown < 500 * 200
    outputs[0].end("stopped")


def test_a_full_recording_keeps_the_newest_instants(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two files that follow each other, each of about half the limit, with every frame of their time."""
    (tmp_path / "recording-before.h5").write_text("of an earlier run")
    there: list[int] = []

    class Watched(RunningFile):
        """A file whose readers find one of its name at every moment."""

        def __init__(self, path: Path, *arguments: Any):
            if there or path.exists():
                with read_recording(path) as there_now:
                    there.append(len(there_now.times))
            super().__init__(path, *arguments)

    monkeypatch.setattr(recording_output, "RunningFile", Watched)
    writer = fake_run.begun(RecordingOutput(tmp_path, limit=0.001))
    assert not (tmp_path / "recording-before.h5").exists()
    with pytest.warns(UserWarning, match=r"half of 0\.001 GB is full: it is recording-before\.h5 now") as warned:
        fake_run.make_steps(writer, range(1, 2001))
    writer.end("stopped")
    assert len(there) > 1 and min(there) > 100
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording-before.h5", "recording.h5"]
    assert len(warned) == 2, [str(one.message) for one in warned]
    assert "what was there before is dropped; --record-limit" in str(warned[1].message)
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 1.3e6
    with (
        read_recording(tmp_path / "recording-before.h5") as before,
        read_recording(tmp_path / "recording.h5") as newest,
    ):
        assert (before.outcome, newest.outcome) == ("continued in another recording", "stopped")
        steps = [*before.column("step").tolist(), *newest.column("step").tolist()[1:]]
        assert steps == list(range(steps[0], 2001)) and len(steps) > 300
        assert newest.state(0) == before.state(before.instant_count - 1)
        assert newest.state(newest.instant_count - 1) == State(**vars(fake_run.fake_state(2000)))


@pytest.mark.parametrize(
    ("steps", "given_limit", "expected"), [(np.inf, None, USUAL_LIMIT), (np.inf, 9.0, 9.0), (100, None, None)]
)
def test_only_a_run_without_an_end_has_a_usual_limit(
    tmp_path: Path, steps: float, given_limit: float | None, expected: float | None
) -> None:
    output = RecordingOutput(tmp_path, limit=given_limit)
    limit_endless_recordings(SimpleNamespace(outputs=[output], step_count=steps))
    assert output.limit == expected


def test_parts_turn_over_without_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    writer = fake_run.begun(RecordingOutput(tmp_path, limit=0.001))
    with pytest.warns(UserWarning, match="half of"):
        fake_run.make_steps(writer, range(1, 501))
    writer.end("stopped")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording-before.h5", "recording.h5"]
