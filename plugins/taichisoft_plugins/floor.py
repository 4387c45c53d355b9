"""The floor: painted behind everything else, with soft shadows, fading into the background far away.

Only what is above a floor can be in a scene, so it need not take part in hiding; painting it here takes a tenth of the
time in which the processor would draw it as triangles that fill the picture.
"""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.camera import Camera, pixel_matrix, scene_axes
from taichisoft_plugins.recording_reader import RecordedPlane
from taichisoft_plugins.shadow import PIXELS, SUN, Thrower, shadow

SQUARE = 2.2
"""Half width of what takes shadows, in radii of what stands on the floor [-]."""
FADES = (2.5, 14.0)
"""Distances between which it fades, in the same radii [-]."""
FLOOR = 0.90
"""Brightness of the floor, as part of the background's [-]."""
DARKEST = 0.34
"""Part of the light that a full shadow takes [-]."""
COARSE = 8
"""The fading is computed for every eighth pixel [pixels]."""


class Floor:
    """A horizontal plane under the scene.

    Args:
        plane: whose normal points up.
        points: what must stand on it [mm], shape (point_count, 3).
        background: its colour, red, green and blue [-], shape (3,).
    """

    def __init__(self, plane: RecordedPlane, points: np.ndarray, background: np.ndarray):
        middle = points.mean(axis=0)
        self._radius = np.linalg.norm(points - middle, axis=1).max()
        self._centre = middle - plane.normal * ((middle - plane.point) @ plane.normal)
        self._normal = plane.normal
        axes = scene_axes(plane.normal)
        self._sun = np.array(SUN) @ axes
        # In this order the first and the second axis have the normal as their cross product.
        self._axes = axes[[1, 0]]
        self._background = background
        self._plain: tuple[Camera, np.ndarray, np.ndarray] | None = None

    def paint(self, picture: np.ndarray, camera: Camera, throwers: Sequence[Thrower]) -> np.ndarray:
        """The picture with the floor over it, as far as the camera stands above the floor.

        Args:
            picture: shape (height, width, 3), dtype uint8.
            camera: sees it.
            throwers: what throws shadows.
        """
        from PIL import Image

        if (camera.eye - self._centre) @ self._normal <= 0:
            return picture
        height, width, _ = picture.shape
        to_floor = np.linalg.inv(pixel_matrix(camera, self._centre, self._axes, (width, height)))
        plain, ground = self._without_shadows(camera, to_floor, (width, height))
        half = SQUARE * self._radius
        dark = shadow(throwers, self._centre, self._axes[0], self._axes[1], self._sun, half)
        to_pixels = np.array([[1 / half, 0, 1], [0, 1 / half, 1], [0, 0, 2 / PIXELS]]) * PIXELS / 2 @ to_floor
        warped = Image.fromarray(np.rint(255 * dark).astype(np.uint8)).transform(
            (width, height),
            Image.Transform.PERSPECTIVE,
            tuple((to_pixels / to_pixels[2, 2]).ravel()[:8]),
            Image.Resampling.BILINEAR,
        )
        picture = np.rint(plain).astype(np.uint8)
        box = warped.getbbox()
        if box is not None:
            part = np.s_[box[1] : box[3], box[0] : box[2]]
            light = np.array([1 - DARKEST * value / 255 for value in range(256)], dtype=np.float32)
            shade = light[np.where(ground[part], np.asarray(warped)[part], 0)]
            picture[part] = np.rint(plain[part] * shade[..., None])
        return picture

    def _without_shadows(
        self, camera: Camera, to_floor: np.ndarray, size: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Colours, shape (height, width, 3), and where the floor is and not the sky, shape (height, width)."""
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
        whole = (COARSE * len(columns), COARSE * len(rows))
        fine = np.asarray(Image.fromarray(floor.astype(np.float32)).resize(whole, Image.Resampling.BILINEAR))
        part = fine[:height, :width, None]
        plain = (255 * self._background * (1 - (1 - FLOOR) * part)).astype(np.float32)
        self._plain = camera, plain, part[..., 0] > 0
        return self._plain[1:]
