"""Recordings beside each other: at the same times, from the same place, with the same bars, each with its name."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft_outputs.drawing.camera import fit_camera
from taichisoft_outputs.drawing.camera_path import outermost_points
from taichisoft_outputs.drawing.colouring import Colouring, merged_ranges
from taichisoft_outputs.drawing.overlay import colour_bars_width, letters_of
from taichisoft_outputs.drawing.scales import ColourScale, sample_frames
from taichisoft_outputs.drawing.style import SMALLEST, Style, StyleError
from taichisoft_outputs.drawing.visual_surface import with_visual_surfaces
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.rendering.render import render_pictures, write_png
from taichisoft_outputs.rendering.video import render_video, video_frames
from taichisoft_outputs.rendering.video_file import open_video

LOOKED_AT = 40
"""Frames of each video, at most, in which is looked for what the camera has to see."""


def pictures_side_by_side(
    recordings: Sequence[Path], times: dict[str, float], folder: Path, style: Style
) -> list[Path]:
    """Draw pictures `folder/NAME.png` in which the recordings stand beside each other.

    Args:
        recordings: paths of the recordings.
        times: times since the last start [s] by the name of the picture; a run that ends earlier shows its end.
        folder: folder of the pictures, which is made when it does not exist.
        style: how the frames are drawn; its size is that of the whole picture.

    Raises: what `render_pictures` raises.
    """
    moments = {path: _times_within(path, times) for path in recordings}
    styles = _styles(recordings, style, lambda one: [one.frame_at(time) for time in moments[one.path].values()])
    with TemporaryDirectory(prefix="taichisoft-side-by-side-") as room:
        parts = [
            render_pictures(path, moments[path], Path(room) / str(number), styles[number])
            for number, path in enumerate(recordings)
        ]
        folder.mkdir(parents=True, exist_ok=True)
        for row in zip(*parts, strict=True):
            write_png(_joined(row), folder / row[0].name)
    return [folder / f"{name}.png" for name in times]


def video_side_by_side(
    recordings: Sequence[Path],
    file: Path,
    style: Style,
    fps: float,
    slow_motion: float,
    on_frame: Callable[[int, int], None],
) -> int:
    """Draw a video in which the recordings stand beside each other; a run that ends earlier stays at its end.

    Args:
        recordings: paths of the recordings.
        file, fps, slow_motion, on_frame: as of `render_video`.
        style: how the frames are drawn; its size is that of the whole picture.

    Returns:
        The number of frames.

    Raises: what `render_video` raises.
    """
    styles = _styles(recordings, style, lambda one: np.unique(video_frames(one, fps * slow_motion)).tolist())
    with TemporaryDirectory(prefix="taichisoft-side-by-side-") as room:
        parts = []
        for number, path in enumerate(recordings):
            of_one = Path(room) / str(number)
            render_video(path, of_one, styles[number], fps, slow_motion, on_frame)
            parts.append(sorted(of_one.iterdir()))
        count = max(map(len, parts))
        with open_video(file, _joined([part[0] for part in parts]).shape[1::-1], fps) as add_frame:
            for index in range(count):
                add_frame(_joined([part[min(index, len(part) - 1)] for part in parts]))
    return count


def _times_within(path: Path, times: dict[str, float]) -> dict[str, float]:
    with read_recording(path) as recording:
        end = float(recording.times[-1])
    return {name: min(time, end) for name, time in times.items()}


def _styles(recordings: Sequence[Path], style: Style, frames: Callable[[Recording], list[int]]) -> list[Style]:
    """A style for each recording, of its share of the width, with the bars and the camera of all."""
    width = style.size[0] // len(recordings)
    if width < SMALLEST:
        raise StyleError(f"size {style.size[0]}x{style.size[1]}: too narrow for {len(recordings)} recordings")
    own = replace(style, size=(width, style.size[1]))
    ranges, points, up = [], [], np.zeros(3)
    scales: list[ColourScale] = []
    for path in recordings:
        with read_recording(path) as recording:
            own.check(recording.scene)
            shown, surfaces = frames(recording), with_visual_surfaces(recording, style.surface)
            colouring = Colouring(recording, own, shown, surfaces)
            ranges.append(colouring.ranges)
            scales += colouring.scales
            points.append(outermost_points(surfaces, sample_frames(shown, LOOKED_AT)))
            up = recording.scene.up
    own = replace(own, ranges=merged_ranges(ranges))
    if own.eye is None and own.view in (None, "iso", "front", "top"):
        free = max(width - 2 * colour_bars_width(scales, letters_of(own)), width / 2)
        camera = fit_camera(np.concatenate(points), up, own.view or "iso", free / style.size[1])
        own = replace(own, view=None, eye=tuple(camera.eye.tolist()), target=tuple(camera.target.tolist()))
    return [replace(own, name=name) for name in _names(recordings)]


def _names(recordings: Sequence[Path]) -> list[str]:
    """The names of the files, or of their folders where several files have one name."""
    stems = [path.stem for path in recordings]
    return stems if len(set(stems)) == len(stems) else [path.resolve().parent.name for path in recordings]


def _joined(pictures: Sequence[Path]) -> np.ndarray:
    from PIL import Image

    images = []
    for path in pictures:
        with Image.open(path) as picture:
            images.append(np.asarray(picture.convert("RGB")))
    return np.concatenate(images, axis=1)
