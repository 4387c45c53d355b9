"""Frames and pictures of a recording, drawn in a child process that can neither hang nor crash the caller."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import TaichisoftError
from taichisoft.running.interruption import deferred_signals
from taichisoft_plugins.doctor.system_libraries import install_line, packages_for
from taichisoft_plugins.drawing.drawer import check_style
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import read_recording
from taichisoft_plugins.rendering.frame_process import FrameProcess

START_LIMIT = 60.0
"""For the start of Open3D on a busy machine [s]; usually 3."""
LOOK_LIMIT = 0.1
"""More for each frame of a recording [s]: all are looked at before the first is drawn."""
FRAME_LIMIT = 10.0
"""For a frame of a million pixels on a busy machine [s]; usually 0.2."""
ATTEMPTS = 2


class RenderError(TaichisoftError):
    """Pictures cannot be drawn."""


def render_pictures(recording: Path, times: dict[str, float], folder: Path, style: Style | None = None) -> list[Path]:
    """Draw the frames nearest to the times and return the paths `folder/NAME.png`.

    Args:
        recording: path of the recording.
        times: [s] by name of the picture, since the last start.
        folder: made when it does not exist.
        style: how they are drawn; all seen by a camera that suits them all.

    Raises:
        RecordingError: the recording is missing or unreadable, or ends before one of the times.
        StyleError: the style does not fit the recording.
        RenderError: drawing failed twice, and the message says what to install; or a picture cannot be written.
        KeyboardInterrupt: Ctrl and c, or SIGTERM.
    """
    style = style or Style()
    with read_recording(recording) as opened:
        check_style(opened, style)
        names: dict[int, list[str]] = {}
        for name, time in times.items():
            names.setdefault(opened.frame_at(time), []).append(name)
    frames = sorted(names)
    unwritten = iter(frames)

    def write(image: np.ndarray) -> None:
        for name in names[next(unwritten)]:
            write_png(image, folder / f"{name}.png")

    make_folder(folder)
    with deferred_signals() as stop_if_asked:
        draw_frames(recording, style, frames, write, stop_if_asked)
    return [folder / f"{name}.png" for name in times]


def draw_frames(
    recording: Path,
    style: Style,
    frames: Sequence[int],
    take: Callable[[np.ndarray], None],
    stop_if_asked: Callable[[], None],
) -> None:
    """Draw frames one after the other; a process that hangs or crashes is replaced once, and the new one goes on.

    Args:
        recording: path of the recording.
        style: how they are drawn.
        frames: indices without repetitions.
        take: is given each image, shape (height, width, 3), dtype uint8.
        stop_if_asked: called at least every tenth of a second; may raise.

    Raises:
        RenderError: it failed again, or cannot succeed; says what to install if that could help.
    """
    width, height = style.size
    job = {"recording": str(recording), "style": _plain(style), "frames": [int(frame) for frame in frames]}
    start_limit = START_LIMIT + LOOK_LIMIT * len(frames)
    frame_limit = FRAME_LIMIT * max(1.0, width * height / 1e6)
    done = 0
    for attempt in range(1, ATTEMPTS + 1):
        limit = start_limit + frame_limit
        with FrameProcess({**job, "first": done}, (height, width, 3)) as process:
            while done < len(frames):
                image = process.next_frame(limit, stop_if_asked)
                if image is None:
                    break
                take(image)
                done += 1
                limit = frame_limit
        if done == len(frames):
            return
        if process.refused:
            raise RenderError(process.problem)
        if attempt < ATTEMPTS:
            stopped = f"drawing stopped after {done} of {len(frames)} frames: {process.problem}"
            warnings.warn(f"{stopped}; going on in a new process", stacklevel=2)
    raise RenderError(
        f"{recording}: cannot be drawn: {process.problem}; off-screen drawing needs Mesa's libraries "
        f"({install_line(packages_for(process.problem, 'open3d'))}); `taichisoft doctor` checks them"
    )


def write_png(image: np.ndarray, path: Path) -> None:
    """Write an image, shape (height, width, 3), dtype uint8.

    Raises:
        RenderError: the file cannot be written.
    """
    from PIL import Image

    with atomic_file(path, RenderError) as partial:
        Image.fromarray(image).save(partial, format="PNG")


def make_folder(folder: Path) -> None:
    """Make a folder for results, and those above it.

    Raises:
        RenderError: that is not possible.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"{folder}: cannot be made: {error.strerror or error}") from error


def _plain(style: Style) -> dict[str, Any]:
    """As JSON has it."""
    return {key: str(value) if isinstance(value, Path) else value for key, value in asdict(style).items()}
