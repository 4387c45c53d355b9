"""Exporting a recording to ParaView, frame by frame."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_outputs.paraview.grids import grid_makers
from taichisoft_outputs.paraview.vtu_file import write_pvd, write_vtu
from taichisoft_outputs.recording.reader import Recording


class ExportError(TaichisoftError):
    """A recording cannot be exported as asked."""


def export_vtu(recording: Recording, frames: Iterable[int], folder: Path) -> list[Path]:
    """Write a .vtu file per frame and grid, and for each grid the .pvd file that ParaView opens.

    Args:
        recording: the recording that has the frames.
        frames: indices in the order of time; an iterator may show progress.
        folder: gets "soft_bodies.pvd", "soft_bodies/00000.vtu" and so on.

    Returns:
        The .pvd files.

    Raises:
        TaichisoftError: a file cannot be written.
    """
    makers = grid_makers(recording)
    times = recording.times
    written: dict[str, list[tuple[float, Path]]] = {name: [] for name in makers}
    try:
        for frame in frames:
            for name, make in makers.items():
                path = folder / name / f"{frame:05d}.vtu"
                write_vtu(path, make(frame))
                written[name].append((float(times[frame]), path))
    finally:  # complete files can be opened also after a full disk or an interruption
        for name, files in written.items():
            write_pvd(folder / f"{name}.pvd", files)
    return [folder / f"{name}.pvd" for name in makers]


def chosen_frames(recording: Recording, every: int | None, times: Sequence[float] | None) -> list[int]:
    """Frames to export, in the order of time: the nearest to `times` [s], or each `every`-th since the last start.

    Raises:
        ExportError: both are given, or `every` is not positive.
        RecordingError: a time was not recorded.
    """
    if times:
        if every is not None:
            raise ExportError("--every and --time choose frames in two ways; give one of them")
        return sorted({recording.frame_at(time) for time in times})
    if every is not None and every < 1:
        raise ExportError(f"--every {every}: must be 1 or more; 10 takes each tenth recorded frame")
    return list(range(recording.last_start, recording.frame_count, every or 1))
