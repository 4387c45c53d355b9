"""Data computed from other data; importing this module registers them."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from taichisoft_sofa.components import other_data as other_data  # declares the kinds of computed data
from taichisoft_sofa.components.data_engines import (
    chosen_points,
    chosen_values,
    mapped_values,
    merged_set,
    transformed_points,
)
from taichisoft_sofa.components.graph import LOADERS, STATE, TOPOLOGIES
from taichisoft_sofa.components.loaders import (
    CORNERS,
    OTHER_NAMES,
    container_cells,
    container_position,
    loader_position,
    read_loader,
)
from taichisoft_sofa.components.regular_grids import GRID, grid_cells, grid_position
from taichisoft_sofa.components.selections import (
    CELLS_IN,
    INDICES_OF,
    cell_indices,
    cells_in,
    engine_points,
    point_indices,
)
from taichisoft_sofa.components.sparse_grids import SPARSE, sparse_cells, sparse_position
from taichisoft_sofa.components.states import WIDTHS, start_position, width_of
from taichisoft_sofa.tree.component import COMPUTED, Component
from taichisoft_sofa.tree.value_kinds import ANY, INDICES, VECTOR, ValueKind, declare, index_rows, vectors

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
