"""The size that gives a number of nodes, on geometries whose number of nodes is a formula."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import Geometry, VolumeMesh
from taichisoft.errors import MeshError
from taichisoft_meshing.body_tables import MOST_MESHES, WITHIN, size_for_nodes


def spiral(count: int) -> VolumeMesh:
    """A string of tetrahedra with so many nodes."""
    turn = 0.5 * np.arange(count)
    nodes = np.column_stack([np.cos(turn), np.sin(turn), 0.1 * turn])
    return VolumeMesh("spiral", nodes, np.arange(count - 3)[:, None] + np.arange(4))


class Counted(Geometry):
    """A geometry with count(size) nodes; what it is asked for is kept."""

    def __init__(self, count: Callable[[float], float], **presets: float):
        self.count, self._presets = count, presets
        self.asked: list[float | None] = []

    @property
    def presets(self) -> dict[str, float]:
        return self._presets

    def mesh(self, size: float | None = None) -> VolumeMesh:
        self.asked.append(size)
        return spiral(round(self.count(5.0 if size is None else size)))


@examples(50)
@given(
    dimension=st.floats(1.5, 3.0), factor=st.floats(1e3, 1e5), nodes=st.integers(50, 5000), start=st.floats(0.5, 50.0)
)
def test_a_power_of_the_size_is_found(dimension: float, factor: float, nodes: int, start: float) -> None:
    geometry = Counted(lambda size: min(max(factor * size**-dimension, 4), 20_000), coarse=start)
    size, mesh = size_for_nodes(geometry, nodes)
    assert abs(len(mesh.nodes) / nodes - 1) <= WITHIN
    assert len(mesh.nodes) == len(geometry.mesh(size).nodes)
    assert len(geometry.asked) <= MOST_MESHES + 1


def test_the_geometrys_own_size_is_the_start_where_there_are_no_presets() -> None:
    geometry = Counted(lambda size: 4000 * size**-2.0)
    size, mesh = size_for_nodes(geometry, 700)
    assert geometry.asked[0] is None
    assert abs(len(mesh.nodes) / 700 - 1) <= WITHIN
    assert size == pytest.approx(math.sqrt(4000 / 700), rel=0.1)


def test_a_jump_over_the_number_is_refused_with_what_came_nearest() -> None:
    geometry = Counted(lambda size: 1000 if size > 5.0 else 2000, coarse=18.0)
    with pytest.raises(MeshError) as refused:
        size_for_nodes(geometry, 1400)
    assert str(refused.value).startswith(
        "nodes = 1400: no size was found that gives as many within 15%; the nearest mesh has 1000, with largest "
        "elements of "
    )


def test_sizes_that_the_body_refuses_are_limits_of_the_search() -> None:
    def count(size: float) -> float:
        if size > 5.0:
            raise MeshError("body.toml: size = 6: must be at most 5")
        if size < 1.0:
            raise MeshError("body.toml: size = 0.5: must be at least 1")
        return 10_000 * size**-3.0

    for nodes, largest in ((90, 5.0), (9000, 1.1)):
        size, mesh = size_for_nodes(Counted(count, coarse=3.0), nodes)
        assert abs(len(mesh.nodes) / nodes - 1) <= WITHIN
        assert size <= largest
    with pytest.raises(MeshError, match=r"nodes = 60: .* the nearest mesh has \d+, .*; body.toml: size = 6: must be"):
        size_for_nodes(Counted(count, coarse=3.0), 60)


def test_a_body_that_cannot_be_meshed_is_no_matter_of_its_size() -> None:
    def count(size: float) -> float:
        raise MeshError("body.toml: gmsh cannot mesh it")

    with pytest.raises(MeshError, match=r"^body.toml: gmsh cannot mesh it$"):
        size_for_nodes(Counted(count, coarse=10.0), 100)


@pytest.mark.parametrize("nodes", [-5, 0, 3, 1_000_001, 10**9])
def test_fewer_nodes_than_a_tetrahedron_has_and_more_than_are_ever_simulated_are_refused(nodes: int) -> None:
    geometry = Counted(lambda size: 100.0)
    with pytest.raises(MeshError, match=f"^nodes = {nodes}: must lie between 4, .*, and 1000000$"):
        size_for_nodes(geometry, nodes)
    assert geometry.asked == []
