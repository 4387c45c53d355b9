"""Arrows in a picture: contact forces where they act, axes of bodies, and the scene's axes in a corner.

Arrows are painted over everything, so that none is hidden.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.meshes import SectionPlane
from taichisoft_outputs.drawing.camera import PictureCamera, project
from taichisoft_outputs.drawing.painting import Colour, paint_arrow, paint_text
from taichisoft_outputs.drawing.scales import round_down, sample_frames
from taichisoft_outputs.recording.reader import Recording

FORCE_COLOURS: tuple[Colour, ...] = ((0.86, 0.27, 0.05), (1.00, 0.86, 0.20), (0.10, 0.75, 0.85))
"""Red, green and blue of force arrows [-]; the later ones are for scenes in which the first one would not be seen."""
SEEN = 0.45
"""Least distance of the colour of arrows from the colours behind them [-]."""
LONGEST = 0.5
"""Length of the arrow of the strongest force, in radii of the scene [-]."""
SAMPLES = 200
"""Number of frames, at most, in which the strongest force is looked for."""
FORCE_WIDTH, AXIS_WIDTH = 1 / 220, 1 / 180
"""Width of an arrow's shaft, in heights of the picture [-]."""

AXIS_COLOURS: tuple[Colour, ...] = ((0.80, 0.16, 0.16), (0.13, 0.55, 0.20), (0.16, 0.32, 0.80))
"""Red, green and blue of the axes x, y and z [-]."""
ON_DARK: tuple[Colour, ...] = ((0.95, 0.35, 0.30), (0.35, 0.78, 0.40), (0.42, 0.58, 1.00))
"""The same on a dark background."""
BODY_AXIS = 0.25
"""Length of the arrows at bodies, in radii of the scene [-]."""


class ForceArrows:
    """Arrows of contact forces, of one scale over all frames: twice the force is twice the length.

    Args:
        recording: the recording, which stays open.
        frames: all frames that will be drawn.
        radius: radius of the scene [mm].
        behind: red, green and blue [-] of what may be behind the arrows.
        length: length of the arrows [mm/mN]; that which suits the strongest force when it is not given.

    Attributes:
        length: length of the arrows [mm/mN]; 0 where no force is shown.
        tails: where arrows begin [mm], shape (count, 3), for a camera that is to see them whole.
    """

    def __init__(
        self,
        recording: Recording,
        frames: Sequence[int],
        radius: float,
        behind: Sequence[np.ndarray] = (),
        length: float | None = None,
    ):
        self._recording = recording
        self._colour = arrow_colour(behind)
        contacts = [recording.contacts(frame) for frame in sample_frames(frames, SAMPLES)]
        self._strongest = max((float(np.linalg.norm(f, axis=1).max(initial=0.0)) for _, f in contacts), default=0.0)
        own = LONGEST * radius / self._strongest if self._strongest else 0.0
        self.length = own if length is None else length
        self.tails = np.concatenate([np.zeros((0, 3)), *(point - self.length * force for point, force in contacts)])

    def paint(self, picture: Any, camera: PictureCamera, frame: int, section: SectionPlane | None) -> None:
        """Paint a frame's arrows, which end where the forces act, into a Pillow image; none that is cut off."""
        if self._strongest:
            points, forces = self._recording.contacts(frame)
            if section is not None:
                kept = section.facing(camera.eye).height(points) <= 0.0
                points, forces = points[kept], forces[kept]
            _paint_arrows(picture, camera, points - self.length * forces, points, FORCE_WIDTH, [self._colour])

    def paint_scale(self, picture: Any, camera: PictureCamera, ink: Colour, letters: float) -> None:
        """Paint an arrow of a round force in the lower right corner, as long as it is in the middle of the scene.

        Args:
            picture: a Pillow image in RGB, which is changed.
            camera: the camera that sees the arrows.
            ink: colour of the text.
            letters: height of the letters [pixels].
        """
        if not self._strongest:
            return
        force = round_down(self._strongest)
        apart = camera.target + self.length * force * camera.axes[0]
        pixels, _ = project(camera, np.array([camera.target, apart]), picture.size)
        height = picture.height
        tip = np.array([picture.width - 0.03 * height, height - 0.04 * height])
        paint_arrow(picture, tip - [pixels[1, 0] - pixels[0, 0], 0], tip, FORCE_WIDTH * height, self._colour)
        paint_text(picture, (tip[0], tip[1] - 0.02 * height), f"force {force:g} mN", letters, ink, "rs")


def arrow_colour(behind: Sequence[np.ndarray]) -> Colour:
    """The first of FORCE_COLOURS that is seen before all of these colours, else the one that is seen best."""

    def nearest(colour: Colour) -> float:
        return min((float(np.linalg.norm(np.array(colour) - one)) for one in behind), default=np.inf)

    return next((colour for colour in FORCE_COLOURS if nearest(colour) >= SEEN), max(FORCE_COLOURS, key=nearest))


def paint_axes(picture: Any, camera: PictureCamera, colours: Sequence[Colour], letters: float) -> None:
    """Paint the directions of x, y and z, as the camera sees them, into the lower left corner of a Pillow image."""
    height = picture.height
    origin = np.array([0.1 * height, 0.9 * height])
    right, above, backward = camera.axes
    # The one that points away is painted first.
    for axis in np.argsort(backward):
        direction = np.array([right[axis], -above[axis]])
        length = np.linalg.norm(direction)
        if length > 0.1:
            paint_arrow(picture, origin, origin + 0.065 * height * direction, AXIS_WIDTH * height, colours[axis])
        # An axis that points at the viewer, or away, has its name beside the origin.
        outward = direction / length if length > 0.3 else np.array([-0.7, 0.7])
        label = origin + (0.065 * length + 0.017) * height * outward
        paint_text(picture, (label[0], label[1]), "xyz"[axis], letters, colours[axis], "mm")


def paint_body_axes(
    picture: Any, camera: PictureCamera, axes: np.ndarray, radius: float, colours: Sequence[Colour]
) -> None:
    """Paint the axes of bodies into a Pillow image.

    Args:
        picture: a Pillow image in RGB, which is changed.
        camera: the camera that sees the axes.
        axes: origin [mm] and unit vectors along x, y and z of each body, shape (count, 4, 3).
        radius: radius of the scene [mm].
        colours: colours of x, y and z.
    """
    origins = np.repeat(axes[:, 0], 3, axis=0)
    ends = origins + BODY_AXIS * radius * axes[:, 1:].reshape(-1, 3)
    _paint_arrows(picture, camera, origins, ends, AXIS_WIDTH, colours)


def _paint_arrows(
    picture: Any, camera: PictureCamera, tails: np.ndarray, tips: np.ndarray, width: float, colours: Sequence[Colour]
) -> None:
    """Paint arrows between points [mm], shape (count, 3), in turns of the colours, the farthest first."""
    tail_pixels, tail_distance = project(camera, tails, picture.size)
    tip_pixels, distance = project(camera, tips, picture.size)
    before_camera = np.minimum(distance, tail_distance) > 1.0
    long_enough = np.linalg.norm(tip_pixels - tail_pixels, axis=1) > 1.0
    for index in np.argsort(-distance):
        if before_camera[index] and long_enough[index]:
            colour = colours[index % len(colours)]
            paint_arrow(picture, tail_pixels[index], tip_pixels[index], width * picture.height, colour)
