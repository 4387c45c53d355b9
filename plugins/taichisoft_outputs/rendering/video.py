"""Videos of a recording: which frames they show, drawing them into a file, and how far that is."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rich
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from taichisoft.interruption import deferred_signals
from taichisoft_outputs.drawing.style import FPS, Style
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.rendering.render import RenderError, draw_frames
from taichisoft_outputs.rendering.video_file import check_video, open_video


def render_video(
    recording: Path,
    file: Path,
    style: Style | None = None,
    fps: float = FPS,
    slow_motion: float = 1.0,
    on_frame: Callable[[int, int], None] | None = None,
) -> int:
    """Draw a recording from its last start to its end into a video, and return the number of its frames.

    A frame that is shown several times, because fewer were recorded, is drawn once.

    Args:
        recording: path of the recording.
        file: "NAME.mp4", "NAME.gif", or a folder for PNG files.
        style: how frames are drawn.
        fps: frames per second.
        slow_motion: factor by which things move slower than in reality [-]; below 1 they are faster.
        on_frame: is called with the number of frames that are written, and of all frames.

    Raises:
        RecordingError: the recording is missing or unreadable.
        StyleError: the style does not fit the recording.
        RenderError: the name, the rate or the slow motion is impossible; drawing failed twice, and the message says
            what to install; or the file cannot be written.
        KeyboardInterrupt: Ctrl and c, SIGTERM or a hang-up.
    """
    style = style or Style()
    check_video(file, fps)
    check_slow_motion(slow_motion)
    with read_recording(recording) as opened:
        style.check(opened.scene)
        shown = video_frames(opened, fps * slow_motion)
    drawn, repetitions = np.unique(shown, return_counts=True)
    times = iter(repetitions)
    written = 0

    def write(image: np.ndarray) -> None:
        nonlocal written
        for _ in range(next(times)):
            add_frame(image)
            written += 1
        if on_frame is not None:
            on_frame(written, len(shown))

    with deferred_signals() as stop_if_asked, open_video(file, style.size, fps) as add_frame:
        draw_frames(recording, style, drawn.tolist(), write, stop_if_asked)
        stop_if_asked()
    return written


def check_slow_motion(factor: float) -> None:
    """Check that things can be shown so many times slower.

    Raises:
        RenderError: they cannot.
    """
    if not 0.0 < factor < math.inf:
        raise RenderError(f"slow motion {factor:g}: must be positive; 4 is four times slower than in reality")


def video_frames(recording: Recording, rate: float) -> np.ndarray:
    """The recorded frames nearest to the moments that a video shows, from the last start to the very end.

    Args:
        recording: an open recording.
        rate: number of moments per simulated second [1/s].

    Returns:
        Frame indices that never fall, shape (moment_count,).
    """
    first = recording.last_start
    times = recording.times[first:]
    count = math.ceil((times[-1] - times[0]) * rate - 1e-6) + 1
    moments = np.minimum(times[0] + np.arange(count) / rate, times[-1])
    after = np.searchsorted(times, moments).clip(1, max(len(times) - 1, 1))
    if len(times) == 1:
        return np.full(count, first)
    # In the middle between two it is always the earlier one, whatever rounding says: motion stays even.
    nearer_before = moments - times[after - 1] <= times[after] - moments + 1e-9
    return first + after - nearer_before


@contextmanager
def frame_progress(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on the terminal; the function that is yielded is an `on_frame` of `render_video`."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("frames"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=rich.get_console()) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
