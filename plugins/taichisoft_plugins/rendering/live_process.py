"""The child process that draws one state after the other: `python -m taichisoft_plugins.rendering.live_process`.

Standard input has pickled objects: first the path of a recording of one frame and the keys of a `Style`, then for every
picture the values of a state (`live_values`), and the points that get a mark. Standard output gets the pictures, each
height x width x 3 bytes and nothing between them; the last line on standard error says what went wrong.
`live_renderer` starts it.
"""

import pickle
import sys
from pathlib import Path

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.drawing.drawer import Drawer
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import PATIENCE, LiveRecording
from taichisoft_plugins.rendering.frame_process import REFUSED
from taichisoft_plugins.rendering.render_process import claim_standard_output

ROOM = 0.4
"""Room around the first state for what moves later, in parts of its extent [-]."""


def main() -> None:
    """Draw until nobody asks for more."""
    pictures, wishes = claim_standard_output(), sys.stdin.buffer
    try:
        path, style = pickle.load(wishes)
        with LiveRecording(Path(path), PATIENCE) as recording:
            recording.show(pickle.load(wishes))
            drawer = Drawer(recording, Style(**style), [0], ROOM)
            while True:
                recording.show(pickle.load(wishes))
                pictures.write(np.ascontiguousarray(drawer.image(0, pickle.load(wishes))).data)
                pictures.flush()
    except (EOFError, BrokenPipeError):
        return
    except TaichisoftError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        sys.exit(REFUSED)
    except (ImportError, OSError, RuntimeError) as error:
        sys.exit(" ".join(str(error).split()))


if __name__ == "__main__":
    main()
