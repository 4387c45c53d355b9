"""The surfaces of a recording, each of which knows where it was in every frame."""

from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np

from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.meshes.surface import MappedSurface
from taichisoft_plugins.recording.recorded_bodies import RecordedPlane, RecordedSurface, numbered

Row = Callable[[str, int], np.ndarray]
"""Gives one quantity in one frame, see `Recording.row`."""


def read_surfaces(file: Any, row: Row) -> Iterator[RecordedSurface]:
    """Soft bodies with their cavities, rigid bodies, obstacles with triangles."""
    for group in numbered(file, "soft_bodies"):
        nodes = slice(*map(int, group.attrs["nodes"]))
        yield _soft_surface(group.attrs["name"], "soft", nodes, group["surface"], row)
        for cavity in numbered(group, "cavities"):
            yield _soft_surface(cavity.attrs["name"], "cavity", nodes, cavity, row)
    for body, group in enumerate(numbered(file, "rigid_bodies")):
        yield _rigid_surface(group, body, row)
    for group in numbered(file, "obstacles"):
        if "vertices" in group:
            yield _obstacle_surface(group)


def read_planes(file: Any) -> Iterator[RecordedPlane]:
    """The obstacles without triangles."""
    for group in numbered(file, "obstacles"):
        if "point" in group.attrs:
            yield RecordedPlane(group.attrs["name"], group.attrs["point"], group.attrs["normal"])


def _soft_surface(name: str, kind: Literal["soft", "cavity"], nodes: slice, group: Any, row: Row) -> RecordedSurface:
    surface = MappedSurface(group["nodes"][:], group["weights"][:], group["triangles"][:])

    def vertices(frame: int) -> np.ndarray:
        return surface.positions(row("position", frame)[nodes])

    return RecordedSurface(name, kind, surface.triangles, vertices)


def _rigid_surface(group: Any, body: int, row: Row) -> RecordedSurface:
    in_body_frame = group["vertices"][:]

    def vertices(frame: int) -> np.ndarray:
        rotation = matrices_from_quaternions(row("rigid_rotation", frame)[body : body + 1])[0]
        return in_body_frame @ rotation.T + row("rigid_position", frame)[body]

    return RecordedSurface(group.attrs["name"], "rigid", group["triangles"][:], vertices)


def _obstacle_surface(group: Any) -> RecordedSurface:
    vertices = group["vertices"][:]
    return RecordedSurface(group.attrs["name"], "obstacle", group["triangles"][:], lambda frame: vertices)
