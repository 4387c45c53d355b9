"""Recordings beside each other: at the same times, from the same place, with one scale for all, each with its name."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft_outputs.drawing.camera import PictureCamera, fit_camera, outermost_points, radius_around_mean
from taichisoft_outputs.drawing.colouring import (
    Colouring,
    ColourScale,
    merged_ranges,
    sample_instants,
    with_ranges,
    with_visual_surfaces,
)
from taichisoft_outputs.drawing.overlay import (
    Colour,
    as_bytes,
    colour_bars_width,
    force_arrows,
    letters_of,
    paint_colour_bars,
    text_colour,
)
from taichisoft_outputs.drawing.style import SMALLEST, Style, StyleError
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.rendering.video import open_video, render_pictures, render_video, shown_instants, write_png

LOOKED_AT = 40
"""Instants of each video, at most, in which is looked for what the camera has to see."""


def pictures_side_by_side(
    recordings: Sequence[Path], times: dict[str, float], folder: Path, style: Style
) -> list[Path]:
    """Draw pictures `folder/NAME.png` in which the recordings stand beside each other.

    Args:
        times: times since the last start [s] by the name of the picture; a run that ends earlier shows its end.
        style: how they are drawn; its size is that of the whole picture.
    """
    ends = {path: _end(path) for path in recordings}
    latest = max(ends.values())  # beyond which no run has anything, as each of them says
    moments = {
        path: {name: time if time > latest else min(time, end) for name, time in times.items()}
        for path, end in ends.items()
    }
    styles, bars = _shared(recordings, style, lambda one: [one.instant_at(time) for time in moments[one.path].values()])
    with TemporaryDirectory(prefix="taichisoft-side-by-side-") as room:
        parts = [
            render_pictures(path, moments[path], Path(room) / str(number), styles[number])
            for number, path in enumerate(recordings)
        ]
        folder.mkdir(parents=True, exist_ok=True)
        for row in zip(*parts, strict=True):
            write_png(_joined(row, bars), folder / row[0].name)
    return [folder / f"{name}.png" for name in times]


def video_side_by_side(
    recordings: Sequence[Path],
    file: Path,
    style: Style,
    fps: float,
    slow_motion: float,
    on_picture: Callable[[int, int], None],
) -> int:
    """Draw a video in which the recordings stand beside each other; a run that ends earlier stays at its end.

    Args:
        file, fps, slow_motion, on_picture: as of `render_video`.
        style: how they are drawn; its size is that of the whole picture.
    """
    styles, bars = _shared(recordings, style, lambda one: np.unique(shown_instants(one, fps * slow_motion)).tolist())
    with TemporaryDirectory(prefix="taichisoft-side-by-side-") as room:
        parts = []
        for number, path in enumerate(recordings):
            of_one = Path(room) / str(number)
            render_video(path, of_one, styles[number], fps, slow_motion, on_picture)
            parts.append(sorted(of_one.iterdir()))
        count = max(map(len, parts))
        with open_video(file, _joined([part[0] for part in parts], bars).shape[1::-1], fps) as add_picture:
            for index in range(count):
                add_picture(_joined([part[min(index, len(part) - 1)] for part in parts], bars))
    return count


def _end(path: Path) -> float:
    with read_recording(path) as recording:
        return float(recording.times[-1])


def _shared(
    recordings: Sequence[Path], style: Style, instants: Callable[[Recording], list[int]]
) -> tuple[list[Style], np.ndarray]:
    """A style for each recording, with the scales of all and a camera for all, and a strip with the bars of all.

    Returns:
        The styles, each of its share of the width that the strip leaves; and the strip that stands to the right of the
        pictures, shape (height, strip_width, 3), dtype uint8, without width where colours mean nothing.
    """
    if style.transparent:
        raise StyleError("recordings side by side have a background; draw each by itself to have none")
    ranges, lengths, uprights = [], [], []
    points: dict[tuple[float, ...], list[np.ndarray]] = {}
    scales: dict[str, ColourScale] = {}
    for path in recordings:
        with read_recording(path) as recording:
            style.check(recording.scene)
            shown, surfaces = instants(recording), with_visual_surfaces(recording, style.surface)
            colouring = Colouring(recording, style, shown, surfaces)
            ranges.append(colouring.ranges)
            for scale in colouring.scales:
                if scale.names != scales.get(scale.title, scale).names:
                    raise StyleError(f"{path}: has not the same names of {scale.title} as {recordings[0]}")
            scales |= {scale.title: scale for scale in colouring.scales}
            upright = tuple(recording.scene.up.tolist())
            uprights.append(upright)
            seen = points.setdefault(upright, [])
            seen.append(outermost_points(surfaces, sample_instants(shown, LOOKED_AT)))
            if style.arrows:
                arrows = force_arrows(recording, shown, radius_around_mean(seen[-1]))
                lengths += [arrows.length] * (arrows.length > 0.0)
                seen.append(arrows.tails)
            background = style.for_scene(recording.scene).background_colour
    common = merged_ranges(ranges)
    bars = _strip_of_bars([with_ranges(scale, common) for scale in scales.values()], style, background)
    size = ((style.size[0] - bars.shape[1]) // len(recordings), style.size[1])
    if size[0] < SMALLEST:
        raise StyleError(
            f"size {style.size[0]}x{style.size[1]}: too narrow for {len(recordings)} recordings and their bars"
        )
    # The strongest force of all has the longest arrow.
    own = replace(style, size=size, ranges=common, bars=False, force_length=min(lengths, default=None))
    styles = [replace(own, name=name) for name in _names(recordings)]
    if not own.is_close_up and own.view != "orbit":
        cameras = {  # scenes with gravity in different directions have no place in common
            upright: fit_camera(np.concatenate(seen), np.array(upright), own.view or "iso", size[0] / size[1])
            for upright, seen in points.items()
        }
        styles = [_seen_by(cameras[upright], one) for one, upright in zip(styles, uprights, strict=True)]
    return styles, bars


def _seen_by(camera: PictureCamera, style: Style) -> Style:
    return replace(style, view=None, eye=tuple(camera.eye.tolist()), target=tuple(camera.target.tolist()))


def _strip_of_bars(scales: Sequence[ColourScale], style: Style, background: Colour) -> np.ndarray:
    from PIL import Image

    letters = letters_of(style)
    size = math.ceil(colour_bars_width(scales, letters)), style.size[1]
    strip = Image.new("RGB", size, as_bytes(background))
    paint_colour_bars(strip, scales, text_colour(background), letters)
    return np.asarray(strip)


def _names(recordings: Sequence[Path]) -> list[str]:
    """The names of the files, or of their folders where several files have one name."""
    stems = [path.stem for path in recordings]
    return stems if len(set(stems)) == len(stems) else [path.resolve().parent.name for path in recordings]


def _joined(pictures: Sequence[Path], bars: np.ndarray) -> np.ndarray:
    from PIL import Image

    images = []
    for path in pictures:
        with Image.open(path) as picture:
            images.append(np.asarray(picture.convert("RGB")))
    return np.concatenate([*images, bars], axis=1)
