"""The process that reads a damaged recording for `repair`: one job as JSON, answers as lines of JSON.

`python -m taichisoft_plugins.recording.repair_process JOB`
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.recording.checksums import CHECKSUMS
from taichisoft_plugins.recording.file import RecordingFile
from taichisoft_plugins.recording.layout import RecordingError
from taichisoft_plugins.recording.reader import Recording, read_recording
from taichisoft_plugins.recording.repair import TOGETHER
from taichisoft_plugins.recording.still_file import StillFile

OF_FRAMES = ("steps", "contacts", "frames", "outcome", CHECKSUMS)
"""What a recording has beside what does not change."""


def main() -> None:
    """Do the job of the command line; what goes wrong is an answer, too."""
    job = json.loads(sys.argv[1])
    try:
        with read_recording(job["run"], patience=0.0) as recording:
            _ = recording.soft_bodies  # without the bodies frames are of no use
            if "new" in job:
                copy_frames(recording, Path(job["new"]), job["frames"], job["of"])
            else:
                look_at_frames(recording, job["first"], job["singly_to"])
    except TaichisoftError as error:
        answer(error=str(error))


def answer(**values: Any) -> None:
    """Say something."""
    print(json.dumps(values), flush=True)


def look_at_frames(recording: Recording, first: int, singly_to: int) -> None:
    """Say of the frames from `first` on what is wrong with them: of all in a bundle together where nothing is.

    Those up to `singly_to` are read one by one.
    """
    answer(count=recording.frame_count)
    start = first
    while start < recording.frame_count:
        end = start + 1 if start < singly_to else min(start + TOGETHER, recording.frame_count)
        damage = _damage(recording, start, end)
        if damage and end - start > 1:
            singly_to = end
        else:
            answer(frames=[start, end], damage=damage)
            start = end


def _damage(recording: Recording, first: int, end: int) -> str:
    """What is wrong with some frames; empty where they are whole."""
    try:
        recording.rows_of_frames(first, end)
    except RecordingError as error:
        return str(error)
    return ""


def copy_frames(recording: Recording, new: Path, frames: Sequence[int], count: int) -> None:
    """Write these frames of the recording's `count` into a new one."""
    import h5py

    still = StillFile(recording.path)
    with still, h5py.File(still, "r") as source:

        def describe(root: Any) -> None:
            root.attrs.update(source.attrs)
            for group in ("steps", "contacts"):
                root.require_group(group).attrs.update(source[group].attrs)
            for name in source:
                if name not in OF_FRAMES:
                    source.copy(name, root)

        packed = any(dataset.compression for dataset in source["steps"].values())
        file = RecordingFile(new, describe, _rows(recording, frames[:1]), packed)
        for start in range(1, len(frames), TOGETHER):
            file.append(_rows(recording, frames[start : start + TOGETHER], file.contact_count))
            answer(written=start)
        whole = len(frames) == count
        file.close(recording.outcome if whole else f"repaired: {len(frames)} of {count} frames were whole")


def _rows(recording: Recording, frames: Sequence[int], first_contact: int = 0) -> dict[str, np.ndarray]:
    """The rows of some frames, one frame's after the other's."""
    gaps = np.flatnonzero(np.diff(frames) != 1) + 1
    found = [recording.rows_of_frames(run[0], run[-1] + 1) for run in np.split(np.array(frames), gaps)]
    joined = {path: np.concatenate([rows[path] for rows in found]) for path in found[0]}
    count = joined["steps/contact_count"]
    joined["steps/contact_offset"] = first_contact + np.cumsum(count) - count
    return joined


if __name__ == "__main__":
    main()
