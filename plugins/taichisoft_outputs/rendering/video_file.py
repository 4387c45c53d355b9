"""Writing videos: MP4 or GIF by ffmpeg, or a folder of PNG files; whole under their names, or not there at all."""

import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from taichisoft.atomic_file import atomic_file, named_os_errors, partial_path
from taichisoft.child_process import last_line
from taichisoft_outputs.rendering.render import RenderError, write_png

FRAME_NAME = re.compile(r"frame_\d{5,}\.png")
FASTEST = {".mp4": 240.0, ".gif": 50.0, "": 1e6}
"""Highest rate by suffix [1/s]: browsers play a faster GIF at a tenth of its speed."""
END_LIMIT = 120.0
"""Time that ffmpeg has to finish a file after its last frame [s]; usually it takes less than 1."""

# Players take a video whose colours are not described for BT.601 or BT.709 by its size; the index at the front lets
# browsers begin before they have all of it.
MP4 = (
    "-vf scale=out_color_matrix=bt709:out_range=tv,setparams=color_primaries=bt709:color_trc=bt709 "
    "-c:v libx264 -preset veryfast -crf 18 -pix_fmt yuv420p -movflags +faststart -f mp4"
)
# 256 colours of its own for every frame: one palette for all needs all frames in memory first.
GIF = "-vf split[a][b];[a]palettegen=stats_mode=single[p];[b][p]paletteuse=new=1:dither=sierra2_4a -loop 0 -f gif"
OPTIONS = {".mp4": MP4, ".gif": GIF}

AddFrame = Callable[[np.ndarray], None]
"""Adds a frame, shape (height, width, 3), dtype uint8, to a video."""


def check_video(path: Path, fps: float) -> None:
    """Check that a video can have this name and rate, before anything is computed for it.

    Raises:
        RenderError: it cannot; the message says what would be valid.
    """
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
def open_video(path: Path, size: tuple[int, int], fps: float) -> Iterator[AddFrame]:
    """Write a video; it gets its name at the end of the `with` statement, and nothing is left when that fails.

    Args:
        path: "NAME.mp4", "NAME.gif", or a folder that gets `frame_00000.png` and so on.
        size: width and height of the frames [pixels].
        fps: frames per second.

    Raises:
        RenderError: the video cannot be written.
    """
    check_video(path, fps)
    with named_os_errors(path, RenderError):
        path.parent.mkdir(parents=True, exist_ok=True)
    if not path.suffix:
        with _frame_folder(path) as add_frame:
            yield add_frame
    else:
        with atomic_file(path, RenderError) as partial, _encoder(partial, path, size, fps) as add_frame:
            yield add_frame


def ffmpeg_program() -> str:
    """Path of ffmpeg: that of $IMAGEIO_FFMPEG_EXE, the one that imageio-ffmpeg brings, or the system's.

    Raises:
        RenderError: there is none; the message says how to get it.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        raise RenderError(
            "no ffmpeg, which writes videos: pip install imageio-ffmpeg, or set IMAGEIO_FFMPEG_EXE to one; "
            "a folder of PNG files needs none"
        ) from error


@contextmanager
def _encoder(file: Path, path: Path, size: tuple[int, int], fps: float) -> Iterator[AddFrame]:
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
        frames = process.stdin
        assert frames is not None

        def add_frame(image: np.ndarray) -> None:
            padded = np.pad(image, ((0, missing[1]), (0, missing[0]), (0, 0)), mode="edge")
            frames.write(np.ascontiguousarray(padded).data)

        try:
            yield add_frame
            frames.close()
            problem = f"exit code {process.returncode}" if process.wait(END_LIMIT) else ""
        except BrokenPipeError:
            problem = "it stopped reading"
        except subprocess.TimeoutExpired:
            problem = f"it did not finish within {END_LIMIT:g} s"
        finally:
            process.kill()
            process.wait()
            with suppress(OSError):  # what it did not read
                frames.close()
        if problem:
            log.seek(0)
            said = re.sub(r"^\[.*?\] *", "", last_line(log.read()))  # without its part's name and address
            raise RenderError(f"{path}: ffmpeg failed: {said or problem}")


@contextmanager
def _frame_folder(path: Path) -> Iterator[AddFrame]:
    """A folder beside `path` that takes its place at the end."""
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
    """Refuse to replace anything but an earlier video."""
    if not path.is_dir():
        raise RenderError(f"{path}: is a file; a video ends with .mp4 or .gif, or is a folder for PNG files")
    for entry in path.iterdir():
        if not FRAME_NAME.fullmatch(entry.name):
            raise RenderError(f"{path}: has '{entry.name}', which is not a frame of a video; name another folder")
