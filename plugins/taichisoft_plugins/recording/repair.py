"""Rescuing the whole frames of a damaged recording, in a process of its own: HDF5 may crash or hang on damage."""

import json
import queue
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

from taichisoft.child_process import PYTHON, how_it_ended
from taichisoft_plugins.recording.layout import RecordingError

LONGEST_SILENCE = 20.0
"""A process that reads no frame for so long hangs [s]; usually a frame takes milliseconds."""


TOGETHER = 100
"""Frames that are read or written together."""


@dataclass(frozen=True)
class Rescue:
    """What was rescued.

    Attributes:
        frame_count: frames that the damaged recording says it has.
        whole: numbers of those that are whole.
        damage: what is wrong with the first one that is not; empty where all are whole.
    """

    frame_count: int
    whole: list[int]
    damage: str


class RepairProcessFailed(RecordingError):
    """The process that reads the frames crashed or hung."""


def repair(run: Path, new: Path) -> Rescue:
    """Write a new recording with every frame of `run` that is whole.

    Args:
        run: a damaged recording; it is only read.
        new: place of the new one; what is there is replaced.

    Raises:
        RecordingError: nothing can be rescued, or the new file cannot be written.
    """
    if new.resolve() == run.resolve():
        raise RecordingError(f"--output {new}: is the damaged recording; name another file")
    if not run.is_file():
        raise RecordingError(f"{run}: no such recording")
    rescue = _find_whole_frames(run)
    if not rescue.whole:
        raise RecordingError(f"{run}: none of its {rescue.frame_count} frames is whole: {rescue.damage}")
    for _ in _answers({"run": str(run), "new": str(new), "frames": rescue.whole, "of": rescue.frame_count}):
        pass
    return rescue


def _find_whole_frames(run: Path) -> Rescue:
    """Look at all frames, many at a time; those at which the process dies are looked at again, each by itself.

    A frame at which it then dies is not whole, and another process goes on behind it.
    """
    whole: list[int] = []
    damage, count, first, singly_to = "", 0, 0, 0
    while True:
        try:
            for answer in _answers({"run": str(run), "first": first, "singly_to": singly_to}):
                count = answer.get("count", count)
                if "frames" in answer:
                    start, first = answer["frames"]
                    damage = damage or answer["damage"]
                    if not answer["damage"]:
                        whole += range(start, first)
            return Rescue(count, whole, damage)
        except RepairProcessFailed as failure:
            if first >= count:
                raise RecordingError(f"{run}: nothing can be rescued: {failure}") from failure
            if first < singly_to:
                damage = damage or str(failure)
                first += 1
            else:
                singly_to = first + TOGETHER


def _answers(job: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """What the process says about a job.

    Raises:
        RepairProcessFailed: it crashed, or said nothing for too long.
        RecordingError: it could not do its job.
    """
    with TemporaryFile() as errors:
        child = subprocess.Popen(
            [*PYTHON, "-m", "taichisoft_plugins.recording.repair_process", json.dumps(job)],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        assert child.stdout is not None
        lines: queue.Queue[str] = queue.Queue()
        reader = threading.Thread(target=_put_lines, args=(child.stdout, lines), daemon=True)
        reader.start()
        try:
            while line := lines.get(timeout=LONGEST_SILENCE):
                answer = json.loads(line)
                if "error" in answer:
                    raise RecordingError(answer["error"])
                yield answer
            exit_code = child.wait()
        except queue.Empty:
            raise RepairProcessFailed(f"no frame within {LONGEST_SILENCE:g} s") from None
        finally:
            child.kill()
            child.wait()
            reader.join()
            child.stdout.close()
        errors.seek(0)
        if problem := how_it_ended(exit_code, errors.read()):
            raise RepairProcessFailed(problem)


def _put_lines(stream: IO[str], lines: "queue.Queue[str]") -> None:
    """Every line as soon as it comes, and an empty one at the end."""
    for line in stream:
        lines.put(line)
    lines.put("")
