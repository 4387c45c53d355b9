"""An off-screen Open3D scene: coloured triangles in, pictures out."""

import os
from collections.abc import Collection

import numpy as np

from taichisoft_outputs.drawing.camera import VERTICAL_ANGLE, PictureCamera

EMPTY = (255, 0, 255)
"""Red, green and blue where nothing stands, a colour that no surface has: other things are painted there."""


class Stage:
    """The scene and its renderer; a process can have only one, as Open3D allows one renderer.

    Light is in the colours already (`shading`), the floor with its shadows is painted (`floor`), and edges are smoothed
    afterwards (`antialiasing`): where the processor draws, Open3D's own light, shadows and smoothing take over half a
    second a picture, and this takes a tenth of it.

    Args:
        size: width and height of the pictures [pixels].
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
            name: name of what is drawn.
            vertices: vertices [mm], shape (vertex_count, 3).
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
        # The near and far planes are taken from what stands on the stage now.
        eye, target, up = (np.asarray(v, np.float32) for v in (camera.eye, camera.target, camera.up))
        self._renderer.setup_camera(VERTICAL_ANGLE, target, eye, up)


def _texture_coordinates(triangle_count: int) -> np.ndarray:
    """Texture coordinates of the corners of all triangles, shape (3 * triangle_count, 2), although no texture is used.

    Open3D 0.20 derives tangents from them: where they are absent, or the same at two corners, these are undefined and
    the triangle is black. Corners of the same place and coordinates are joined, and their colours blended. So every
    triangle has a unit triangle of its own.
    """
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    return (corners + 2.0 * np.arange(triangle_count)[:, None, None]).reshape(-1, 2)
