"""Frames and pictures of a recording, drawn in a worker process that can neither hang nor crash the caller."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from taichisoft.atomic_file import atomic_file, named_os_errors
from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import TaichisoftError
from taichisoft.interruption import deferred_signals
from taichisoft.optional_packages import require
from taichisoft.worker import Worker, WorkerLost
from taichisoft_outputs.base_motion import last_at_rest
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.system_libraries import install_line, packages_for

START_LIMIT = 300.0
"""Time that Open3D has to start on a busy machine [s]; usually it takes 3."""
LOOK_LIMIT = 0.1
"""Further time for each frame of a recording [s]: all are looked at before the first is drawn."""
FRAME_LIMIT = 60.0
"""Time that a frame of a million pixels may take on a busy machine [s]; usually it takes 0.2."""
ATTEMPTS = 2
AHEAD = 2
"""Frames that are asked for before they are taken: one is drawn while another is written."""
FRAMES_PER_PROCESS = 250
"""Frames after which another process takes over: Open3D 0.20 with Mesa 22.3 keeps 2.4 MB of every frame drawn."""
BETWEEN_LOOKS = 0.1
"""Time between two looks whether everything shall stop [s]."""
WORKER = "taichisoft_outputs.rendering.draw_process:draw_frames"


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
        KeyboardInterrupt: Ctrl and c, SIGTERM or a hang-up.
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


def require_open3d() -> None:
    """Raise PackageMissing unless Open3D is there, without importing it."""
    require("a picture", "open3d")


def key_moments(recording: Recording) -> dict[str, float]:
    """Times [s] of the pictures of a run: before, grasped (the last moment before the base rises), lifted.

    Where the base does not move there are only before and after.
    """
    times = recording.times[recording.last_start :]
    grasped = last_at_rest(recording.base_translation[recording.last_start :])
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
    require_open3d()
    start_limit = START_LIMIT + LOOK_LIMIT * len(frames)
    frame_limit = FRAME_LIMIT * max(1.0, style.size[0] * style.size[1] / 1e6)
    done = failures = 0
    while done < len(frames):
        stretch = frames[done : done + FRAMES_PER_PROCESS]
        limit = start_limit + frame_limit
        try:
            with Worker(WORKER) as worker:
                worker.send((recording, style, frames))
                for frame in stretch[:AHEAD]:
                    worker.send(frame)
                for number in range(len(stretch)):
                    take(_next_image(worker, limit, stop_if_asked))
                    done += 1
                    for frame in stretch[number + AHEAD : number + AHEAD + 1]:
                        worker.send(frame)
                    limit = frame_limit
        except WorkerLost as lost:
            failures += 1
            if failures == ATTEMPTS:
                raise RenderError(
                    f"{recording}: cannot be drawn: {lost}; off-screen drawing needs Mesa's libraries "
                    f"({install_line(packages_for(str(lost), 'open3d'))}); `taichisoft doctor` checks them"
                ) from lost
            stopped = f"drawing stopped after {done} of {len(frames)} frames: {lost}"
            warn_caller(f"{stopped}; going on in a new process")


def _next_image(worker: Worker, time_limit: float, stop_if_asked: Callable[[], None]) -> np.ndarray:
    stop_if_asked()
    try:
        image: np.ndarray = worker.receive(time_limit, stop_if_asked, BETWEEN_LOOKS)
    except TaichisoftError as error:
        raise RenderError(str(error)) from error
    return image


def write_png(image: np.ndarray, path: Path) -> None:
    """Write an image, shape (height, width, 3), dtype uint8.

    Raises:
        RenderError: the file cannot be written.
    """
    from PIL import Image

    with atomic_file(path, RenderError) as partial:
        Image.fromarray(image).save(partial, format="PNG")
