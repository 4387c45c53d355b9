"""The child process that draws: `python -m taichisoft_plugins.render_process JOB`, where JOB is JSON.

JOB has recording (path), times ({name: seconds}), folder, size ([width, height]) and view. The last line on
standard error says what went wrong. `rendering` starts it; nothing else should.
"""

import json
import sys
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.drawing import draw_frames
from taichisoft_plugins.recording_reader import read_recording


def main() -> None:
    """Draw the job given as the only argument; exit code 0 when all pictures are written."""
    job = json.loads(sys.argv[1])
    try:
        with read_recording(job["recording"]) as recording:
            frames = {name: recording.frame_at(time) for name, time in job["times"].items()}
            draw_frames(recording, frames, Path(job["folder"]), tuple(job["size"]), job["view"])
    except (TaichisoftError, ImportError, OSError, RuntimeError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
