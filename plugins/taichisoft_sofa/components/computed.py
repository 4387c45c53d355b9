"""Data computed from other data; importing this module registers them."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import trimesh
from scipy import ndimage
from scipy.spatial.transform import Rotation

from taichisoft.errors import SceneError
from taichisoft_sofa.components import other_data as other_data
from taichisoft_sofa.components.contact_components import surface_triangles
from taichisoft_sofa.components.graph import LOADERS, STATE, TOPOLOGIES
from taichisoft_sofa.components.loaded_mesh import no_cells, placed, split_quads
from taichisoft_sofa.components.loaders import (
    CORNERS,
    OTHER_NAMES,
    container_cells,
    container_position,
    loader_position,
    read_loader,
)
from taichisoft_sofa.components.regular_grids import GRID, MOST_POINTS, grid_cells, grid_position, grid_size
from taichisoft_sofa.components.selections import (
    CELLS_IN,
    INDICES_OF,
    cell_indices,
    cells_in,
    engine_points,
    point_indices,
)
from taichisoft_sofa.components.states import WIDTHS, start_position, width_of
from taichisoft_sofa.components.typed_values import computed, described, flag, number, numbers, text, vector
from taichisoft_sofa.tree.component import COMPUTED, Component
from taichisoft_sofa.tree.value_kinds import ANY, INDICES, VECTOR, ValueKind, declare, index_rows, vectors

# Engines that compute data of a scene from other data: places, lists of indices and values.


def transformed_points(engine: "Component") -> np.ndarray:
    """TransformEngine: points scaled, then rotated, then translated [mm], or, inverse, the other way round."""
    points = numbers(engine, "input_position").reshape(-1, 3)
    scale = vector(engine, "scale", default=(1.0, 1.0, 1.0))
    shift = vector(engine, "translation", default=(0.0, 0.0, 0.0))
    turn = numbers(engine, "rotation", default=(0.0, 0.0, 0.0))
    if len(turn) == 4:  # a quaternion
        turn = Rotation.from_quat(turn).as_euler("xyz", degrees=True)
    if len(turn) != 3:
        raise SceneError(
            f"{described(engine)}: rotation has {len(turn)} numbers; three angles or a quaternion are needed"
        )
    if not flag(engine, "inverse", False):
        return placed(points, scale.tolist(), turn.tolist(), shift.tolist())
    back: np.ndarray = Rotation.from_euler("xyz", turn, degrees=True).inv().apply(points - shift) / scale
    return back


def mapped_values(engine: "Component") -> np.ndarray:
    """IndexValueMapper: values, with another one at some indices; where there are none yet, the default value."""
    values, indices = numbers(engine, "inputValues"), numbers(engine, "indices").astype(np.int64)
    if len(indices) and indices.max() >= len(values):
        rest = np.full(int(indices.max()) + 1 - len(values), number(engine, "defaultValue", default=1.0))
        values = np.concatenate([values, rest])
    if len(indices) and indices.min() < 0:
        raise SceneError(f"{described(engine)}: indices has {int(indices.min())}; they count from 0")
    values[indices] = number(engine, "value", default=0.0)
    return values


def chosen_values(engine: "Component") -> np.ndarray:
    """ValuesFromIndices: the values at some indices."""
    return _rows(engine, numbers(engine, "in"), 1).ravel()


def chosen_points(engine: "Component") -> np.ndarray:
    """PointsFromIndices: the points at some indices [mm]."""
    return _rows(engine, numbers(engine, "position"), 3)


def _rows(engine: "Component", values: np.ndarray, width: int) -> np.ndarray:
    rows, indices = values.reshape(-1, width), numbers(engine, "indices").astype(np.int64)
    outside = indices[(indices < 0) | (indices >= len(rows))]
    if len(outside):
        raise SceneError(f"{described(engine)}: names row {int(outside[0])}; there are {len(rows)}, from 0 on")
    return rows[indices]


SETS: dict[str, Any] = {
    "union": np.union1d,
    "intersection": np.intersect1d,
    "difference": np.setdiff1d,
    "symmetric_difference": np.setxor1d,
}


def merged_set(engine: "Component") -> np.ndarray:
    """MergeSets: what `op` makes of two sets of indices."""
    operation = text(engine, "op", default="union").lower()
    if operation not in SETS:
        raise SceneError(f"{described(engine)}: op '{operation}'; valid: {', '.join(SETS)}")
    merged: np.ndarray = SETS[operation](
        numbers(engine, "in1").astype(np.int64), numbers(engine, "in2").astype(np.int64)
    )
    return merged


# Sparse grids: the cells of a regular grid that a closed surface touches or encloses.

SPARSE = "SparseGridTopology"
MARGIN = 0.01
"""By which the grid is larger than its surface at each end, as a share of its size, as in SOFA [-]."""
PITCH = 0.3
"""Largest distance of the points by which cells that the surface touches are found, over the edge of a cell [-]."""


def sparse_position(grid: "Component") -> np.ndarray:
    """Points of the cells [mm], shape (count, 3)."""
    return _content(grid)[0]


def sparse_cells(grid: "Component", kind: str) -> np.ndarray:
    """The hexahedra; there are no other cells."""
    if kind == "hexahedra":
        return _content(grid)[1]
    return no_cells({"edges": 2, "triangles": 3, "quads": 4, "tetrahedra": 4}[kind])


def _content(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    if not hasattr(grid, "_sparse"):
        grid._sparse = _make(grid)
    found: tuple[np.ndarray, np.ndarray] = grid._sparse
    return found


def _surface(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    """Points [mm] and triangles of the surface: of a file, a source, or the data themselves."""
    if text(grid, "fileTopology", "filename"):
        mesh = read_loader(grid)
        return loader_position(grid), np.vstack([mesh.triangles, split_quads(mesh.quads)])
    if text(grid, "src"):
        source = grid.linked("src")
        return computed(source, "position", 3), surface_triangles(source)
    quads = numbers(grid, "quads").astype(np.int64).reshape(-1, 4)
    triangles = numbers(grid, "triangles").astype(np.int64).reshape(-1, 3)
    return numbers(grid, "vertices", "position").reshape(-1, 3), np.vstack([triangles, split_quads(quads)])


def _make(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    points, triangles = _surface(grid)
    if not len(triangles):
        raise SceneError(f"{described(grid)}: has no surface of triangles; name a file with fileTopology, or a source")
    low, high = (vector(grid, end, default=(0.0, 0.0, 0.0)) for end in ("min", "max"))
    if not low.any() and not high.any():
        size = np.ptp(points, axis=0)
        low, high = points.min(axis=0) - MARGIN * size, points.max(axis=0) + MARGIN * size
    count = np.array(grid_size(grid))
    if (width := number(grid, "cellWidth", default=0.0)) > 0.0:
        count = np.ceil((high - low) / width).astype(int) + 1
    if (count < 2).any() or np.prod(count.astype(float)) > MOST_POINTS:
        raise SceneError(
            f"{described(grid)}: n = {count.tolist()}: 2 points or more along each axis, {MOST_POINTS} at most"
        )
    cell = (high - low) / (count - 1)
    samples, _ = trimesh.remesh.subdivide_to_size(points, triangles, PITCH * cell.min(), max_iter=30)
    touched = np.zeros(count - 1, dtype=bool)
    place = np.floor((samples - low) / cell).astype(int)
    inside = ((place >= 0) & (place < count - 1)).all(axis=1)
    touched[tuple(place[inside].T)] = True
    outside, _ = ndimage.label(np.pad(~touched, 1, constant_values=True))
    kept = (outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1].transpose(2, 1, 0)  # [z, y, x]
    at = np.arange(np.prod(count)).reshape(count[::-1])
    ends = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    corners = [at[k : count[2] - 1 + k, j : count[1] - 1 + j, i : count[0] - 1 + i][kept] for i, j, k in ends]
    used, hexahedra = np.unique(np.column_stack(corners), return_inverse=True)
    x, y, z = used % count[0], used // count[0] % count[1], used // (count[0] * count[1])
    return low + np.column_stack([x, y, z]) * cell, hexahedra.reshape(-1, 8)


ENGINES = ("BoxROI", "SphereROI")


def _loader_cells(loader: Component, kind: str) -> np.ndarray:
    cells: np.ndarray = getattr(read_loader(loader), kind)
    return cells


def _position(state: Component) -> np.ndarray:
    if (width := width_of(state)) not in WIDTHS:  # such a state has no effect here, but its scene may read it
        return np.reshape(_given(state, "position"), (-1, max(width, 1)))
    return start_position(state)


def _rest_position(state: Component) -> np.ndarray:
    given = state.findData("rest_position")
    if given is not None and given.is_set():
        return np.reshape(given.given(), (-1, max(width_of(state), 1)))
    return _position(state)


def _given(state: Component, name: str) -> Any:
    data = state.findData(name)
    return np.zeros(0) if data is None else data.given()


def _coordinates(state: Component) -> ValueKind:
    return vectors(max(width_of(state), 1))


def _declare(type_name: str, computed: dict[str, tuple[Any, Callable[[Component], Any]]]) -> None:
    COMPUTED.setdefault(type_name, {}).update({name: function for name, (_, function) in computed.items()})
    declare(type_name, **{name: kind for name, (kind, _) in computed.items()})


def _cells(function: Callable[..., np.ndarray]) -> dict[str, tuple[Any, Callable[[Component], Any]]]:
    """The data of every kind of cell, under all names."""
    return {
        name: (index_rows(corners), partial(function, kind=kind))
        for kind, corners in CORNERS.items()
        for name in (kind, *OTHER_NAMES.get(kind, ()))
    }


for _loader in LOADERS:
    _declare(_loader, {"position": (vectors(3), loader_position), **_cells(_loader_cells)})
_declare(GRID, {"position": (vectors(3), grid_position), **_cells(grid_cells)})
_declare(SPARSE, {"position": (vectors(3), sparse_position), **_cells(sparse_cells)})
for _container in TOPOLOGIES - {GRID, SPARSE}:
    _declare(_container, {"position": (vectors(3), container_position), **_cells(container_cells)})
for _engine in ENGINES:
    _declare(
        _engine,
        {
            "indices": (INDICES, point_indices),
            "pointsInROI": (vectors(3), lambda engine: engine_points(engine)[point_indices(engine)]),
            "nbIndices": (ANY, lambda engine: len(point_indices(engine))),
            **{name: (INDICES, partial(cell_indices, kind=kind)) for name, kind in INDICES_OF.items()},
            **{name: (index_rows(CORNERS[kind]), partial(cells_in, kind=kind)) for name, kind in CELLS_IN.items()},
        },
    )
_declare("TransformEngine", {"output_position": (vectors(3), transformed_points)})
_declare("IndexValueMapper", {"outputValues": (VECTOR, mapped_values)})
_declare("ValuesFromIndices", {"out": (VECTOR, chosen_values)})
_declare("PointsFromIndices", {"indices_position": (vectors(3), chosen_points)})
_declare("MergeSets", {"out": (INDICES, merged_set)})
_declare(
    STATE,
    {
        "position": (_coordinates, _position),
        "rest_position": (_coordinates, _rest_position),
    },
)
