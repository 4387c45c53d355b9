"""A run without an end takes bounded room: in memory, and on the disk."""

import gc
import os
import tracemalloc
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import Simulation, State, load_scene
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.metrics import MetricsOutput
from taichisoft_outputs.recording import recording_output
from taichisoft_outputs.recording.recording_file import RunningFile
from taichisoft_outputs.recording.recording_output import USUAL_LIMIT, RecordingOutput, limit_endless_recordings
from taichisoft_outputs.run_figures import RESOLUTION, RunningMedian, middle_keys


@given(st.lists(st.integers(0, 50), min_size=1))
def test_the_middle_of_counted_numbers_is_their_median(numbers: list[int]) -> None:
    assert sum(middle_keys(Counter(numbers))) / 2 == np.median(numbers)


@given(st.lists(st.floats(1e-4, 10.0), min_size=1))
def test_a_running_median_is_exact_to_its_resolution(numbers: list[float]) -> None:
    median = RunningMedian()
    for number in numbers:
        median.add(number)
    assert median.value == pytest.approx(np.median(numbers), rel=RESOLUTION)


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


def test_a_full_recording_makes_room_and_the_newest_frames_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    writer = RecordingOutput(tmp_path, limit=0.001)
    writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
    assert not (tmp_path / "recording-before.h5").exists()
    with pytest.warns(UserWarning, match=r"half of 0\.001 GB is full: it is recording-before\.h5 now") as warned:
        for step in range(1, 2001):
            writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
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
        assert newest.state(0) == before.state(before.frame_count - 1)
        assert newest.state(newest.frame_count - 1) == State(**vars(fake_run.fake_state(2000)))


@pytest.mark.parametrize(
    ("steps", "given_limit", "expected"), [(np.inf, None, USUAL_LIMIT), (np.inf, 9.0, 9.0), (100, None, None)]
)
def test_only_a_run_without_an_end_has_a_usual_limit(
    tmp_path: Path, steps: float, given_limit: float | None, expected: float | None
) -> None:
    output = RecordingOutput(tmp_path, limit=given_limit)
    limit_endless_recordings(SimpleNamespace(outputs=[output], step_count=steps))
    assert output.limit == expected


def test_where_files_have_one_name_only_the_parts_still_turn_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    writer = RecordingOutput(tmp_path, limit=0.001)
    writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
    with pytest.warns(UserWarning, match="half of"):
        for step in range(1, 501):
            writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
    writer.end("stopped")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording-before.h5", "recording.h5"]


def test_a_limit_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"^--record-limit 0: must be a positive number of gigabytes$"):
        RecordingOutput(tmp_path, limit=0.0)
