"""Check for bodies that overlap at the start, which the first step would throw apart."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from taichisoft.contact.detection import ContactDetection
from taichisoft.contact.kernels.shape_contacts import SHAPE, SURFACE
from taichisoft.contact.surfaces import ContactSurfaces, MovingSurfaces, boxes
from taichisoft.errors import SceneError
from taichisoft.mesh.surface import boxes_meet, common_points, pairs_of_meeting_boxes

# Surfaces are shrunk by this fraction of the scene's extent before they are intersected, so that bodies that merely
# touch do not overlap by round-off.
SHRINKING = 1e-6
# One surface of each pair is also shifted, by less than the shrinking: otherwise no edge would properly go through a
# triangle of bodies with coincident faces or edges, such as one body placed twice.
SHIFT = 0.25 * np.array([0.62, -0.48, 0.57])


class Overlap(NamedTuple):
    """Two bodies that overlap.

    Attributes:
        bodies: their numbers, the lower one first; twice the same number if surfaces of one body overlap.
        problem: the bodies, the depth and the place, in one line.
        advice: possible corrections.
    """

    bodies: tuple[int, int]
    problem: str
    advice: str


def refuse_overlap(surfaces: ContactSurfaces, moving: MovingSurfaces, body_names: Sequence[str]) -> None:
    """Refuse a scene with overlapping bodies.

    Raises:
        SceneError: two bodies overlap; the message has their names and the place.
    """
    for overlap in overlaps(surfaces, moving, ContactDetection(surfaces, moving), body_names):
        raise SceneError(f"{overlap.problem}; {overlap.advice}")


def overlaps(
    surfaces: ContactSurfaces,
    moving: MovingSurfaces,
    detection: ContactDetection,
    body_names: Sequence[str],
    body: int | None = None,
) -> Iterator[Overlap]:
    """Find bodies that overlap: points inside other bodies, the deepest first, then crossed surfaces.

    Args:
        surfaces: all surfaces.
        moving: their current positions.
        detection: contact detection of these surfaces.
        body_names: names by body number.
        body: number of a body to check against all others; None: check all bodies.
    """
    yield from _points_inside(surfaces, moving, detection, body_names, body)
    yield from _crossed_surfaces(surfaces, moving, body_names, body)


def _points_inside(
    surfaces: ContactSurfaces,
    moving: MovingSurfaces,
    detection: ContactDetection,
    body_names: Sequence[str],
    body: int | None,
) -> Iterator[Overlap]:
    (lower, upper), (shape_lower, shape_upper) = moving.boxes(), boxes(surfaces.shapes, moving.shapes)
    extents = np.vstack([upper - lower, shape_upper - shape_lower])
    largest = float(np.linalg.norm(extents, axis=1).max())
    reach = np.zeros((len(body_names), len(body_names)))
    if body is not None:
        reach -= 1.0  # skips a pair
        reach[body] = reach[:, body] = 0.0
    pairs = detection.find(reach, depth=largest).trimmed()
    reported = set()
    for pair in np.argsort(pairs.distance, kind="stable")[: np.count_nonzero(pairs.distance < 0.0)].tolist():
        first, second = sorted(pairs.bodies[pair].tolist())
        if (first, second) not in reported:
            reported.add((first, second))
            how = f"by {-pairs.distance[pair]:.3g} mm at {np.round(pairs.points[pair, 0], 2).tolist()} mm"
            yield _overlap(first, second, body_names, f" {how}")


def _crossed_surfaces(
    surfaces: ContactSurfaces, moving: MovingSurfaces, body_names: Sequence[str], body: int | None
) -> Iterator[Overlap]:
    """Find surfaces with an edge through a triangle of the other, such as crossed bars without vertices inside."""
    topology, position = surfaces.topology, moving.moved.position
    if not len(topology.triangles):
        return
    lower, upper = moving.boxes()
    meeting = [
        (first, second)
        for first, second in topology.pairs.tolist()
        if (body is None or body in topology.body[[first, second]])
        and boxes_meet(lower[first], upper[first], lower[second], upper[second])
    ]
    shapes, there = surfaces.shapes, moving.shapes
    with_shapes = [
        (shape, surface)
        for shape, surface in shapes.surface_pairs[:, [SHAPE, SURFACE]].tolist()
        if body is None or body in (shapes.body[shape], topology.body[surface])
    ]
    if not meeting and not with_shapes:
        return
    margin = SHRINKING * float((upper.max(axis=0) - lower.min(axis=0)).max())
    shrunk = position - margin * _vertex_normals(topology.triangles, position)
    edges = [topology.edges[start:stop] for start, stop in surfaces.edge_range]
    triangles = [topology.triangles[start:stop] for start, stop in surfaces.triangle_range]
    shifted = shrunk + margin * SHIFT
    for first, second in meeting:
        place = _first_crossing(shifted[edges[first]], shrunk[triangles[second]])
        if place is None:
            place = _first_crossing(shrunk[edges[second]], shifted[triangles[first]])
        if place is not None:
            yield _crossing(place, topology.body[first], topology.body[second], body_names)
    # The axis of a round shape with both ends outside goes through a surface, or meets an edge or vertex of it.
    half = shapes.half_length[:, None] * there.axis
    axes = np.stack([there.centre - half, there.centre + half], axis=1)
    for shape, surface in with_shapes:
        place = _first_crossing(axes[shape, None], shrunk[triangles[surface]])
        if place is not None:
            yield _crossing(place, shapes.body[shape], topology.body[surface], body_names)


def _crossing(place: np.ndarray, first: int, second: int, body_names: Sequence[str]) -> Overlap:
    how = f": their surfaces cross at {np.round(place, 2).tolist()} mm"
    return _overlap(min(first, second), max(first, second), body_names, how)


def _overlap(first: int, second: int, body_names: Sequence[str], how: str) -> Overlap:
    what, advice = _describe_pair(body_names[first], body_names[second])
    return Overlap((int(first), int(second)), f"{what} overlap at the start{how}", advice)


def _describe_pair(first: str, second: str) -> tuple[str, str]:
    """Subject and advice of the message."""
    if first == second:
        return f"collision surfaces of '{first}'", "give them a group in common, or move one of them away"
    return f"bodies '{first}' and '{second}'", "move one of them away"


def _vertex_normals(triangles: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Unit vector of the mean triangle normal at each vertex, shape (vertex_count, 3)."""
    a, b, c = np.moveaxis(position[triangles], 1, 0)
    area_vector = np.cross(b - a, c - a)
    face_normal = area_vector / _lengths(area_vector)
    normals = np.zeros_like(position)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], face_normal)
    return normals / _lengths(normals)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths of vectors as divisors, shape (count, 1): 1 for vectors of length 0."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0.0, lengths, 1.0)


def _first_crossing(edges: np.ndarray, triangles: np.ndarray) -> np.ndarray | None:
    """Find a point where an edge goes through a triangle [mm], shape (3,), or None.

    Args:
        edges: ends [mm], shape (edge_count, 2, 3).
        triangles: corners [mm], shape (triangle_count, 3, 3).
    """
    for edge, triangle in pairs_of_meeting_boxes(edges, triangles):
        points = common_points(edges[edge], triangles[triangle])
        found = np.flatnonzero(np.isfinite(points).all(axis=1))
        if len(found):
            crossing: np.ndarray = points[found[0]]
            return crossing
    return None
