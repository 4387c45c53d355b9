"""Damage to a recording is found, said in one line and soon, and what is whole is rescued."""

import random
import subprocess
import sys
import time
from pathlib import Path

import fake_run
import numpy as np
import pytest
import tiny_run
from conftest import PATIENCE
from hypothesis import given, settings
from hypothesis import strategies as st

from taichisoft.state import State
from taichisoft_benchmarks.faults.recordings import DAMAGES, cut_off, flip_bit
from taichisoft_plugins.recording import repair as repair_module
from taichisoft_plugins.recording.layout import RecordingError
from taichisoft_plugins.recording.output import RecordingOutput
from taichisoft_plugins.recording.reader import read_recording
from taichisoft_plugins.recording.repair import repair

STEPS = 250


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    fake_run.fake_run([RecordingOutput(folder)], STEPS)
    return folder / "recording.h5"


def read_all(path: Path) -> None:
    """Read every number, as one command or another does."""
    with read_recording(path) as recording:
        assert recording.soft_bodies
        recording.rows_of_frames(0, recording.frame_count)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32), kind=st.sampled_from(DAMAGES))
def test_what_is_read_of_a_damaged_recording_is_what_was_written(recorded: Path, seed: int, kind) -> None:
    """Or it is an error of one line; nothing else is raised, and no number differs."""
    content = recorded.read_bytes()
    broken = recorded.with_name("broken.h5")
    broken.write_bytes(kind(bytearray(content), random.Random(seed)))
    try:
        with read_recording(broken) as recording:
            rows = recording.rows_of_frames(0, recording.frame_count)
            assert recording.frame_count == STEPS + 1
            assert np.array_equal(rows["steps/step"], np.arange(STEPS + 1))
            assert np.array_equal(recording.soft_bodies[0].rest_position, fake_run.REST)
            assert recording.scene == fake_run.fake_model().scene
    except RecordingError as error:
        assert "\n" not in str(error) and str(error).startswith(f"{broken}: ")


@pytest.mark.parametrize("finished", [True, False])
def test_a_repaired_recording_has_every_whole_frame(recorded: Path, tmp_path: Path, finished: bool) -> None:
    """A flipped bit in a position costs its own frame alone, be the run finished or killed."""
    content = bytearray(recorded.read_bytes())
    if not finished:
        writer = RecordingOutput(tmp_path / "killed")
        writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
        for step in range(1, STEPS + 1):
            writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
        writer._write()
        content = bytearray(writer.path.read_bytes())
    place = content.index(fake_run.fake_state(77).velocity.tobytes())
    content[place + 5] ^= 4
    broken, new = tmp_path / "broken.h5", tmp_path / "new.h5"
    broken.write_bytes(content)
    rescue = repair(broken, new)
    assert rescue.whole == [frame for frame in range(STEPS + 1) if frame != 77]
    assert "frame 77: steps/velocity" in rescue.damage
    with read_recording(new) as recording:
        assert recording.outcome == f"repaired: {STEPS} of {STEPS + 1} frames were whole"
        for frame, step in enumerate(rescue.whole):
            assert recording.state(frame) == State(**vars(fake_run.fake_state(step)))


def test_of_a_recording_that_is_cut_off_the_frames_before_are_rescued(recorded: Path, tmp_path: Path) -> None:
    content = recorded.read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: -len(content) // 5])
    rescue = repair(tmp_path / "cut.h5", tmp_path / "new.h5")
    assert rescue.whole == list(range(len(rescue.whole))) and 100 <= len(rescue.whole) < STEPS
    with read_recording(tmp_path / "new.h5") as recording:
        assert recording.state(99) == State(**vars(fake_run.fake_state(99)))


def test_a_whole_recording_is_repaired_to_the_same(recorded: Path, tmp_path: Path) -> None:
    result = tiny_run.command("repair", recorded, "-o", tmp_path / "new.h5")
    assert result.output.splitlines() == [f"{tmp_path / 'new.h5'}: {STEPS + 1} of {STEPS + 1} frames"]
    with read_recording(recorded) as one, read_recording(tmp_path / "new.h5") as other:
        assert other.outcome == one.outcome and other.scene == one.scene
        rows = other.rows_of_frames(0, STEPS + 1)
        for path, values in one.rows_of_frames(0, STEPS + 1).items():
            assert rows[path].tobytes() == values.tobytes(), path


HANGS = """
import json, sys, time
job = json.loads(sys.argv[1])
print(json.dumps({"count": 3}), flush=True)
for frame in range(job["first"], 3):
    if frame == 1 or frame >= job["singly_to"]:
        time.sleep(60) if job["run"].endswith("hang.h5") else __import__("os").abort()
    print(json.dumps({"frames": [frame, frame + 1], "damage": ""}), flush=True)
"""


@pytest.mark.parametrize(
    ("name", "damage"), [("hang.h5", "no frame within 5 s"), ("crash.h5", "the process was ended by SIGABRT")]
)
def test_a_frame_at_which_hdf5_dies_is_left_out(tmp_path: Path, monkeypatch, name: str, damage: str) -> None:
    monkeypatch.setattr(repair_module, "LONGEST_SILENCE", 5.0)
    real = subprocess.Popen
    replaced = lambda arguments, **named: real([sys.executable, "-c", HANGS, arguments[-1]], **named)  # noqa: E731
    monkeypatch.setattr(repair_module.subprocess, "Popen", replaced)
    rescue = repair_module._find_whole_frames(tmp_path / name)
    assert (rescue.whole, rescue.damage) == ([0, 2], damage)


@pytest.mark.parametrize("kind", [cut_off, flip_bit])
@pytest.mark.parametrize("command", ["export", "plot", "render", "report", "resume", "view"])
def test_every_command_says_so_in_one_line(tmp_path: Path, recorded: Path, kind, command: str) -> None:
    broken = tmp_path / "recording.h5"
    content = recorded.read_bytes()
    broken.write_bytes(content[:20000] if kind is cut_off else b"\x89HDG" + content[4:])
    started = time.monotonic()
    result = tiny_run.command(command, broken)
    assert isinstance(result.exception, RecordingError), result.exception
    assert "\n" not in str(result.exception) and f"taichisoft repair {broken} -o NEW.h5" in str(result.exception)
    assert time.monotonic() - started < PATIENCE


def test_what_cannot_be_repaired_is_one_line(tmp_path: Path, recorded: Path) -> None:
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(RecordingError, match="not readable as HDF5"):
        repair(tmp_path / "text.h5", tmp_path / "new.h5")
    with pytest.raises(RecordingError, match="is the damaged recording; name another file"):
        repair(recorded, recorded)
    with pytest.raises(RecordingError, match="no such recording"):
        repair(tmp_path / "none.h5", tmp_path / "new.h5")
