"""Engines: selections of points and cells in boxes and spheres, and lists made of other data."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from taichisoft_sofa.components.draft import SceneDraft
from taichisoft_sofa.components.meshes import CORNERS, placed, split_quads
from taichisoft_sofa.components.reading import LOADERS, STATE, TOPOLOGIES, computed, in_node, nearest, node_of
from taichisoft_sofa.components.states import width_of
from taichisoft_sofa.tree.component import Component, component, derived, without_effect
from taichisoft_sofa.tree.value_kinds import ANY, FROM_0, INDICES, canonical, fixed, index_rows, vectors

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


SELECTED = {
    "edges": ("edgesInROI", "edgeIndices"),
    "triangles": ("trianglesInROI", "triangleIndices"),
    "quads": ("quadInROI", "quadIndices"),
    "tetrahedra": ("tetrahedraInROI", "tetrahedronIndices"),
    "hexahedra": ("hexahedraInROI", "hexahedronIndices"),
}
"""Data of an engine with the selected cells of each kind, and with their indices."""

DUST = 8.0 * np.finfo(np.float64).eps ** 2
"""A coordinate below this fraction of the largest counts as 0, because it is a round-off error."""


UNIT_BOX = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
"""Of a BoxROI without any box, as in SOFA [mm]."""


def region_of(engine: "Component") -> Inside:
    """Predicate for points inside the region of an engine, or on its faces."""
    if canonical(engine.type_name) == "SphereROI":
        centres = engine.read_numbers("centers").reshape(-1, 3)
        return in_spheres(centres, engine.read_each("radii", len(centres), "centers"))
    given = engine.is_given("box") or engine.is_given("orientedBox")
    boxes = in_boxes((engine.read_numbers("box") if given else np.array(UNIT_BOX)).reshape(-1, 6))
    oriented = in_oriented_boxes(engine.read_numbers("orientedBox").reshape(-1, 10))
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
    if engine.is_given("position"):
        return engine.read_numbers("position").reshape(-1, 3)
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
    own = engine.is_given(kind)
    cells = computed(engine if own else in_node(node_of(engine), TOPOLOGIES), kind, CORNERS[kind])
    count = len(_given_points(engine)) if cells.size else 0
    if cells.size and not 0 <= cells.min() <= cells.max() < count:
        raise engine.refused(f"{kind} has {cells.max()}; there are {count} points, counted from 0")
    return cells


def point_indices(engine: "Component") -> np.ndarray:
    """Indices of the points inside, shape (count,)."""
    return np.flatnonzero(region_of(engine)(engine_points(engine)))


def cell_indices(engine: "Component", kind: str) -> np.ndarray:
    """Indices of the cells inside, shape (count,)."""
    strict = engine.read_flag("strict")
    return cells_inside(engine_points(engine), engine_cells(engine, kind), region_of(engine), strict)


def cells_in(engine: "Component", kind: str) -> np.ndarray:
    """The cells inside, as point indices, shape (count, corners)."""
    return engine_cells(engine, kind)[cell_indices(engine, kind)]


SELECTION = {
    "position": vectors(3),
    "strict": True,
    "doUpdate": True,
    **{kind: index_rows(corners) for kind, corners in CORNERS.items()},
    "indices": derived(INDICES, point_indices),
    "pointsInROI": derived(vectors(3), lambda engine: engine_points(engine)[point_indices(engine)]),
    "nbIndices": derived(ANY, lambda engine: len(point_indices(engine))),
    **{name: derived(index_rows(CORNERS[kind]), partial(cells_in, kind=kind)) for kind, (name, _) in SELECTED.items()},
    **{name: derived(INDICES, partial(cell_indices, kind=kind)) for kind, (_, name) in SELECTED.items()},
    **without_effect("computeTriangles computeTrianglesInROI triAngle trianglesOutIndices"),
    **without_effect("trianglesOutROI tetrahedraOutROI hexahedraOutROI"),
}
"""Data that are read of every engine that selects, and those that it makes."""


@component("BoxROI", **SELECTION, box=vectors(6), orientedBox=vectors(10))
@component("SphereROI", **SELECTION, centers=vectors(3), radii=((), FROM_0))
def accept_selection(component: "Component", draft: "SceneDraft") -> None:
    """Accept an engine; points whose selection differs from SOFA's by round-off are listed."""
    lost = lost_to_round_off(component)
    if len(lost):
        draft.depart(
            f"{component.getPathName()}: point {lost[0]} lies on a face of the box; in SOFA the round-off of a zero "
            "decides, against it"
        )


# Engines that compute data of a scene from other data: places, lists of indices and values.


def transformed_points(engine: "Component") -> np.ndarray:
    """TransformEngine: points scaled, then rotated, then translated [mm], or, inverse, the other way round."""
    points = engine.read_numbers("input_position").reshape(-1, 3)
    scale = engine.read_vector("scale")
    shift = engine.read_vector("translation")
    turn = engine.read_numbers("rotation", default=(0.0, 0.0, 0.0))
    if len(turn) == 4:  # a quaternion
        turn = Rotation.from_quat(turn).as_euler("xyz", degrees=True)
    if len(turn) != 3:
        raise engine.refused(f"rotation has {len(turn)} numbers; three angles or a quaternion are needed")
    if not engine.read_flag("inverse"):
        return placed(points, scale.tolist(), turn.tolist(), shift.tolist())
    return np.asarray(Rotation.from_euler("xyz", turn, degrees=True).inv().apply(points - shift) / scale)


def mapped_values(engine: "Component") -> np.ndarray:
    """IndexValueMapper: values, with another one at some indices; where there are none yet, the default value."""
    values, indices = engine.read_numbers("inputValues"), engine.read_numbers("indices").astype(np.int64)
    if len(indices) and indices.max() >= len(values):
        rest = np.full(int(indices.max()) + 1 - len(values), engine.read_number("defaultValue"))
        values = np.concatenate([values, rest])
    if len(indices) and indices.min() < 0:
        raise engine.refused(f"indices has {int(indices.min())}; they count from 0")
    values[indices] = engine.read_number("value")
    return values


def chosen_values(engine: "Component") -> np.ndarray:
    """ValuesFromIndices: the values at some indices."""
    return _rows(engine, engine.read_numbers("in"), 1).ravel()


def chosen_points(engine: "Component") -> np.ndarray:
    """PointsFromIndices: the points at some indices [mm]."""
    return _rows(engine, engine.read_numbers("position"), 3)


def _rows(engine: "Component", values: np.ndarray, width: int) -> np.ndarray:
    rows, indices = values.reshape(-1, width), engine.read_numbers("indices").astype(np.int64)
    outside = indices[(indices < 0) | (indices >= len(rows))]
    if len(outside):
        raise engine.refused(f"names row {int(outside[0])}; there are {len(rows)}, from 0 on")
    return rows[indices]


MOST_SETS = 20
"""Sets of which an engine can make the complement."""
SETS: dict[str, Any] = {
    "union": np.union1d,
    "intersection": np.intersect1d,
    "difference": np.setdiff1d,
    "symmetric_difference": np.setxor1d,
}


def merged_set(engine: "Component") -> np.ndarray:
    """MergeSets: what `op` makes of two sets of indices."""
    operation = engine.read_text("op").lower()
    if operation not in SETS:
        raise engine.refused(f"op '{operation}'; valid: {', '.join(SETS)}")
    merged: np.ndarray = SETS[operation](
        engine.read_numbers("in1").astype(np.int64), engine.read_numbers("in2").astype(np.int64)
    )
    return merged


def other_indices(engine: "Component") -> np.ndarray:
    """ComplementaryROI: indices of the points that are in none of the sets `setIndices1`, `setIndices2` and so on."""
    count = int(engine.read_number("nbSet"))
    if count >= MOST_SETS:
        raise engine.refused(f"nbSet = {count}; at most {MOST_SETS - 1} sets are known here")
    sets = [engine.read_numbers(f"setIndices{which or ''}") for which in range(count + 1)]
    return np.setdiff1d(np.arange(len(engine.read_numbers("position")) // 3), np.concatenate(sets).astype(np.int64))


def rigid_mass(engine: "Component") -> tuple[float, float, np.ndarray, np.ndarray]:
    """GenerateRigidMass: mass, volume [mm^3], inertia over mass [mm^2] and centre [mm] of what a surface encloses."""
    triangles = np.vstack([computed(engine, "triangles", 3), split_quads(computed(engine, "quads", 4))])
    points = engine.read_numbers("position").reshape(-1, 3)
    if not triangles.size or triangles.max() >= len(points):
        raise engine.refused("needs position, and triangles or quads of its points")
    solid = trimesh.Trimesh(points, triangles, process=False)
    if solid.volume < 0.0:
        solid.invert()
    volume = float(solid.volume)
    if volume == 0.0:
        raise engine.refused("its surface encloses nothing")
    return engine.read_number("density") * volume, volume, np.array(solid.moment_inertia) / volume, solid.center_mass


CHOSEN = (INDICES, (), FROM_0)


@component(
    "TransformEngine",
    input_position=vectors(3),
    translation=fixed(3),
    rotation=(),
    scale=(fixed(3), (1.0, 1.0, 1.0)),
    inverse=False,
    output_position=derived(vectors(3), transformed_points),
)
@component(
    "IndexValueMapper",
    inputValues=(),
    indices=CHOSEN,
    value=0.0,
    defaultValue=1.0,
    outputValues=derived((), mapped_values),
)
@component("ValuesFromIndices", indices=CHOSEN, out=derived((), chosen_values), **{"in": ()})
@component(
    "PointsFromIndices",
    position=vectors(3),
    indices=CHOSEN,
    indices_position=derived(vectors(3), chosen_points),
)
@component(
    "ComplementaryROI",
    position=vectors(3),
    nbSet=(0, FROM_0),
    indices=derived(INDICES, other_indices),
    pointsInROI=derived(
        vectors(3), lambda engine: engine.read_numbers("position").reshape(-1, 3)[other_indices(engine)]
    ),
    **{f"setIndices{which or ''}": INDICES for which in range(MOST_SETS)},
)
@component(
    "GenerateRigidMass",
    position=vectors(3),
    triangles=index_rows(3),
    quads=index_rows(4),
    density=(1000.0, FROM_0),
    mass=derived(0.0, lambda engine: rigid_mass(engine)[0]),
    volume=derived(0.0, lambda engine: rigid_mass(engine)[1]),
    inertiaMatrix=derived((), lambda engine: rigid_mass(engine)[2].ravel()),
    rigidMass=derived((), lambda engine: np.hstack([*rigid_mass(engine)[:2], rigid_mass(engine)[2].ravel()])),
    massCenter=derived(fixed(3), lambda engine: rigid_mass(engine)[3]),
    centerToOrigin=derived(fixed(3), lambda engine: -rigid_mass(engine)[3]),
)
@component("MergeSets", in1=INDICES, in2=INDICES, op="union", out=derived(INDICES, merged_set))
def accept_engine(component: "Component", draft: "SceneDraft") -> None:
    """Accept an engine, whose result other components read."""
