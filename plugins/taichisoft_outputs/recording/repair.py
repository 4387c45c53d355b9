"""Rescuing the whole frames of a damaged recording; that of a killed run becomes an HDF5 file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichisoft_outputs.recording.finished_file import constants_image, finish
from taichisoft_outputs.recording.layout import RecordingError, group_of
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.recording.running_file import RunningFile


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


def repair(run: Path, new: Path) -> Rescue:
    """Write a new recording with every frame of `run` that is whole.

    Args:
        run: a damaged recording, or that of a killed run; it is only read.
        new: place of the new one; what is there is replaced.

    Raises:
        RecordingError: nothing can be rescued, or the new file cannot be written.
    """
    if new.resolve() == run.resolve():
        raise RecordingError(f"--output {new}: is the damaged recording; name another file")
    whole: list[int] = []
    damage, file = "", None
    with read_recording(run) as recording:
        for frame in range(recording.frame_count):
            try:
                rows = _rows(recording, frame)
            except RecordingError as error:
                damage = damage or f"frame {frame}: {error.__cause__ or error}"
                continue
            if file is None:
                constants = constants_image(recording.copy_constants)
                file = RunningFile(new, constants, rows, recording.signals)
            else:
                file.append(rows)
            whole.append(frame)
        count, outcome = recording.frame_count, recording.outcome
    if file is None:
        raise RecordingError(f"{run}: none of its {count} frames is whole: {damage}")
    file.close(outcome if len(whole) == count else f"repaired: {len(whole)} of {count} frames were whole")
    finish(new)
    return Rescue(count, whole, damage)


def _rows(recording: Recording, frame: int) -> dict[str, np.ndarray]:
    rows = recording.rows_of_frames(frame, frame + 1)
    return {path: values[0] if group_of(path) == "steps" else values for path, values in rows.items()}
