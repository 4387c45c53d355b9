"""Walls of two elements between unchanged surfaces."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from solid_shapes import box, save

from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, tetrahedron_volumes
from taichisoft_meshing.file_bodies import SurfacesBody, cut_edges, through_edges, without_inverted
from taichisoft_meshing.mesh_quality import measure


@examples(20)
@given(st.tuples(*[st.integers(1, 4)] * 3), st.integers(0, 1000))
def test_cut_edges_keep_the_volume_and_the_boundary(cells: tuple[int, int, int], seed: int) -> None:
    """The parts of a block with shaken nodes have positive volumes and meet face to face."""
    block = make_block(cells, (3.0, 4.0, 5.0))
    nodes = block.nodes + np.random.default_rng(seed).uniform(-0.1, 0.1, block.nodes.shape)
    through = through_edges(block.elements)
    cut_nodes, cut, parents = cut_edges(nodes, block.elements, through)
    parts = np.bincount(parents, tetrahedron_volumes(cut_nodes, cut))
    np.testing.assert_allclose(parts, tetrahedron_volumes(nodes, block.elements), rtol=1e-9)
    assert len(cut_nodes) == len(nodes) + len(through)
    assert np.array_equal(cut_nodes[: len(nodes)], nodes)
    volumes = tetrahedron_volumes(cut_nodes, cut)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(tetrahedron_volumes(nodes, block.elements).sum(), rel=1e-12)
    before, after = (np.sort(boundary_triangles(elements), axis=1) for elements in (block.elements, cut))
    assert np.array_equal(np.unique(before, axis=0), np.unique(after, axis=0))
    assert len(through_edges(cut)) == 0


def test_an_edge_between_the_inside_and_the_boundary_stays() -> None:
    """The edges inside 2 x 2 x 2 boxes are those around the node in the middle, and those that cut corners."""
    block = make_block((2, 2, 2), (2.0, 2.0, 2.0))
    middle = int(np.argmin(np.linalg.norm(block.nodes, axis=1)))
    through = through_edges(block.elements)
    assert len(through) > 0
    assert (through != middle).all()
    assert (through[:, 0] < through[:, 1]).all()


@examples(20)
@given(st.integers(0, 1000), st.floats(0.1, 2.0))
def test_nodes_moved_through_a_face_go_back(seed: int, distance: float) -> None:
    """Shaken by up to two edges: no element is inverted, and nodes are either where they were or where they went."""
    block = make_block((3, 3, 3), (3.0, 3.0, 3.0))
    moved = block.nodes + np.random.default_rng(seed).uniform(-distance, distance, block.nodes.shape)
    kept = without_inverted(block.nodes, moved, block.elements)
    assert tetrahedron_volumes(kept, block.elements).min() > 0
    back, there = (kept == block.nodes).all(axis=1), (kept == moved).all(axis=1)
    assert (back | there).all()
    if (tetrahedron_volumes(moved, block.elements) > 0).all():
        assert there.all()


def test_a_kept_surface_gets_walls_of_two_elements(tmp_path: Path) -> None:
    save(box((30, 20, 20), parts=2), tmp_path / "body.stl")
    save(box((24, 14, 14), parts=2), tmp_path / "cavity.stl")
    meshes = []
    for across in ({"elements_across_walls": 1}, {}):  # two unless somebody wants fewer
        tables = {
            "outer": "body.stl",
            "cavity": "cavity.stl",
            "keep_surface": True,
            "mesh": {**across, "largest": 10},
            "base": {"point": [15, 0, 0], "normal": [1, 0, 0]},
        }
        meshes.append(SurfacesBody(tables, tmp_path / "body.toml").mesh())
    plain, split = meshes
    assert measure(plain).elements_across_walls == 1
    assert measure(split).elements_across_walls == 2
    for name, triangles in plain.surface_groups.items():
        assert np.array_equal(split.surface_groups[name], triangles)
    on_surfaces = np.unique(boundary_triangles(plain.elements))
    assert np.array_equal(split.nodes[on_surfaces], plain.nodes[on_surfaces])
    assert tetrahedron_volumes(split.nodes, split.elements).sum() == pytest.approx(12000 - 24 * 14 * 14, rel=1e-9)
    assert len(split.element_groups["silicone"]) == len(split.elements)


def test_how_many_elements_are_one_or_two(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"body.toml: mesh.elements_across_walls = 3: input should be 1 or 2$"):
        SurfacesBody({"outer": "body.stl", "mesh": {"elements_across_walls": 3}}, tmp_path / "body.toml")
