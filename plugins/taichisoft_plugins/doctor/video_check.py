"""Writes a tiny video, to see whether this machine can: `python -m taichisoft_plugins.doctor.video_check`."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.rendering.video_file import ffmpeg_program, open_video

SIZE = (64, 36)


def main() -> None:
    """Print ffmpeg's version; exit code 0 when an MP4 was written."""
    try:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "video.mp4"
            with open_video(path, SIZE, fps=30.0) as video:
                for level in (0, 100, 200):
                    video.add(np.full((SIZE[1], SIZE[0], 3), level, np.uint8))
            if not path.stat().st_size:
                sys.exit("ffmpeg wrote an empty file")
        print(version(ffmpeg_program()))
    except TaichisoftError as error:
        sys.exit(str(error))


def version(program: str) -> str:
    """What ffmpeg calls itself, and where it is."""
    answer = subprocess.run([program, "-version"], capture_output=True, text=True, errors="replace", timeout=20)
    words = answer.stdout.split()
    return f"{words[2] if len(words) > 2 else 'unknown version'} in {program}"


if __name__ == "__main__":
    main()
