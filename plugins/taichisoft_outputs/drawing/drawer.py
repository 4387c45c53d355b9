"""Drawing the frames of a recording."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies import Plane
from taichisoft.meshes import SectionPlane
from taichisoft_outputs.drawing.antialiasing import antialias
from taichisoft_outputs.drawing.cable_tubes import line_tubes
from taichisoft_outputs.drawing.camera import PictureCamera, focal_length, radius_around_mean
from taichisoft_outputs.drawing.camera_path import camera_path, followed_part, outermost_points
from taichisoft_outputs.drawing.colouring import PLAIN, Colouring, at_vertices, body_colours
from taichisoft_outputs.drawing.floor import Floor
from taichisoft_outputs.drawing.overlay import Overlay, colour_bars_width, letters_of
from taichisoft_outputs.drawing.planes import is_floor, reaches_under, square_of_plane
from taichisoft_outputs.drawing.section import cut_open, refuse_what_cuts_nothing
from taichisoft_outputs.drawing.shading import key_light
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.drawing.surface_painter import SurfacePainter
from taichisoft_outputs.drawing.visual_surface import with_visual_surfaces
from taichisoft_outputs.recording.reader import Recording

SHADOW_OPACITY = {"soft": 0.55, "rigid": 1.0, "obstacle": 1.0}
"""Part of the light that a kind of surface takes from what is behind it [-]; silicone lets some through."""

NO_POINTS = np.zeros((0, 3))


class Drawer:
    """Draws frames of a recording as its style says; a process can have only one.

    Args:
        recording: the recording, which stays open as long as frames are drawn.
        style: what the user chose.
        frames: all frames that will be drawn, in order: the camera and the ranges of the colours suit them all.
        room: room around what these frames show, in parts of its extent [-]: for more frames, which are not known yet.

    Raises:
        StyleError: the style does not fit the recording.
        MeshError: the style's surface file is missing or unreadable.
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int], room: float = 0.0):
        style.check(recording.scene)
        style = style.for_scene(recording.scene)
        width, height = style.size
        up = recording.scene.up
        self._scene, self._planes = recording.scene, recording.planes
        self._surfaces = [*with_visual_surfaces(recording, style.surface), *line_tubes(recording, frames[0])]
        if style.colour_by != "none":  # a sheet would hide the colours of what it lies on
            self._surfaces = [surface for surface in self._surfaces if surface.kind != "membrane"]
        points = outermost_points(self._surfaces, frames)
        self._section = SectionPlane.parse(style.section) if style.section else None
        if style.section and not room:
            obstacles = [surface.vertices(frames[0]) for surface in self._surfaces if surface.kind == "obstacle"]
            refuse_what_cuts_nothing(style.section, np.concatenate([points, *obstacles]))
        self._colouring = Colouring(recording, style, frames, self._surfaces)
        self._overlay = Overlay(recording, style, frames, self._colouring.scales, radius_around_mean(points))
        side = colour_bars_width(self._colouring.scales, letters_of(style)) if style.bars else 0.0
        aspect = max(width - 2 * side, width / 2) / height
        spread = np.concatenate([points + room * (points - points.mean(axis=0)), self._overlay.arrow_tails])
        followed = followed_part(recording, self._surfaces, style.followed) if style.followed is not None else None
        self._camera = camera_path(style, frames, spread, up, aspect, followed)
        background = np.array(style.background_colour)
        self._background = np.empty((height, width, 3), dtype=np.uint8)
        self._background[:] = np.rint(255 * background)
        # Of several floors only the highest can be seen: they are infinite.
        floors = sorted(
            (plane for plane in recording.planes if is_floor(plane, up)), key=lambda plane: plane.point @ up
        )
        own = body_colours(recording.scene)
        light, self._shadows = recording.scene.appearance.light, recording.scene.appearance.shadows
        self._floor = Floor(floors[-1], points, background, own.get(floors[-1].name), light) if floors else None
        self._walls = [
            (plane.name, *square_of_plane(plane, points, floors))
            for plane in recording.planes
            if not is_floor(plane, up)
        ]
        self._wall_colours = {name: own.get(name, np.array(PLAIN["obstacle"])) for name, _, _ in self._walls}
        triangles = {surface.name: surface.triangles for surface in self._surfaces}
        triangles |= {name: of_wall for name, _, of_wall in self._walls}
        soft = [surface.name for surface in self._surfaces if surface.kind == "soft"]
        light_from = key_light(recording.scene)
        unlit, scale = self._colouring.unlit, self._colouring.values_scale
        self._painter = SurfacePainter(style.size, triangles, soft, style.soft_opacity, light_from, up, unlit, scale)
        self._recording = recording
        self._hide_what_is_under(floors[-1:], points)

    def measure(self, frame: int, camera: PictureCamera) -> tuple[np.ndarray, np.ndarray]:
        """Depth [mm] and number of the body that each pixel of a camera sees, see `SurfacePainter.measure`.

        Bodies are numbered as in the model: soft ones, rigid ones, obstacles; a plane is seen from its upper side.
        """
        scene, planes = self._scene, self._planes
        names = [*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles]
        solid = {s.name: s for s in self._surfaces if s.kind in SHADOW_OPACITY and s.name in names}
        vertices = {name: surface.vertices(frame) for name, surface in solid.items()}
        depth, number = self._painter.measure(camera, vertices, {name: names.index(name) for name in solid})
        right, up, backward = camera.axes
        height, width = depth.shape
        x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        ahead = (x[..., None] * right - y[..., None] * up) / focal_length(height) - backward
        for plane in planes:
            towards = ahead @ plane.normal
            with np.errstate(divide="ignore"):
                distance = np.where(towards < 0.0, (plane.point - camera.eye) @ plane.normal / towards, np.inf)
            is_seen = (distance > 0.0) & (distance < depth)
            depth = np.where(is_seen, distance, depth).astype(np.float32)
            number = np.where(is_seen, names.index(plane.name), number)
        return depth, number

    def image(self, frame: int, marks: np.ndarray = NO_POINTS, camera: PictureCamera | None = None) -> np.ndarray:
        """The picture of one of the frames, with marks at points [mm]; shape (height, width, 3), dtype uint8.

        `camera` replaces that of the style.
        """
        camera = self._camera(frame) if camera is None else camera
        vertices = {surface.name: surface.vertices(frame) for surface in self._surfaces}
        picture = self._background
        if self._floor is not None:
            casters = [
                (vertices[surface.name], surface.triangles, SHADOW_OPACITY[surface.kind])
                for surface in self._surfaces
                if self._shadows and surface.kind in SHADOW_OPACITY
            ]
            picture = self._floor.paint(picture, camera, casters)
        colours, values = self._colouring.colours(frame), self._colouring.values(frame)
        for surface in self._surfaces:
            if values is not None and surface.kind == "soft" and surface.mapping is not None:
                colours[surface.name] = at_vertices(surface.mapping, values)[:, None]
        for name, corners, _ in self._walls:
            vertices[name], colours[name] = corners, self._wall_colours[name]
        section = None
        if self._section is not None:
            section = cut_open(self._recording, self._surfaces, frame, self._section.facing(camera.eye), values)
        picture = self._painter.paint(picture, camera, vertices, colours, section)
        return self._overlay.paint(antialias(picture), camera, frame, marks)

    def _hide_what_is_under(self, floors: Sequence[Plane], points: np.ndarray) -> None:
        """Cut off what reaches under a floor, which is painted behind everything; mostly nothing does."""
        for floor in floors:
            obstacles = [surface.vertices(0) for surface in self._surfaces if surface.kind == "obstacle"]
            if any(reaches_under(floor, vertices) for vertices in obstacles):
                self._painter.hide_behind(floor.name, *square_of_plane(floor, points, [], half=20.0))
