"""A recording is readable whenever its writer was killed: also while the file is begun, and while it is closed."""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import fake_run

from taichisoft_outputs import read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput

STEPS = 20
WRITERS = ("recording/recording_file.py", "recording/recording_output.py", "base/files.py")


def record(folder: Path) -> None:
    """Begin, write and close a recording."""
    fake_run.fake_run([RecordingOutput(folder)], STEPS)


def lines_before_the_end(function: Callable[[], None], limit: int) -> int:
    """Call it in a process of its own that is killed after so many lines of the recording's modules.

    Returns:
        How many of them were left to it; 0 where it was killed.
    """
    child = os.fork()
    if child == 0:
        left = limit

        def count(frame, event, argument):
            nonlocal left
            if not frame.f_code.co_filename.endswith(WRITERS):
                return None
            if event == "line":
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)
            return count

        sys.settrace(count)
        function()
        sys.settrace(None)
        Path(f"{limit}.left").write_text(str(left))
        os._exit(0)
    killed = os.WIFSIGNALED(os.waitpid(child, 0)[1])
    return 0 if killed else int(Path(f"{limit}.left").read_text())


def test_killed_between_any_lines_a_recording_is_the_older_or_the_new_one(tmp_path: Path, monkeypatch) -> None:
    """In the middle of beginning and of closing, too; nothing of the killed stays when another run has begun."""
    monkeypatch.chdir(tmp_path)
    fake_run.fake_run([RecordingOutput(tmp_path)], 1)
    many = 10**6
    total = many - lines_before_the_end(lambda: record(tmp_path / "whole"), many)
    found = set()
    for limit in [*range(2, total, total // 12), *range(total - 8, total)]:
        assert lines_before_the_end(lambda: record(tmp_path), limit) == 0
        with read_recording(tmp_path / "recording.h5") as recording:
            found.add((recording.outcome, recording.frame_count))
            fake_run.check_frame(recording, recording.frame_count - 1, recording.frame_count - 1)
    unfinished = {("unfinished", frames) for frames in range(1, STEPS + 2)}
    assert found <= {("completed", 2), ("completed", STEPS + 1)} | unfinished
    assert len(found & unfinished) > 2 and found - unfinished == {("completed", 2), ("completed", STEPS + 1)}
    record(tmp_path)
    assert not list(tmp_path.glob(".*.partial")), "left by those who were killed"
