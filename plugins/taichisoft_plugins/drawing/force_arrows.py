"""Contact forces as arrows that end where they act; they are painted over everything, so that none is hidden."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft_plugins.drawing.camera import Camera, project
from taichisoft_plugins.drawing.painting import Colour, arrow_outline, paint_polygon, paint_text
from taichisoft_plugins.drawing.scales import round_down, sample_frames
from taichisoft_plugins.recording.reader import Recording

COLOURS: tuple[Colour, ...] = ((0.86, 0.27, 0.05), (1.00, 0.86, 0.20), (0.10, 0.75, 0.85))
"""Red, green and blue of the arrows [-]; the later ones are for scenes in which the first one would not be seen."""
SEEN = 0.45
"""Least distance of that colour from those behind it [-]."""
LONGEST = 0.5
"""Length of the arrow of the strongest force, in radii of the scene [-]."""
SAMPLES = 200
"""Number of frames, at most, in which the strongest force is looked for."""
WIDTH = 1 / 220
"""Width of an arrow's shaft, in heights of the picture [-]."""


class ForceArrows:
    """Arrows of one scale over all frames: twice the force is twice the length.

    Args:
        recording: the recording, which stays open.
        frames: all frames that will be drawn.
        radius: radius of the scene [mm].
        behind: red, green and blue [-] of what may be behind the arrows.
    """

    def __init__(self, recording: Recording, frames: Sequence[int], radius: float, behind: Sequence[np.ndarray] = ()):
        self._recording = recording
        self._colour = arrow_colour(behind)
        forces = (recording.contacts(frame)[1] for frame in sample_frames(frames, SAMPLES))
        self._strongest = max((float(np.linalg.norm(force, axis=1).max(initial=0.0)) for force in forces), default=0)
        self._length = LONGEST * radius / self._strongest if self._strongest else 0.0  # [mm/mN]

    def paint(self, picture: Any, camera: Camera, frame: int) -> None:
        """Paint a frame's arrows into a Pillow image."""
        if not self._strongest:
            return
        points, forces = self._recording.contacts(frame)
        tips, distance = project(camera, points, picture.size)
        tails, tail_distance = project(camera, points - self._length * forces, picture.size)
        before_camera = np.minimum(distance, tail_distance) > 1.0
        for index in np.argsort(-distance):
            if before_camera[index] and np.linalg.norm(tips[index] - tails[index]) > 1.0:
                paint_polygon(picture, arrow_outline(tails[index], tips[index], WIDTH * picture.height), self._colour)

    def paint_scale(self, picture: Any, camera: Camera, ink: Colour) -> None:
        """Paint an arrow of a round force in the lower right corner, as long as it is in the middle of the scene."""
        if not self._strongest:
            return
        force = round_down(self._strongest)
        apart = camera.target + self._length * force * camera.axes[0]
        pixels, _ = project(camera, np.array([camera.target, apart]), picture.size)
        length = pixels[1, 0] - pixels[0, 0]
        height = picture.height
        tip = np.array([picture.width - 0.03 * height, height - 0.04 * height])
        paint_polygon(picture, arrow_outline(tip - [length, 0], tip, WIDTH * height), self._colour)
        text = f"force {force:g} mN"
        paint_text(picture, (tip[0], tip[1] - 0.02 * height), text, height / 40, ink, "rs")


def arrow_colour(behind: Sequence[np.ndarray]) -> Colour:
    """The first of COLOURS that is seen before all of these colours, else the one that is seen best."""

    def nearest(colour: Colour) -> float:
        return min((float(np.linalg.norm(np.array(colour) - one)) for one in behind), default=np.inf)

    return next((colour for colour in COLOURS if nearest(colour) >= SEEN), max(COLOURS, key=nearest))
