"""The three-dimensional part of a page: bodies, cavities and cables inside them, floor, arrows for contact forces."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.scenes.colours import red_green_blue
from taichisoft.scenes.scene import Scene
from taichisoft_plugins.drawing.camera import VERTICAL_ANGLE, Camera, fit_camera, radius_around_mean
from taichisoft_plugins.drawing.planes import square_of_plane
from taichisoft_plugins.drawing.scales import LINE, ColourScale
from taichisoft_plugins.drawing.scene_colours import body_colours
from taichisoft_plugins.web.creases import split_creases
from taichisoft_plugins.web.frame import Frame, PageScene

LENGTH_UNIT = 0.01
"""Units of the page in a millimetre: its lights, shadows and camera are made for things of a few units."""

ASPECT = 1.3
"""Width / height of the part of a window that the panel leaves free."""

BACKWARD = 1.35
"""The camera begins so many times further off than the first frame needs, since everything is going to move [-]."""

COLOURS: dict[str, tuple[int, int, int]] = {
    "soft": (237, 229, 216),
    "cavity": (0, 118, 128),
    "rigid": (58, 92, 168),
    "obstacle": (140, 148, 158),
    "floor": (173, 190, 208),
    "force": (204, 51, 17),
}
"""Red, green and blue by kind, each from 0 to 255, of what has no colour of its own in the scene."""
SILICONE_OPACITY = 0.55

CABLE_THICKNESS = 0.013
"""Thickness of cables, in radii of the scene [-]; they are thinner, but would not be seen."""
ARROW_LENGTH = 0.35
"""Length of the arrow of the largest force so far, in radii of the scene [-]; the others are in proportion."""
SMALLEST_ARROW = 0.03
"""Forces below this part of the largest one so far are not drawn [-]."""


class SceneView:
    """Draws frames into the scene of a viser server; what did not move is not sent again."""

    def __init__(self, server: Any, content: PageScene, first: Frame):
        """Put everything where the first frame has it, and the camera where it sees that."""
        self._server = server
        self._largest_force = self._lowest_tension = self._highest_tension = 0.0
        bodies = [v for s, v in zip(content.surfaces, first.vertices, strict=True) if s.kind in ("soft", "rigid")]
        points = np.vstack(bodies) if bodies else np.vstack([np.zeros((1, 3)), *first.vertices])
        points = np.vstack([points, first.cable_lines.reshape(-1, 3)])
        self._radius = max(radius_around_mean(points), 1.0)
        server.scene.set_up_direction(content.scene.up)
        server.scene.configure_default_lights(enabled=True, cast_shadow=True)
        self._set_camera(points, content.scene)
        self._set_background(content.scene.appearance.background)
        self._own_colours = body_colours(content.scene)
        self._sources, self._meshes = [], []
        for surface, vertices in zip(content.surfaces, first.vertices, strict=True):
            source, triangles = split_creases(vertices, surface.triangles)
            self._sources.append(source)
            self._meshes.append(self._add(surface.name, vertices[source], triangles, surface.kind))
        for plane in content.planes:
            self._add(plane.name, *square_of_plane(plane, points, []), "floor")
        self._cables = self._add_cables(first.cable_lines) if content.cables else None
        self._arrows = server.scene.add_arrows(
            "/contact forces",
            np.zeros((1, 2, 3)),
            COLOURS["force"],
            shaft_radius=0.009 * self._radius * LENGTH_UNIT,
            head_radius=0.024 * self._radius * LENGTH_UNIT,
            head_length=0.06 * self._radius * LENGTH_UNIT,
            visible=False,
        )

    def show(self, frame: Frame) -> None:
        """Move everything to where a frame has it."""
        with self._server.atomic():
            for mesh, source, vertices in zip(self._meshes, self._sources, frame.vertices, strict=True):
                mesh.vertices = (vertices[source] * LENGTH_UNIT).astype(np.float32)
            self._show_cables(frame.cable_lines, frame.cable_tensions)
            self._show_forces(frame.contact_points, frame.contact_forces)

    def _show_cables(self, lines: np.ndarray, tensions: np.ndarray) -> None:
        """Colours reach from no tension to the largest one so far."""
        if self._cables is None:
            return
        self._lowest_tension = min(self._lowest_tension, tensions.min())
        self._highest_tension = max(self._highest_tension, tensions.max())
        self._cables.points = (lines * LENGTH_UNIT).astype(np.float32)
        if self._highest_tension > self._lowest_tension:
            scale = ColourScale("", self._lowest_tension, self._highest_tension, LINE)
            colours = np.rint(255 * scale.colours(tensions)).astype(np.uint8)
            self._cables.colors = np.repeat(colours[:, None], 2, axis=1)

    def _show_forces(self, points: np.ndarray, forces: np.ndarray) -> None:
        """Each arrow ends where its force acts: its shaft stands in the first body, which is translucent if soft."""
        strength = np.linalg.norm(forces, axis=1)
        self._largest_force = max(self._largest_force, strength.max(initial=0.0))
        drawn = strength > SMALLEST_ARROW * self._largest_force
        self._arrows.visible = bool(drawn.any())
        if drawn.any():
            shafts = forces[drawn] * (ARROW_LENGTH * self._radius / self._largest_force)
            ends = np.stack([points[drawn] - shafts, points[drawn]], axis=1)
            self._arrows.points = (ends * LENGTH_UNIT).astype(np.float32)

    def _add(self, name: str, vertices: np.ndarray, triangles: np.ndarray, kind: str) -> Any:
        own = self._own_colours.get(name)
        return self._server.scene.add_mesh_simple(
            f"/{name}",
            vertices * LENGTH_UNIT,
            triangles,
            color=COLOURS[kind] if own is None else _bytes(own),
            opacity=SILICONE_OPACITY if kind == "soft" else None,
            cast_shadow=kind in ("soft", "rigid"),
            receive_shadow=kind in ("floor", "obstacle"),
        )

    def _add_cables(self, lines: np.ndarray) -> Any:
        return self._server.scene.add_line_segments(
            "/cable lines",
            lines * LENGTH_UNIT,
            np.tile(np.array(LINE[0]), (len(lines), 2, 1)),
            thickness=CABLE_THICKNESS * self._radius * LENGTH_UNIT,
        )

    def _set_background(self, colour: str | None) -> None:
        if colour is not None:
            # viser has no colour behind a scene, but a picture, which it stretches; JPEG would change its colour.
            pixel = np.array([[_bytes(red_green_blue(colour))]], dtype=np.uint8)
            self._server.scene.set_background_image(pixel, format="png")

    def _set_camera(self, points: np.ndarray, scene: Scene) -> None:
        camera, eye, target = fit_camera(points, scene.up, "iso", ASPECT), scene.appearance.eye, scene.appearance.target
        away = BACKWARD * (camera.eye - camera.target)
        if eye is not None:
            target_point = camera.target if target is None else np.array(target)
            camera = Camera(np.array(eye), target_point, scene.up)
            away = camera.eye - camera.target
        initial = self._server.initial_camera
        initial.position = (camera.target + away) * LENGTH_UNIT
        initial.look_at = camera.target * LENGTH_UNIT
        initial.up = camera.up
        initial.fov = float(np.radians(VERTICAL_ANGLE))


def _bytes(colour: Sequence[float] | np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (round(255 * float(part)) for part in colour)
    return red, green, blue
