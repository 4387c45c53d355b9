"""Pictures and videos of a recording: the instants that they show, drawn into files."""

import math
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import numpy as np
import rich

from taichisoft.base import (
    Worker,
    WorkerLost,
    atomic_file,
    deferred_signals,
    last_line,
    named_os_errors,
    partial_path,
    require,
    warn_caller,
)
from taichisoft.errors import TaichisoftError
from taichisoft.running import progress_bar
from taichisoft_outputs.drawing.style import FPS, Style
from taichisoft_outputs.recording.reader import Recording, read_recording
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.run_figures import last_at_rest
from taichisoft_outputs.system_libraries import install_line, packages_for

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State

# Pictures of instants of a recording, drawn in a worker process that can neither hang nor crash the caller.

START_LIMIT = 300.0
"""Time that Open3D has to start on a busy machine [s]; usually it takes 3."""
LOOK_LIMIT = 0.1
"""Further time for each instant of a recording [s]: all are looked at before the first is drawn."""
PICTURE_LIMIT = 60.0
"""Time that a picture of a million pixels may take on a busy machine [s]; usually it takes 0.2."""
ATTEMPTS = 2
AHEAD = 2
"""Pictures that are requested before they are taken: one is drawn while another is written."""
PICTURES_PER_PROCESS = 250
"""Pictures after which another process takes over: Open3D 0.20 with Mesa 22.3 keeps 2.4 MB of each."""
BETWEEN_LOOKS = 0.1
"""Time between two looks whether everything shall stop [s]."""
WORKER = "taichisoft_outputs.rendering.live_renderer:draw_frames"


class RenderError(TaichisoftError):
    """Pictures cannot be drawn."""


def render_pictures(recording: Path, times: dict[str, float], folder: Path, style: Style | None = None) -> list[Path]:
    """Draw the instants nearest to the times and return the paths `folder/NAME.png`.

    Args:
        recording: path of the recording.
        times: times since the last start [s] by the name of the picture.
        folder: folder of the pictures, which is made when it does not exist.
        style: how they are drawn; one camera suits them all.

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
            names.setdefault(opened.instant_at(time), []).append(name)
    instants = sorted(names)
    unwritten = iter(instants)

    def write(image: np.ndarray) -> None:
        for name in names[next(unwritten)]:
            write_png(image, folder / f"{name}.png")

    with named_os_errors(folder, RenderError):
        folder.mkdir(parents=True, exist_ok=True)
    with deferred_signals() as stop_if_asked:
        draw_frames(recording, style, instants, write, stop_if_asked)
    return [folder / f"{name}.png" for name in times]


def record_state(folder: Path, model: "Model", state: "State") -> Path:
    """Write a recording of a single state, for the processes that draw, and return its path."""
    recording = RecordingOutput(folder)
    recording.begin(model, state)
    recording.end("picture")
    return recording.path


def how_to_draw(problem: str) -> str:
    """A problem of drawing, and what to install."""
    install = install_line(packages_for(problem, "open3d"))
    return f"{problem}; off-screen drawing needs Mesa's libraries ({install}); `taichisoft doctor` checks them"


def require_open3d() -> None:
    """Raise PackageMissing unless Open3D is there, without importing it."""
    require("a picture", "open3d")


def key_moments(recording: Recording) -> dict[str, float]:
    """Times [s] of the pictures of a run: before, grasped (the last moment before the base rises), lifted.

    Where the base does not move there are only before and after.
    """
    times = recording.times[recording.last_start :]
    if last_at_rest(recording.base_translation[recording.last_start :]) is None:
        return {"before": float(times[0]), "after": float(times[-1])}
    grasped = recording.times[recording.lift_start]
    return {"before": float(times[0]), "grasped": float(grasped), "lifted": float(times[-1])}


def draw_frames(
    recording: Path,
    style: Style,
    instants: Sequence[int],
    take: Callable[[np.ndarray], None],
    stop_if_asked: Callable[[], None],
) -> None:
    """Draw instants one after the other; a process that hangs or crashes is replaced once, and the new one goes on.

    Args:
        instants: indices without repetitions.
        take: is called with each image, shape (height, width, 3), dtype uint8.
        stop_if_asked: is called at least every tenth of a second, and may raise.
    """
    require_open3d()
    start_limit = START_LIMIT + LOOK_LIMIT * len(instants)
    picture_limit = PICTURE_LIMIT * max(1.0, style.size[0] * style.size[1] / 1e6)
    done = failures = 0
    while done < len(instants):
        stretch = instants[done : done + PICTURES_PER_PROCESS]
        limit = start_limit + picture_limit
        try:
            with Worker(WORKER) as worker:
                worker.send((recording, style, instants))
                for instant in stretch[:AHEAD]:
                    worker.send(instant)
                for number in range(len(stretch)):
                    take(_next_image(worker, limit, stop_if_asked))
                    done += 1
                    for instant in stretch[number + AHEAD : number + AHEAD + 1]:
                        worker.send(instant)
                    limit = picture_limit
        except WorkerLost as lost:
            failures += 1
            if failures == ATTEMPTS:
                raise RenderError(f"{recording}: cannot be drawn: {how_to_draw(str(lost))}") from lost
            stopped = f"drawing stopped after {done} of {len(instants)} pictures: {lost}"
            warn_caller(f"{stopped}; going on in a new process")


def _next_image(worker: Worker, time_limit: float, stop_if_asked: Callable[[], None]) -> np.ndarray:
    stop_if_asked()
    try:
        image: np.ndarray = worker.receive(time_limit, stop_if_asked, BETWEEN_LOOKS)
    except TaichisoftError as error:
        raise RenderError(str(error)) from error
    return image


def write_png(image: np.ndarray, path: Path) -> None:
    """Write an image, shape (height, width, 3), dtype uint8."""
    from PIL import Image

    with atomic_file(path, RenderError) as partial:
        Image.fromarray(image).save(partial, format="PNG")


# Writing videos: MP4 or GIF by ffmpeg, or a folder of PNG files; whole under their names, or not there at all.

FRAME_NAME = re.compile(r"frame_\d{5,}\.png")
FASTEST = {".mp4": 240.0, ".gif": 50.0, "": 1e6}
"""Highest rate by suffix [1/s]: browsers play a faster GIF at a tenth of its speed."""
END_LIMIT = 120.0
"""Time that ffmpeg has to finish a file after its last picture [s]; usually it takes less than 1."""

# Players take a video whose colours are not described for BT.601 or BT.709 by its size; the index at the front lets
# browsers begin before they have all of it.
MP4 = (
    "-vf scale=out_color_matrix=bt709:out_range=tv,setparams=color_primaries=bt709:color_trc=bt709 "
    "-c:v libx264 -preset veryfast -crf 18 -pix_fmt yuv420p -movflags +faststart -f mp4"
)
# 256 colours of its own for every picture: one palette for all needs all pictures in memory first.
GIF = "-vf split[a][b];[a]palettegen=stats_mode=single[p];[b][p]paletteuse=new=1:dither=sierra2_4a -loop 0 -f gif"
OPTIONS = {".mp4": MP4, ".gif": GIF}

AddPicture = Callable[[np.ndarray], None]
"""Adds a picture, shape (height, width, 3), dtype uint8, to a video."""


def check_video(path: Path, fps: float) -> None:
    """Check that a video can have this name and rate, before anything is computed for it."""
    fastest = FASTEST.get(path.suffix.lower())
    if fastest is None:
        raise RenderError(f"{path}: a video ends with .mp4 or .gif, or is a folder for PNG files, without a suffix")
    if not 0.0 < fps <= fastest:
        raise RenderError(f"{path}: {fps:g} frames per second; must be above 0 and at most {fastest:g}")
    if path.suffix:
        if path.is_dir():
            raise RenderError(f"{path}: is a folder; name a file")
    elif path.exists():
        _check_frame_folder(path)


@contextmanager
def open_video(path: Path, size: tuple[int, int], fps: float) -> Iterator[AddPicture]:
    """Write a video; it gets its name at the end of the `with` statement, and nothing is left when that fails.

    Args:
        path: "NAME.mp4", "NAME.gif", or a folder that gets `frame_00000.png` and so on.
    """
    check_video(path, fps)
    with named_os_errors(path, RenderError):
        path.parent.mkdir(parents=True, exist_ok=True)
    if not path.suffix:
        with _frame_folder(path) as add_picture:
            yield add_picture
    else:
        with atomic_file(path, RenderError) as partial, _encoder(partial, path, size, fps) as add_picture:
            yield add_picture


def ffmpeg_program() -> str:
    """Path of ffmpeg: that of $IMAGEIO_FFMPEG_EXE, the one that imageio-ffmpeg brings, or the system's."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise RenderError(
            "no ffmpeg, which writes videos: pip install imageio-ffmpeg, or set IMAGEIO_FFMPEG_EXE to one; "
            "a folder of PNG files needs none"
        ) from error


@contextmanager
def _encoder(file: Path, path: Path, size: tuple[int, int], fps: float) -> Iterator[AddPicture]:
    """ffmpeg at work on `file`, which is to become `path`."""
    suffix = path.suffix.lower()
    # H.264 wants even sides, so that an odd one's last row or column comes twice.
    missing = [side % 2 if suffix == ".mp4" else 0 for side in size]
    width, height = size[0] + missing[0], size[1] + missing[1]
    source = f"-f rawvideo -pix_fmt rgb24 -video_size {width}x{height} -framerate {fps:g} -i pipe:0".split()
    command = [ffmpeg_program(), "-hide_banner", "-loglevel", "error", "-nostdin", "-y", *source]
    command += [*OPTIONS[suffix].split(), str(file)]
    with TemporaryFile() as log:
        try:
            # In a session of its own it does not hear the terminal's Ctrl and c.
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log, start_new_session=True
            )
        except OSError as error:
            raise RenderError(f"{command[0]}: ffmpeg cannot be started: {error.strerror or error}") from error
        stream = process.stdin
        assert stream is not None

        def add_picture(image: np.ndarray) -> None:
            padded = np.pad(image, ((0, missing[1]), (0, missing[0]), (0, 0)), mode="edge")
            stream.write(np.ascontiguousarray(padded).data)

        try:
            yield add_picture
            stream.close()
            problem = f"exit code {process.returncode}" if process.wait(END_LIMIT) else ""
        except BrokenPipeError:
            problem = "it stopped reading"
        except subprocess.TimeoutExpired:
            problem = f"it did not finish within {END_LIMIT:g} s"
        finally:
            process.kill()
            process.wait()
            with suppress(OSError):  # what it did not read
                stream.close()
        if problem:
            log.seek(0)
            said = re.sub(r"^\[.*?\] *", "", last_line(log.read()))  # without its part's name and address
            raise RenderError(f"{path}: ffmpeg failed: {said or problem}")


@contextmanager
def _frame_folder(path: Path) -> Iterator[AddPicture]:
    partial = partial_path(path)
    numbers = count()
    try:
        with named_os_errors(path, RenderError):
            partial.mkdir()
            yield lambda image: write_png(image, partial / f"frame_{next(numbers):05d}.png")
            if path.exists():
                _check_frame_folder(path)
                shutil.rmtree(path)
            partial.replace(path)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _check_frame_folder(path: Path) -> None:
    if not path.is_dir():
        raise RenderError(f"{path}: is a file; a video ends with .mp4 or .gif, or is a folder for PNG files")
    for entry in path.iterdir():
        if not FRAME_NAME.fullmatch(entry.name):
            raise RenderError(f"{path}: has '{entry.name}', which is not a frame of a video; name another folder")


# Videos of a recording: which instants they show, drawing them into a file, and how far that is.


def render_video(
    recording: Path,
    file: Path,
    style: Style | None = None,
    fps: float = FPS,
    slow_motion: float = 1.0,
    on_picture: Callable[[int, int], None] | None = None,
) -> int:
    """Draw a recording from its last start to its end into a video, and return the number of its pictures.

    An instant that is shown several times, because fewer were recorded, is drawn once.

    Args:
        recording: path of the recording.
        file: "NAME.mp4", "NAME.gif", or a folder for PNG files.
        style: how they are drawn.
        fps: frames per second.
        slow_motion: factor by which things move slower than in reality [-]; below 1 they are faster.
        on_picture: is called with the number of pictures that are written, and of all pictures.

    Raises:
        RecordingError: the recording is missing or unreadable.
        StyleError: the style does not fit the recording.
        RenderError: the name, the rate or the slow motion is impossible; drawing failed twice, and the message says
            what to install; or the file cannot be written.
        KeyboardInterrupt: Ctrl and c, SIGTERM or a hang-up.
    """
    style = style or Style()
    check_video(file, fps)
    if style.transparent and file.suffix:
        raise RenderError(f"{file}: a transparent video is a folder for PNG files, without a suffix")
    check_slow_motion(slow_motion)
    with read_recording(recording) as opened:
        style.check(opened.scene)
        shown = shown_instants(opened, fps * slow_motion)
    drawn, repetitions = np.unique(shown, return_counts=True)
    times = iter(repetitions)
    written = 0

    def write(image: np.ndarray) -> None:
        nonlocal written
        for _ in range(next(times)):
            add_picture(image)
            written += 1
        if on_picture is not None:
            on_picture(written, len(shown))

    with deferred_signals() as stop_if_asked, open_video(file, style.size, fps) as add_picture:
        draw_frames(recording, style, drawn.tolist(), write, stop_if_asked)
        stop_if_asked()
    return written


def check_slow_motion(factor: float) -> None:
    """Check that things can be shown so many times slower."""
    if not 0.0 < factor < math.inf:
        raise RenderError(f"slow motion {factor:g}: must be positive; 4 is four times slower than in reality")


def shown_instants(recording: Recording, rate: float) -> np.ndarray:
    """The recorded instants nearest to the moments that a video shows, from the last start to the very end.

    Args:
        rate: number of moments per simulated second [1/s].

    Returns:
        Indices that never fall, shape (moment_count,).
    """
    first = recording.last_start
    times = recording.times[first:]
    count = math.ceil((times[-1] - times[0]) * rate - 1e-6) + 1
    moments = np.minimum(times[0] + np.arange(count) / rate, times[-1])
    # In the middle between two it is always the earlier one, whatever rounding says: motion stays even.
    return first + np.searchsorted((times[1:] + times[:-1]) / 2 + 5e-10, moments)


@contextmanager
def picture_progress(title: str) -> Iterator[Callable[[int, int], None]]:
    """Show how many are drawn; the function that is yielded is an `on_picture` of `render_video`."""
    with progress_bar(rich.get_console(), title, unit="pictures") as count:
        yield lambda done, total: count(completed=done, total=total)
