"""ROI engines: selection of points and cells inside boxes and spheres."""

from typing import TYPE_CHECKING

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.graph import LOADERS, STATE, TOPOLOGIES, in_node, nearest, node_of
from taichisoft_sofa.components.loaders import CORNERS
from taichisoft_sofa.components.states import width_of
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, numbers
from taichisoft_sofa.regions import Inside, cells_inside, in_boxes, in_oriented_boxes, in_spheres
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

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
