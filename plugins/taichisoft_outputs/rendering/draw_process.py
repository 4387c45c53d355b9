"""The functions of the worker processes that draw: frames of a recording, or a run's states as they come."""

from pathlib import Path

import numpy as np

from taichisoft.worker import Link
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.rendering.live_recording import LiveRecording

ROOM = 0.4
"""Room around the first state for what moves later, in parts of its extent [-]."""


def draw_frames(link: Link) -> None:
    """Draw the frames of a recording.

    The first message is its path, a `Style`, and all frames that belong together; each further one is a frame, answered
    by its image, shape (height, width, 3), dtype uint8.

    Raises:
        TaichisoftError: the recording or frame does not exist, or cannot be drawn in this style.
        OSError: Open3D finds no way to draw.
        RuntimeError: Open3D failed.
    """
    path, style, frames = link.receive()
    with read_recording(path) as recording:
        drawer = Drawer(recording, style, frames)
        while True:
            link.send(_checked(drawer.image(link.receive()), style))


def draw_states(link: Link) -> None:
    """Draw one state after the other.

    The first message is the path of a recording of one frame, a `Style`, and the values of that frame (`live_values`);
    each further one is the values of a state, the points that get a mark, and None, answered by an image as above; or
    in the place of None a camera, answered by image, depth and numbers of bodies, see `Drawer.measure`.

    Raises: what `draw_frames` raises.
    """
    path, style, first = link.receive()
    with LiveRecording(Path(path)) as recording:
        recording.show(first)
        drawer = Drawer(recording, style, [0], ROOM)
        while True:
            values, marks, camera = link.receive()
            recording.show(values)
            image = _checked(drawer.image(0, marks, camera), style)
            link.send(image if camera is None else (image, *drawer.measure(0, camera)))


def _checked(image: np.ndarray, style: Style) -> np.ndarray:
    if image.shape != (style.size[1], style.size[0], 3) or image.dtype != np.uint8:
        raise RuntimeError(f"drew {image.shape} of {image.dtype}, not {style.size} pixels")
    return np.ascontiguousarray(image)
