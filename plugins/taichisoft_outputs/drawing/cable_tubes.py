"""Cables, and other actuators drawn as lines, as thin tubes with a bead at each point through which they run."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS
from taichisoft_outputs.drawing.camera import radius_around_mean
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording

THICKNESS = 0.01
"""Radius of a tube, in radii of the soft bodies [-]: cables are drawn thicker than they are, so that they are seen."""
BEAD = 2.0
"""Radius of a bead, in radii of the tube [-]."""
SIDES = 10
"""Faces around a tube: few enough to draw fast, and enough that they meet at angles that are shaded smoothly."""

_TURN = 2.0 * np.pi * np.arange(SIDES) / SIDES
_RING = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


@dataclass(frozen=True)
class LineTube(RecordedSurface):
    """A tube around a line.

    Attributes:
        actuator: the kind of the actuator.
        number: its number among its kind.
        segment: the part of the line between two points that each vertex belongs to, shape (vertex_count,).
    """

    actuator: str = ""
    number: int = 0
    segment: np.ndarray | None = None

    def at_vertices(self, values: np.ndarray) -> np.ndarray:
        """Values at the vertices, shape (vertex_count,), of values of the parts between points, (point_count - 1,)."""
        return values[self.segment]


def line_tubes(recording: Recording, first_frame: int) -> list[LineTube]:
    """A tube for each cable and other line of a recording.

    Args:
        recording: the recording, which stays open.
        first_frame: the frame in which the bodies have the size that the thickness suits.
    """
    lines = [(kind, line) for kind in ACTUATOR_KINDS for line in recording.lines(kind)]
    if not lines:
        return []
    soft = [surface.vertices(first_frame) for surface in recording.surfaces if surface.kind == "soft"]
    radius = THICKNESS * radius_around_mean(np.concatenate(soft))
    return [
        LineTube(
            # No body or cavity has this name, as a line's own might be.
            name=f"{line.name}|{kind.name}",
            kind="line",
            triangles=tube_triangles(len(line.owner)),
            vertices=_around(partial(recording.points_of_line, line), radius),
            actuator=kind.name,
            number=line.number,
            segment=_segments(len(line.owner)),
        )
        for kind, line in lines
    ]


def tube_vertices(points: np.ndarray, radius: float) -> np.ndarray:
    """Vertices of a tube with beads around a polyline [mm], shape (vertex_count, 3).

    Args:
        points: points of the line [mm], shape (point_count, 3).
        radius: radius of the tube [mm].
    """
    along = np.diff(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    # Any direction across: faces are too many and too small for anybody to see where the first of them is.
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-30)
    across = np.stack([aside, np.cross(along, aside)], axis=1)
    rings = radius * np.einsum("sk,pkd->psd", _RING, across)
    ends = np.stack([points[:-1], points[1:]], axis=1)
    tubes = ends[:, :, None] + rings[:, None]
    beads = points[:, None] + BEAD * radius * _BALL
    return np.concatenate([tubes.reshape(-1, 3), beads.reshape(-1, 3)])


def tube_triangles(point_count: int) -> np.ndarray:
    """Vertex indices of the outward triangles of `tube_vertices`, shape (triangle_count, 3)."""
    segments = 2 * SIDES * np.arange(point_count - 1)
    beads = 2 * SIDES * (point_count - 1) + len(_BALL) * np.arange(point_count)
    return np.concatenate([_repeated(_band(0, SIDES), segments), _repeated(_BALL_TRIANGLES, beads)])


def _around(points: Callable[[int], np.ndarray], radius: float) -> Callable[[int], np.ndarray]:
    return lambda frame: tube_vertices(points(frame), radius)


def _segments(point_count: int) -> np.ndarray:
    """The segment of each vertex of `tube_vertices`; that of a bead is the one that ends there."""
    of_tubes = np.repeat(np.arange(point_count - 1), 2 * SIDES)
    of_beads = np.repeat(np.maximum(np.arange(point_count) - 1, 0), len(_BALL))
    return np.concatenate([of_tubes, of_beads])


def _repeated(triangles: np.ndarray, starts: Iterable[int]) -> np.ndarray:
    return np.concatenate([triangles + start for start in starts])


def _band(first: int, second: int) -> np.ndarray:
    """Triangles between two rings of SIDES vertices that begin at these indices, outward from the axis."""
    here = np.arange(SIDES)
    after = (here + 1) % SIDES
    lower = np.stack([first + here, first + after, second + after], axis=1)
    upper = np.stack([first + here, second + after, second + here], axis=1)
    return np.concatenate([lower, upper])


def _unit_ball() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward triangles of a ball of radius 1."""
    tilts = np.linspace(np.pi, 0.0, SIDES // 2 + 1)  # the poles are rings, too, whose vertices are at one place
    rings = [np.column_stack([np.sin(tilt) * _RING, np.full(SIDES, np.cos(tilt))]) for tilt in tilts]
    bands = [_band(SIDES * ring, SIDES * (ring + 1)) for ring in range(len(tilts) - 1)]
    bands[0], bands[-1] = bands[0][SIDES:], bands[-1][:SIDES]  # the other triangles there have no area
    return np.concatenate(rings), np.concatenate(bands)


_BALL, _BALL_TRIANGLES = _unit_ball()
