"""Frames and pictures of a recording, drawn in a child process that can neither hang nor crash the caller."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from taichisoft.atomic_file import atomic_file, named_os_errors
from taichisoft.errors import TaichisoftError
from taichisoft.interruption import deferred_signals
from taichisoft_plugins.base_motion import last_at_rest
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import Recording, read_recording
from taichisoft_plugins.rendering.frame_process import FrameProcess
from taichisoft_plugins.system_libraries import install_line, packages_for

START_LIMIT = 60.0
"""Time that Open3D has to start on a busy machine [s]; usually it takes 3."""
LOOK_LIMIT = 0.1
"""Further time for each frame of a recording [s]: all are looked at before the first is drawn."""
FRAME_LIMIT = 10.0
"""Time that a frame of a million pixels may take on a busy machine [s]; usually it takes 0.2."""
ATTEMPTS = 2


class RenderError(TaichisoftError):
    """Pictures cannot be drawn."""


def render_pictures(recording: Path, times: dict[str, float], folder: Path, style: Style | None = None) -> list[Path]:
    """Draw the frames nearest to the times and return the paths `folder/NAME.png`.

    Args:
        recording: path of the recording.
        times: times since the last start [s] by the name of the picture.
        folder: folder of the pictures, which is made when it does not exist.
        style: how the frames are drawn; one camera suits them all.

    Raises:
        RecordingError: the recording is missing or unreadable, or ends before one of the times.
        StyleError: the style does not fit the recording.
        RenderError: drawing failed twice, and the message says what to install; or a picture cannot be written.
        KeyboardInterrupt: somebody pressed Ctrl and c, or sent SIGTERM.
    """
    style = style or Style()
    with read_recording(recording) as opened:
        style.check(opened.scene)
        names: dict[int, list[str]] = {}
        for name, time in times.items():
            names.setdefault(opened.frame_at(time), []).append(name)
    frames = sorted(names)
    unwritten = iter(frames)

    def write(image: np.ndarray) -> None:
        for name in names[next(unwritten)]:
            write_png(image, folder / f"{name}.png")

    with named_os_errors(folder, RenderError):
        folder.mkdir(parents=True, exist_ok=True)
    with deferred_signals() as stop_if_asked:
        draw_frames(recording, style, frames, write, stop_if_asked)
    return [folder / f"{name}.png" for name in times]


def key_moments(recording: Recording) -> dict[str, float]:
    """Times [s] of the pictures of a run: before, grasped (the last moment before the base rises), lifted.

    Where the base does not move there are only before and after.
    """
    times = recording.times[recording.last_start :]
    grasped = last_at_rest(recording.column("base_translation")[recording.last_start :])
    if grasped is None:
        return {"before": float(times[0]), "after": float(times[-1])}
    return {"before": float(times[0]), "grasped": float(times[grasped]), "lifted": float(times[-1])}


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
        style: how the frames are drawn.
        frames: frame indices without repetitions.
        take: is called with each image, shape (height, width, 3), dtype uint8.
        stop_if_asked: is called at least every tenth of a second, and may raise.

    Raises:
        RenderError: drawing failed again, or cannot succeed; the message says what to install if that could help.
    """
    width, height = style.size
    job = {"recording": str(recording), "style": asdict(style), "frames": [int(frame) for frame in frames]}
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
