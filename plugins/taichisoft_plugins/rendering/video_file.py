"""Writing videos: MP4 or GIF by ffmpeg, or a folder of PNG files; whole under their names, or not there at all."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Protocol

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft_plugins.rendering.render import RenderError, make_folder, write_png

FRAME_NAME = re.compile(r"frame_\d{5,}\.png")
FASTEST = {".mp4": 240.0, ".gif": 50.0, "": 1e6}
"""Frames per second by suffix: browsers play a faster GIF at a tenth of its speed."""
END_LIMIT = 120.0
"""For ffmpeg to finish a file after its last frame [s]; usually less than 1."""

# Players take a video whose colours are not described for BT.601 or BT.709 by its size; the index at the front lets
# browsers begin before they have all of it.
MP4 = (
    "-vf scale=out_color_matrix=bt709:out_range=tv,setparams=color_primaries=bt709:color_trc=bt709 "
    "-c:v libx264 -preset veryfast -crf 18 -pix_fmt yuv420p -movflags +faststart -f mp4"
)
# 256 colours of its own for every frame: one palette for all needs all frames in memory first.
GIF = "-vf split[a][b];[a]palettegen=stats_mode=single[p];[b][p]paletteuse=new=1:dither=sierra2_4a -loop 0 -f gif"
OPTIONS = {".mp4": MP4, ".gif": GIF}


class VideoWriter(Protocol):
    """Takes the frames of a video."""

    def add(self, image: np.ndarray) -> None:
        """The next frame, shape (height, width, 3), dtype uint8."""


def check_video(path: Path, fps: float) -> None:
    """See whether a video can have this name and rate, before anything is computed for it.

    Raises:
        RenderError: it cannot; says what would be valid.
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
def open_video(path: Path, size: tuple[int, int], fps: float) -> Iterator[VideoWriter]:
    """Write a video; it gets its name at the end of the `with` statement, and nothing is left when that fails.

    Args:
        path: "NAME.mp4", "NAME.gif", or a folder that gets `frame_00000.png` and so on.
        size: width and height of the frames [pixels].
        fps: frames per second.

    Raises:
        RenderError: the video cannot be written.
    """
    check_video(path, fps)
    make_folder(path.parent)
    if not path.suffix:
        with _frame_folder(path) as folder:
            yield FrameFolder(folder)
    else:
        with atomic_file(path, RenderError) as partial, _encoder(partial, path, size, fps) as encoder:
            yield encoder


class Encoder:
    """Passes frames to ffmpeg; H.264 wants even sides, so that an odd one's last row or column comes twice."""

    def __init__(self, frames: IO[bytes], size: tuple[int, int]):
        self._frames = frames
        self._size = size

    def add(self, image: np.ndarray) -> None:
        """The next frame, shape (height, width, 3), dtype uint8."""
        missing = [(0, side - present) for side, present in zip(self._size[::-1], image.shape[:2], strict=True)]
        self._frames.write(np.ascontiguousarray(np.pad(image, [*missing, (0, 0)], mode="edge")).data)


class FrameFolder:
    """Writes each frame to a file of its own."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._count = 0

    def add(self, image: np.ndarray) -> None:
        """The next frame, shape (height, width, 3), dtype uint8."""
        write_png(image, self._folder / f"frame_{self._count:05d}.png")
        self._count += 1


def ffmpeg_program() -> str:
    """Path of ffmpeg: that of $IMAGEIO_FFMPEG_EXE, the one that imageio-ffmpeg brings, or the system's.

    Raises:
        RenderError: there is none; says how to get it.
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
def _encoder(file: Path, path: Path, size: tuple[int, int], fps: float) -> Iterator[Encoder]:
    """ffmpeg at work on `file`, which is to become `path`."""
    suffix = path.suffix.lower()
    width, height = (side + side % 2 if suffix == ".mp4" else side for side in size)
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
        assert process.stdin is not None
        try:
            yield Encoder(process.stdin, (width, height))
            process.stdin.close()
            problem = f"exit code {process.returncode}" if process.wait(END_LIMIT) else ""
        except BrokenPipeError:
            problem = "it stopped reading"
        except subprocess.TimeoutExpired:
            problem = f"it did not finish within {END_LIMIT:g} s"
        finally:
            process.kill()
            process.wait()
            with suppress(OSError):  # what it did not read
                process.stdin.close()
        if problem:
            log.seek(0)
            lines = log.read().decode(errors="replace").strip().splitlines()
            said = re.sub(r"^\[.*?\] *", "", lines[-1]) if lines else problem  # without its part's name and address
            raise RenderError(f"{path}: ffmpeg failed: {said}")


@contextmanager
def _frame_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` that takes its place at the end."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.mkdir()
        yield partial
        if path.exists():
            _check_frame_folder(path)
            shutil.rmtree(path)
        partial.replace(path)
    except OSError as failure:
        raise RenderError(f"{path}: cannot be written: {failure.strerror or failure}") from failure
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _check_frame_folder(path: Path) -> None:
    """Only an earlier video may be replaced."""
    if not path.is_dir():
        raise RenderError(f"{path}: is a file; a video ends with .mp4 or .gif, or is a folder for PNG files")
    for entry in path.iterdir():
        if not FRAME_NAME.fullmatch(entry.name):
            raise RenderError(f"{path}: has '{entry.name}', which is no frame of a video; name another folder")
