"""Damage to a recording is found, said in one line and soon, and what is whole is rescued."""

import random
import time
from pathlib import Path

import fake_run
import numpy as np
import pytest
import tiny_run
from conftest import PATIENCE
from damage import DAMAGES, cut_off, flip_bit
from hypothesis import given, settings
from hypothesis import strategies as st

from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import rescue

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


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of as many steps that nobody has closed, but for the last step."""
    writer = RecordingOutput(tmp_path_factory.mktemp("killed"))
    writer.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step in range(1, STEPS + 2):
        writer.record(fake_run.fake_state(step), fake_run.fake_report(step))
    return writer.path


@pytest.mark.parametrize("finished", [True, False])
def test_a_repaired_recording_has_every_whole_frame(
    recorded: Path, killed: Path, tmp_path: Path, finished: bool
) -> None:
    """A flipped bit in a position costs its own frame alone while the run goes on; then the frames of its page."""
    content = bytearray((recorded if finished else killed).read_bytes())
    place = content.index(fake_run.fake_state(70).velocity.tobytes())
    content[place + 5] ^= 4
    broken, new = tmp_path / "broken.h5", tmp_path / "new.h5"
    broken.write_bytes(content)
    repaired = rescue(broken, new)
    lost = sorted(set(range(STEPS + 1)) - set(repaired.whole))
    assert 70 in lost and len(lost) <= (100 if finished else 1)
    assert f"frame {lost[0]}: " in repaired.damage and "what was written" in repaired.damage
    with read_recording(new) as recording:
        assert recording.outcome == f"repaired: {STEPS + 1 - len(lost)} of {STEPS + 1} frames were whole"
        for frame, step in enumerate(repaired.whole):
            fake_run.check_frame(recording, frame, step)


def test_the_recording_of_a_killed_run_becomes_an_hdf5_file(killed: Path, tmp_path: Path) -> None:
    assert rescue(killed, tmp_path / "new.h5").whole == list(range(STEPS + 1))
    import h5py

    with h5py.File(tmp_path / "new.h5") as file:
        assert file["outcome"][()] == b"unfinished"
        assert file["steps/step"][:].tolist() == list(range(STEPS + 1))


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32), kind=st.sampled_from(DAMAGES))
def test_what_is_read_of_a_killed_and_damaged_recording_is_what_was_written(killed: Path, seed: int, kind) -> None:
    """Frames at the end may be missing, as if it had been killed before."""
    broken = killed.with_name("broken.h5")
    broken.write_bytes(kind(bytearray(killed.read_bytes()), random.Random(seed)))
    try:
        with read_recording(broken) as recording:
            for frame in range(0, recording.frame_count, 7):
                fake_run.check_frame(recording, frame, frame)
            assert recording.column("step").tolist() == list(range(recording.frame_count))
    except RecordingError as error:
        assert "\n" not in str(error) and str(error).startswith(f"{broken}: ")


def test_of_a_recording_that_is_cut_off_the_frames_before_are_rescued(recorded: Path, tmp_path: Path) -> None:
    content = recorded.read_bytes()
    (tmp_path / "cut.h5").write_bytes(content[: -len(content) // 10])
    repaired = rescue(tmp_path / "cut.h5", tmp_path / "new.h5")
    assert repaired.whole[:100] == list(range(100)) and len(repaired.whole) < STEPS
    with read_recording(tmp_path / "new.h5") as recording:
        fake_run.check_frame(recording, 99, 99)


def test_a_whole_recording_is_repaired_to_the_same(recorded: Path, tmp_path: Path) -> None:
    result = tiny_run.command("recording", "repair", recorded, "-o", tmp_path / "new.h5")
    assert result.output.splitlines() == [f"{tmp_path / 'new.h5'}: {STEPS + 1} of {STEPS + 1} frames"]
    with read_recording(recorded) as one, read_recording(tmp_path / "new.h5") as other:
        assert other.outcome == one.outcome and other.scene == one.scene
        rows = other.rows_of_frames(0, STEPS + 1)
        for path, values in one.rows_of_frames(0, STEPS + 1).items():
            assert rows[path].tobytes() == values.tobytes(), path


@pytest.mark.parametrize("kind", [cut_off, flip_bit])
@pytest.mark.parametrize("command", ["export", "plot", "render", "report", "resume", "view"])
def test_every_command_says_so_in_one_line(tmp_path: Path, recorded: Path, kind, command: str) -> None:
    broken = tmp_path / "recording.h5"
    content = recorded.read_bytes()
    broken.write_bytes(content[:20000] if kind is cut_off else b"\x89HDG" + content[4:])
    started = time.monotonic()
    result = tiny_run.command("recording", command, broken)
    assert isinstance(result.exception, RecordingError), result.exception
    assert "\n" not in str(result.exception)
    assert f"taichisoft recording repair {broken} -o NEW.h5" in str(result.exception)
    assert time.monotonic() - started < PATIENCE


def test_what_cannot_be_repaired_is_one_line(tmp_path: Path, recorded: Path) -> None:
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(RecordingError, match="not readable as HDF5"):
        rescue(tmp_path / "text.h5", tmp_path / "new.h5")
    with pytest.raises(RecordingError, match="is the damaged recording; name another file"):
        rescue(recorded, recorded)
    with pytest.raises(RecordingError, match="no such recording"):
        rescue(tmp_path / "none.h5", tmp_path / "new.h5")
