"""The child process that draws: `python -m taichisoft_plugins.rendering.render_process`. `frame_process` starts it.

Standard input is JSON: recording (path), style (keys of `Style`), frames (all that belong together) and first (index
among them of the one to begin with). Standard output gets the frames one after the other, each height x width x 3 bytes
and nothing between them; the last line on standard error says what went wrong.
"""

import json
import os
import sys
from typing import BinaryIO

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.drawing.drawer import Drawer
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import read_recording
from taichisoft_plugins.rendering.frame_process import REFUSED


def main() -> None:
    """Draw the job; exit code 0 when all frames are written."""
    frames = claim_standard_output()
    job = json.load(sys.stdin)
    try:
        draw(job, frames)
    except TaichisoftError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        sys.exit(REFUSED)
    except (ImportError, OSError, RuntimeError) as error:
        sys.exit(" ".join(str(error).split()))


def draw(job: dict, to: BinaryIO) -> None:
    """Write the frames of a job.

    Raises:
        TaichisoftError: there is no such recording or frame, or it cannot be drawn in this style.
        OSError: nobody reads the frames any more, or Open3D finds no way to draw.
        RuntimeError: Open3D failed.
    """
    style = Style(**job["style"])
    with read_recording(job["recording"]) as recording:
        drawer = Drawer(recording, style, job["frames"])
        for frame in job["frames"][job["first"] :]:
            image = np.ascontiguousarray(drawer.image(frame))
            if image.shape != (style.size[1], style.size[0], 3) or image.dtype != np.uint8:
                raise RuntimeError(f"drew {image.shape} of {image.dtype}, not {style.size} pixels")
            to.write(image.data)
            to.flush()


def claim_standard_output() -> BinaryIO:
    """Take standard output for the frames alone: whatever else libraries print goes to standard error."""
    frames = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return frames


if __name__ == "__main__":
    main()
