"""The off-screen Open3D scene: triangles in, pictures out; its floor and shadow."""

import os
from collections.abc import Collection, Sequence

import numpy as np

from taichisoft.mechanics import Plane
from taichisoft.mesh import split_triangles
from taichisoft_outputs.drawing.camera import (
    VERTICAL_ANGLE,
    PictureCamera,
    pixel_matrix,
    radius_around_mean,
    scene_axes,
)

# Soft shadows on a plane: how much of the sun is hidden behind what stands before it.

SUN = (0.25, 0.2, 1.0)
"""Direction to the middle of the sun in the axes (right, front, up) of `camera.scene_axes`: high, so that shadows stay
near what casts them."""

SUN_RADIUS = 0.13
"""Radius of the sun, as the tangent of an angle: the edge of a shadow is twice this part of its height wide."""

RAYS = 5
"""Number of points of the sun whose light is followed; the blur hides that they are few."""

PIXELS = 256
"""Width and height of the picture of the shadows."""

Caster = tuple[np.ndarray, np.ndarray, float]
"""Vertices [mm] (vertex_count, 3), outward triangles (triangle_count, 3), and the part of the light they take [-]."""


def shadow(
    casters: Sequence[Caster], centre: np.ndarray, first: np.ndarray, second: np.ndarray, sun: np.ndarray, half: float
) -> np.ndarray:
    """The hidden part of the sun over a square of a plane.

    Args:
        casters: what stands before the plane; a later one covers an earlier one.
        first, second: unit vectors along its sides, shape (3,); first x second points to where things stand.

    Returns:
        From 0 (light) to 1 (dark), shape (PIXELS, PIXELS); columns run along `first` and rows along
        `second`, from -half to half.
    """
    from PIL import Image, ImageDraw
    from scipy.ndimage import gaussian_filter

    normal = np.cross(first, second)
    sun = sun / (sun @ normal)
    total = np.zeros((PIXELS, PIXELS))
    for ray in range(RAYS):
        angle = 2 * np.pi * ray / RAYS
        light = sun + SUN_RADIUS * (np.cos(angle) * first + np.sin(angle) * second)
        picture = Image.new("L", (PIXELS, PIXELS))
        fill = ImageDraw.Draw(picture).polygon
        for vertices, triangles, opacity in casters:
            offset = vertices - centre
            height = offset @ normal
            on_plane = offset - height[:, None] * light
            pixel = (np.stack([on_plane @ first, on_plane @ second], axis=1) / half + 1) * (PIXELS / 2)
            a, b, c = (pixel[triangles[:, k]] for k in range(3))
            facing = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) > (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
            above = height[triangles].max(axis=1) > 0
            value = round(255 * opacity)
            for corners in np.concatenate([a, b, c], axis=1)[facing & above].tolist():
                fill(corners, fill=value)
        total += np.asarray(picture)
    return gaussian_filter(total / (255 * RAYS), sigma=2.0)


# Infinite planes: which of them are floors, and slopes and walls as squares that end at the floors.

HALF_WIDTH = 2.2
"""Half the width of what is drawn of a plane, in radii of what stands before it [-]."""
LEVEL = 0.99
"""Cosine of the angle to gravity from which a plane is a floor."""


def is_floor(plane: Plane, up: np.ndarray) -> bool:
    """Whether things stand on the plane as on level ground."""
    return bool(plane.normal @ up >= LEVEL)


def reaches_under(floor: Plane, vertices: np.ndarray, far: float = 0.5) -> bool:
    """Whether one of the vertices [mm], shape (vertex_count, 3), is more than `far` [mm] under the floor."""
    return bool(((vertices - floor.point) @ floor.normal < -far).any())


def foot_of(points: np.ndarray, plane: Plane) -> np.ndarray:
    """The point of a plane under the mean of points [mm], shape (3,)."""
    middle = points.mean(axis=0)
    return middle - plane.normal * ((middle - plane.point) @ plane.normal)


def square_of_plane(
    plane: Plane, points: np.ndarray, floors: Sequence[Plane], half: float = HALF_WIDTH
) -> tuple[np.ndarray, np.ndarray]:
    """The part of a plane that is drawn.

    Args:
        floors: planes; what is under them is left out.
        half: half the width of the square, in radii of the points [-].

    Returns:
        Vertices [mm], (vertex_count, 3), and triangles, counterclockwise as seen from where the normal points.
    """
    right, front, _ = scene_axes(plane.normal)
    # Front is right x up: seen from the side of the normal, right -> back -> left turns against the clock.
    corners = np.array([right - front, -right - front, front - right, right + front])
    corners = foot_of(points, plane) + half * radius_around_mean(points) * corners
    triangles = corners[[[0, 1, 2], [0, 2, 3]]]
    for floor in floors:
        triangles, _, _ = split_triangles(triangles, (floor.point - triangles) @ floor.normal)
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


# The floor: painted behind everything else, with soft shadows, fading into the background far away.
#
# Only what is above a floor can be in a scene, so it need not take part in hiding; painting it here takes a tenth of
# the time in which the processor would draw it as triangles that fill the picture.

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
        to_shadow = np.linalg.inv(to_picture @ to_floor)
        coefficients = tuple((to_shadow / to_shadow[2, 2]).ravel()[:8])
        warped = dark_bytes.transform(size, Image.Transform.PERSPECTIVE, coefficients, Image.Resampling.BILINEAR)
        light = np.array([1 - DARKEST * value / 255 for value in range(256)], dtype=np.float32)
        shade = light[np.where(ground, np.asarray(warped), 0)]
        return np.rint(plain * shade[..., None]).astype(np.uint8)

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


# An off-screen Open3D scene: coloured triangles in, pictures out.

EMPTY = (255, 0, 255)
"""Red, green and blue where nothing stands, a colour that no surface has: other things are painted there."""
NEAREST = 0.1
"""Distance from the camera from which things are seen [mm]."""


class Stage:
    """The scene and its renderer; a process can have only one, as Open3D allows one renderer.

    Light is in the colours already (`shading`), the floor with its shadows is painted (`floor`), and edges are smoothed
    afterwards (`antialiasing`): where the processor draws, Open3D's own light, shadows and smoothing take over half a
    second a picture, and this takes a tenth of it.
    """

    def __init__(self, size: tuple[int, int]):
        # Before Open3D is imported: this is how EGL draws on a machine without a display.
        os.environ.setdefault("EGL_PLATFORM", "surfaceless")
        import open3d
        from open3d.visualization import rendering

        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        self._open3d = open3d
        self._renderer = rendering.OffscreenRenderer(*size)
        self._scene = self._renderer.scene
        self._scene.view.set_post_processing(False)
        # Open3D 0.20 smooths edges also without post-processing, and blends EMPTY into them.
        self._scene.view.set_antialiasing(False)
        self._scene.scene.enable_indirect_light(False)
        self._scene.scene.enable_sun_light(False)
        # Backgrounds are decoded from sRGB, colours of vertices are not: 0 and 1 are the same in both.
        self._scene.set_background([*(part / 255 for part in EMPTY), 1.0])
        self._material = rendering.MaterialRecord()
        self._material.shader = "defaultUnlit"
        self._names: set[str] = set()

    def put(self, name: str, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray) -> None:
        """Put triangles on the stage, in place of earlier ones of the same name.

        Both sides of a triangle are drawn; leave out triangles that are seen from behind (`seen_from_front`), of
        which single pixels would show along the outlines of a body.

        Args:
            triangles: vertex indices, counterclockwise as seen from the front, shape (triangle_count, 3).
            colours: red, green and blue of every vertex as they shall appear [-], shape (vertex_count, 3).
        """
        utility = self._open3d.utility
        mesh = self._open3d.geometry.TriangleMesh(
            utility.Vector3dVector(vertices), utility.Vector3iVector(triangles.astype(np.int32))
        )
        mesh.vertex_colors = utility.Vector3dVector(colours)
        mesh.triangle_uvs = utility.Vector2dVector(_texture_coordinates(len(triangles)))
        if name in self._names:
            self._scene.remove_geometry(name)
            self._names.remove(name)
        if not len(triangles):
            return
        self._scene.add_geometry(name, mesh, self._material)
        self._names.add(name)

    def depth(self, camera: PictureCamera, visible: Collection[str]) -> np.ndarray:
        """Distances along the optical axis [mm], infinite where nothing is, shape (height, width), dtype float32."""
        self._show(camera, visible)
        return np.array(self._renderer.render_to_depth_image(z_in_view_space=True))

    def image(self, camera: PictureCamera, visible: Collection[str]) -> np.ndarray:
        """The picture of the visible names, EMPTY where nothing is, shape (height, width, 3), dtype uint8."""
        self._show(camera, visible)
        return np.array(self._renderer.render_to_image())

    def _show(self, camera: PictureCamera, visible: Collection[str]) -> None:
        for name in self._names:
            self._scene.show_geometry(name, name in visible)
        eye, target, up = (np.asarray(v, np.float32) for v in (camera.eye, camera.target, camera.up))
        # Open3D's own far plane cuts off what is small and far from the camera.
        box = self._scene.bounding_box
        far = float(np.linalg.norm(box.get_center() - eye) + np.linalg.norm(box.get_extent()))
        self._renderer.setup_camera(VERTICAL_ANGLE, target, eye, up, NEAREST, max(NEAREST + 1.0, far))


def _texture_coordinates(triangle_count: int) -> np.ndarray:
    """Texture coordinates of the corners of all triangles, shape (3 * triangle_count, 2), although no texture is used.

    Open3D 0.20 derives tangents from them: where they are absent, or the same at two corners, these are undefined and
    the triangle is black. Corners of the same place and coordinates are joined, and their colours blended. So every
    triangle has a unit triangle of its own.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    return (corners + 2.0 * np.arange(triangle_count)[:, None, None]).reshape(-1, 2)
