"""The floor: painted behind everything else, with soft shadows, fading into the background far away.

Only what is above a floor can be in a scene, so it need not take part in hiding; painting it here takes a tenth of the
time in which the processor would draw it as triangles that fill the picture.
"""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies import Plane
from taichisoft_outputs.drawing.camera import PictureCamera, pixel_matrix, radius_around_mean, scene_axes
from taichisoft_outputs.drawing.planes import HALF_WIDTH, foot_of
from taichisoft_outputs.drawing.shadow import PIXELS, SUN, Caster, shadow

FADES = (2.5, 14.0)
"""Distances between which the floor fades, in radii of what stands on it [-]."""
BRIGHTNESS = 0.90
"""Brightness of a floor without a colour of its own, as part of the background's [-]."""
DARKEST = 0.34
"""Part of the light that a full shadow takes [-]."""
COARSE = 8
"""The fading is computed for every eighth pixel [pixels]."""


class Floor:
    """A horizontal plane under the scene.

    Args:
        plane: the plane, whose normal points up.
        points: what stands on it [mm], shape (point_count, 3).
        background: red, green and blue of the background [-], shape (3,).
        colour: red, green and blue of the floor near by [-], shape (3,); None for a darker background.
        light: direction to the light that casts shadows, of any length; None for the usual one.
    """

    def __init__(
        self,
        plane: Plane,
        points: np.ndarray,
        background: np.ndarray,
        colour: np.ndarray | None = None,
        light: Sequence[float] | None = None,
    ):
        self._radius = radius_around_mean(points)
        self._centre = foot_of(points, plane)
        self._normal = plane.normal
        axes = scene_axes(plane.normal)
        self._sun = np.array(SUN) @ axes if light is None else np.array(light)
        # In this order the first and the second axis have the normal as their cross product.
        self._axes = axes[[1, 0]]
        self._background = background
        self._colour = BRIGHTNESS * background if colour is None else colour
        self._plain: tuple[PictureCamera, np.ndarray, np.ndarray] | None = None

    def paint(self, picture: np.ndarray, camera: PictureCamera, casters: Sequence[Caster]) -> np.ndarray:
        """The picture with the floor over it, as far as the camera stands above the floor.

        Args:
            picture: the background, shape (height, width, 3), dtype uint8.
            camera: the camera that sees the floor.
            casters: what casts shadows; it casts none where the light comes from under the floor.
        """
        from PIL import Image

        if (camera.eye - self._centre) @ self._normal <= 0:
            return picture
        size = picture.shape[1], picture.shape[0]
        to_picture = pixel_matrix(camera, self._centre, self._axes, size)
        plain, ground = self._without_shadows(camera, np.linalg.inv(to_picture), size)
        if not casters or self._sun @ self._normal <= 0.0:
            return plain
        half = HALF_WIDTH * self._radius
        dark = shadow(casters, self._centre, self._axes[0], self._axes[1], self._sun, half)
        dark_bytes = Image.fromarray(np.rint(255 * dark).astype(np.uint8))
        # From pixels of the shadow's picture to coordinates on the floor.
        to_floor = np.array([[2 * half / PIXELS, 0, -half], [0, 2 * half / PIXELS, -half], [0, 0, 1]])
        box = _box(dark_bytes.getbbox(), to_picture @ to_floor, size)
        if box is None:
            return plain
        left, top, right, bottom = box
        from_box = np.array([[1, 0, left], [0, 1, top], [0, 0, 1]])
        to_shadow = np.linalg.inv(to_picture @ to_floor) @ from_box
        warped = dark_bytes.transform(
            (right - left, bottom - top),
            Image.Transform.PERSPECTIVE,
            tuple((to_shadow / to_shadow[2, 2]).ravel()[:8]),
            Image.Resampling.BILINEAR,
        )
        part = np.s_[top:bottom, left:right]
        light = np.array([1 - DARKEST * value / 255 for value in range(256)], dtype=np.float32)
        shade = light[np.where(ground[part], np.asarray(warped), 0)]
        picture = plain.copy()
        picture[part] = np.rint(plain[part] * shade[..., None])
        return picture

    def _without_shadows(
        self, camera: PictureCamera, to_floor: np.ndarray, size: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colours, shape (height, width, 3), dtype uint8, and where the floor is and not the sky, (height, width)."""
        from PIL import Image

        if self._plain is not None and self._plain[0] is camera:
            return self._plain[1:]
        width, height = size
        columns = (np.arange(width // COARSE + 1) + 0.5) * COARSE
        rows = (np.arange(height // COARSE + 1) + 0.5) * COARSE
        pixels = np.array(np.broadcast_arrays(columns, rows[:, None], 1))
        first, second, scale = np.einsum("ij,jrc->irc", to_floor, pixels)
        near, far = FADES
        distance = np.where(scale > 0, np.hypot(first, second) / np.maximum(scale, 1e-30) / self._radius, np.inf)
        floor = 1.0 - np.clip((distance - near) / (far - near), 0.0, 1.0)
        colours = self._background + floor[..., None] * (self._colour - self._background)
        coarse = np.rint(255 * colours).astype(np.uint8)
        whole = (COARSE * len(columns), COARSE * len(rows))
        fine, ground = (
            np.asarray(Image.fromarray(part).resize(whole, way))[:height, :width]
            for part, way in ((coarse, Image.Resampling.BILINEAR), (scale > 0, Image.Resampling.NEAREST))
        )
        self._plain = camera, fine, ground
        return self._plain[1:]


def _box(
    dark: tuple[int, int, int, int] | None, to_picture: np.ndarray, size: tuple[int, int]
) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom [pixels] of the part of the picture with the dark part of the shadow's picture.

    None where there is none. What reaches behind the camera may be anywhere.
    """
    if dark is None:
        return None
    left, top, right, bottom = dark
    corners = np.array([[left, top, 1], [right, top, 1], [right, bottom, 1], [left, bottom, 1]], dtype=float)
    x, y, depth = to_picture @ corners.T
    if depth.min() <= 1.0:
        return (0, 0, *size)
    low = [max(int(np.floor((part / depth).min())) - 1, 0) for part in (x, y)]
    high = [min(int(np.ceil((part / depth).max())) + 1, side) for part, side in zip((x, y), size, strict=True)]
    return (low[0], low[1], high[0], high[1]) if low[0] < high[0] and low[1] < high[1] else None
