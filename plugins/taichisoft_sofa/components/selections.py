"""ROI engines: selection of points and cells inside boxes and spheres."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from taichisoft.errors import SceneError
from taichisoft_sofa.components.graph import LOADERS, STATE, TOPOLOGIES, in_node, nearest, node_of
from taichisoft_sofa.components.loaders import CORNERS
from taichisoft_sofa.components.states import width_of
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, numbers
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

# Points and cells inside the boxes and spheres of SOFA's ROI engines.

Inside = Callable[[np.ndarray], np.ndarray]
"""Predicate: which of the points [mm], shape (count, 3), lie in a region, shape (count,)."""


def in_boxes(boxes: ArrayLike) -> Inside:
    """Make the predicate of boxes of six numbers, two opposite corners; includes their faces, to the last bit."""
    corners = np.asarray(boxes, dtype=np.float64).reshape(-1, 2, 3)
    lower, upper = corners.min(axis=1), corners.max(axis=1)

    def inside(points: np.ndarray) -> np.ndarray:
        apart = points[:, None]
        return ((apart >= lower) & (apart <= upper)).all(axis=2).any(axis=1)

    return inside


def in_oriented_boxes(boxes: ArrayLike) -> Inside:
    """Make the predicate of boxes of ten numbers: three consecutive corners of a rectangle, and a depth.

    The first and third corners are opposite; half of the depth is on each side of the rectangle.
    """
    rows = np.asarray(boxes, dtype=np.float64).reshape(-1, 10)

    def inside(points: np.ndarray) -> np.ndarray:
        found = np.zeros(len(points), dtype=bool)
        for row in rows:
            first, second, third, depth = row[:3], row[3:6], row[6:9], row[9]
            along, across = second - first, third - second
            normal = np.cross(along, across)
            middle = (first + third) / 2.0
            axes = np.stack([v / np.linalg.norm(v) for v in (along, np.cross(normal, along), normal)])
            across_length = abs(across @ axes[1])
            half = np.array([np.linalg.norm(along), across_length, depth]) / 2.0
            found |= (np.abs((points - middle) @ axes.T) <= half).all(axis=1)
        return found

    return inside


def in_spheres(centres: ArrayLike, radii: ArrayLike) -> Inside:
    """Make the predicate of spheres, including their surfaces; a single radius holds for all."""
    middle = np.asarray(centres, dtype=np.float64).reshape(-1, 3)
    reach = np.broadcast_to(np.asarray(radii, dtype=np.float64).reshape(-1), len(middle))

    def inside(points: np.ndarray) -> np.ndarray:
        apart = points[:, None] - middle
        return ((apart**2).sum(axis=2) <= reach**2).any(axis=1)

    return inside


def cells_inside(points: np.ndarray, cells: np.ndarray, inside: Inside, strict: bool) -> np.ndarray:
    """Indices of the cells with all corners in the region, or, if not `strict`, with their mean corner in it."""
    if not len(cells):
        return np.zeros(0, dtype=np.int64)
    if strict:
        return np.flatnonzero(inside(points)[cells].all(axis=1))
    corners = points[cells]
    total = corners[:, 0]
    for corner in range(1, cells.shape[1]):
        total = total + corners[:, corner]
    return np.flatnonzero(inside(total / cells.shape[1]))


CELLS_IN = {
    "edgesInROI": "edges",
    "trianglesInROI": "triangles",
    "quadInROI": "quads",
    "tetrahedraInROI": "tetrahedra",
    "hexahedraInROI": "hexahedra",
}
"""Data with the selected cells of an engine, and their kinds."""
INDICES_OF = {
    "edgeIndices": "edges",
    "triangleIndices": "triangles",
    "quadIndices": "quads",
    "tetrahedronIndices": "tetrahedra",
    "hexahedronIndices": "hexahedra",
}
"""Data with the indices of the selected cells."""

DUST = 8.0 * np.finfo(np.float64).eps ** 2
"""A coordinate below this fraction of the largest counts as 0, because it is a round-off error."""


def region_of(engine: "Component") -> Inside:
    """Predicate for points inside the region of an engine, or on its faces."""
    if canonical(engine.type_name) == "SphereROI":
        centres, radii = numbers(engine, "centers").reshape(-1, 3), numbers(engine, "radii")
        if len(radii) not in (1, len(centres)):
            raise SceneError(f"{described(engine)}: radii has {len(radii)} numbers for {len(centres)} centers")
        return in_spheres(centres, radii)
    boxes = in_boxes(numbers(engine, "box").reshape(-1, 6))
    oriented = in_oriented_boxes(numbers(engine, "orientedBox").reshape(-1, 10))
    return lambda points: boxes(points) | oriented(points)


def engine_points(engine: "Component") -> np.ndarray:
    """The points among which an engine selects [mm], shape (count, 3), without round-off errors of zeros.

    SOFA transforms meshes twice, see `placed_by_loader`, which leaves 1e-30 in place of 0, and thus nodes outside boxes
    that end at 0. If the scene is read exactly, the round-off errors are kept.
    """
    points = _given_points(engine)
    if getattr(node_of(engine).getRoot(), "_exact", False) or not points.size:
        return points
    return np.where(np.abs(points) <= DUST * np.abs(points).max(), 0.0, points)


def lost_to_round_off(engine: "Component") -> np.ndarray:
    """Indices of the selected points whose selection in SOFA depends on the round-off error of a zero."""
    region = region_of(engine)
    return np.flatnonzero(region(engine_points(engine)) != region(_given_points(engine)))


def _given_points(engine: "Component") -> np.ndarray:
    if is_given(engine, "position"):
        return numbers(engine, "position").reshape(-1, 3)
    state = in_node(node_of(engine), {STATE})
    if state is None:
        loader = in_node(node_of(engine), LOADERS)
        if loader is not None:
            return computed(loader, "position", 3)
        state = nearest(node_of(engine), {STATE})
    # Frames are selected by their origins.
    return np.zeros((0, 3)) if state is None else computed(state, "rest_position", width_of(state))[:, :3]


def engine_cells(engine: "Component", kind: str) -> np.ndarray:
    """The cells among which an engine selects: its own data, or the cells of the topology in its node."""
    if is_given(engine, kind):
        return numbers(engine, kind).reshape(-1, CORNERS[kind]).astype(np.int64)
    topology = in_node(node_of(engine), TOPOLOGIES)
    if topology is None:
        return np.zeros((0, CORNERS[kind]), dtype=np.int64)
    return computed(topology, kind, CORNERS[kind])


def point_indices(engine: "Component") -> np.ndarray:
    """Indices of the points inside, shape (count,)."""
    return np.flatnonzero(region_of(engine)(engine_points(engine)))


def cell_indices(engine: "Component", kind: str) -> np.ndarray:
    """Indices of the cells inside, shape (count,)."""
    strict = flag(engine, "strict", True)
    return cells_inside(engine_points(engine), engine_cells(engine, kind), region_of(engine), strict)


def cells_in(engine: "Component", kind: str) -> np.ndarray:
    """The cells inside, as point indices, shape (count, corners)."""
    return engine_cells(engine, kind)[cell_indices(engine, kind)]
