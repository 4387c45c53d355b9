"""An off-screen Open3D scene with the light, the floor and the materials of all our pictures."""

import os
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichisoft_plugins.camera import VERTICAL_ANGLE, Camera, scene_axes
from taichisoft_plugins.smooth_normals import split_at_creases

Look = Literal["soft", "cavity", "rigid", "obstacle", "floor", "horizon"]

BACKGROUND = (0.86, 0.90, 0.94)
COLOURS: dict[Look, tuple[float, float, float, float]] = {
    "soft": (0.93, 0.90, 0.85, 0.75),
    "cavity": (0.0, 0.36, 0.40, 1.0),
    "rigid": (0.05, 0.12, 0.35, 1.0),
    "obstacle": (0.55, 0.58, 0.62, 1.0),
    "floor": (0.62, 0.72, 0.82, 1.0),
    "horizon": (0.62, 0.72, 0.82, 1.0),
}
"""Red, green, blue and opacity [-]; the silicone is translucent so that the cavities show."""

# A cavity would stand in the shadow of the silicone around it; the light's shadow map reaches as far as
# whatever takes shadows, and over a whole horizon it would be too coarse.
SHADOWS: dict[Look, tuple[bool, bool]] = {
    "cavity": (False, False),
    "floor": (False, True),
    "horizon": (False, False),
}
"""Whether a look casts and receives shadows, where not both."""


class Stage:
    """What is drawn; a process can have only one, as Open3D allows one renderer.

    Args:
        size: width and height of the pictures [pixels].
        up: unit vector against gravity, shape (3,); the sun stands above and behind the camera.
    """

    def __init__(self, size: tuple[int, int], up: np.ndarray):
        # Before Open3D is imported: this is how EGL draws on a machine without a display.
        os.environ.setdefault("EGL_PLATFORM", "surfaceless")
        import open3d
        from open3d.visualization import rendering

        open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
        self._open3d = open3d
        self._renderer = rendering.OffscreenRenderer(*size)
        self._scene = self._renderer.scene
        self._scene.set_background([*BACKGROUND, 1.0])
        self._set_light(rendering, scene_axes(up))

    def clear(self) -> None:
        """Take everything off the stage."""
        self._scene.clear_geometry()

    def add(self, name: str, vertices: np.ndarray, triangles: np.ndarray, look: Look) -> None:
        """Put a surface on the stage: vertices [mm], (vertex_count, 3); triangles, outward, (count, 3)."""
        corners, normals = split_at_creases(vertices, triangles)
        geometry, utility = self._open3d.geometry, self._open3d.utility
        mesh = geometry.TriangleMesh(
            utility.Vector3dVector(corners),
            utility.Vector3iVector(np.arange(len(corners), dtype=np.int32).reshape(-1, 3)),
        )
        mesh.vertex_normals = utility.Vector3dVector(normals)
        self._scene.add_geometry(name, mesh, self._material(look))
        casts, receives = SHADOWS.get(look, (True, True))
        self._scene.scene.geometry_shadows(name, casts, receives)

    def image(self, camera: Camera) -> np.ndarray:
        """The picture, shape (height, width, 3), dtype uint8."""
        return np.array(self._rendered(camera))

    def draw(self, camera: Camera, path: Path) -> None:
        """Write the picture as a PNG file."""
        if not self._open3d.io.write_image(str(path), self._rendered(camera)):
            raise OSError(f"{path}: cannot be written")

    def _rendered(self, camera: Camera) -> Any:
        # The near and far planes are taken from what stands on the stage now.
        eye, target, up = (np.asarray(v, np.float32) for v in (camera.eye, camera.target, camera.up))
        self._renderer.setup_camera(VERTICAL_ANGLE, target, eye, up)
        return self._renderer.render_to_image()

    def _set_light(self, rendering: Any, axes: np.ndarray) -> None:
        right, front, up = axes
        sunshine = -(0.7 * right + 0.6 * front + 2.6 * up).astype(np.float32)
        self._scene.set_lighting(self._scene.LightingProfile.SOFT_SHADOWS, sunshine)
        self._scene.scene.set_sun_light(sunshine, [1.0, 0.98, 0.95], 110_000)
        self._scene.scene.set_indirect_light_intensity(50_000)
        view = self._scene.view
        view.set_shadowing(True, rendering.View.ShadowType.VSM)
        grading = rendering.ColorGrading
        view.set_color_grading(grading(grading.Quality.ULTRA, grading.ToneMapping.FILMIC))

    def _material(self, look: Look) -> Any:
        material = self._open3d.visualization.rendering.MaterialRecord()
        material.base_color = COLOURS[look]
        material.base_roughness = 0.95 if look in ("floor", "horizon") else 0.5
        material.has_alpha = COLOURS[look][3] < 1.0
        material.shader = "defaultLitTransparency" if material.has_alpha else "defaultLit"
        return material
