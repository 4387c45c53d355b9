"""Points that follow a mesh."""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks import make_block
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import VolumeMesh, make_model
from taichisoft.mechanics import embed
from taichisoft.mechanics.selection import Embedding
from taichisoft.scene import scene_from_dict

MESH = make_block((3, 2, 2), (30.0, 20.0, 20.0))


@examples(30)
@given(seed=st.integers(0, 10**6))
def test_points_inside_have_weights_of_a_tetrahedron(seed: int) -> None:
    """The weights give the point back, sum to one, none is negative; so any affine motion of the mesh carries it."""
    points = np.random.default_rng(seed).uniform(-1, 1, (70, 3)) * [15, 10, 10]
    nodes, weights = embed(points, MESH.nodes, MESH.elements)
    np.testing.assert_allclose(np.einsum("pk,pkd->pd", weights, MESH.nodes[nodes]), points, atol=1e-12)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-13)
    assert weights.min() > -1e-12


def test_a_node_is_carried_by_itself() -> None:
    nodes, weights = embed(MESH.nodes, MESH.nodes, MESH.elements)
    assert (nodes[np.arange(len(nodes)), weights.argmax(axis=1)] == np.arange(len(nodes))).all()
    np.testing.assert_allclose(weights.max(axis=1), 1.0, rtol=1e-12)


def test_outer_point_belongs_to_nearest_centroid() -> None:
    """As in SOFA's BarycentricMapping; its weights are extrapolated and still give the point back."""
    points = np.random.default_rng(4).uniform(1.05, 1.3, (50, 3)) * [15, 10, 10]
    nodes, weights = embed(points, MESH.nodes, MESH.elements)
    centroids = MESH.nodes[MESH.elements].mean(axis=1)
    nearest = np.linalg.norm(points[:, None] - centroids, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nodes, MESH.elements[nearest])
    np.testing.assert_allclose(np.einsum("pk,pkd->pd", weights, MESH.nodes[nodes]), points, atol=1e-12)
    assert (weights.min(axis=1) < 0.0).all()


def by_hand(point: np.ndarray, mesh: VolumeMesh) -> tuple[int, str]:
    """The element of a point as SOFA's mapping for containers of tetrahedra finds it, one element after the other.

    Returns:
        the element, and which elements were looked at.
    """
    corners = mesh.nodes[mesh.elements]
    edges = {tuple(sorted(pair)) for element in mesh.elements.tolist() for pair in combinations(element, 2)}
    width = np.mean([np.linalg.norm(mesh.nodes[a] - mesh.nodes[b]) for a, b in edges])
    low, high = np.floor(corners.min(axis=1) / width), np.floor(corners.max(axis=1) / width)
    cell = np.floor(point / width)

    def measure(element: int) -> float:
        weights = np.linalg.solve(np.vstack([corners[element].T, np.ones(4)]), [*point, 1.0])
        centroid = corners[element].mean(axis=0)
        return -weights.min() if weights.min() >= 0.0 else float(np.sum((point - centroid) ** 2))

    own = np.flatnonzero(((low <= cell) & (cell <= high)).all(axis=1)).tolist()
    if not own:
        return min(range(len(corners)), key=measure), "all"
    best = min(own, key=measure)
    if abs(measure(best)) <= 0.5 * width:
        return best, "own cell"
    around = np.flatnonzero(((low <= cell + 1) & (cell - 1 <= high)).all(axis=1)).tolist()
    return min(around, key=measure), "cells around"


def test_on_a_grid_only_elements_near_a_point_are_compared() -> None:
    """Own cell, cells around, all: each happens, and now and then an element further away is taken than necessary."""
    mesh = make_block((3, 2, 2), (3.0, 2.4, 2.2))
    some = np.random.default_rng(3).uniform(-1.0, 1.0, (500, 3))
    points = np.vstack([some[:400] * [2.5, 2.3, 2.2], some[400:] * [5.0, 4.6, 4.4]])
    chosen, weights = embed(points, mesh.nodes, mesh.elements, "grid")
    found = [by_hand(point, mesh) for point in points]
    np.testing.assert_array_equal(chosen, mesh.elements[[element for element, _ in found]])
    np.testing.assert_allclose(np.einsum("pk,pkd->pd", weights, mesh.nodes[chosen]), points, atol=1e-12)
    assert {looked_at for _, looked_at in found} == {"own cell", "cells around", "all"}
    deepest, _ = embed(points, mesh.nodes, mesh.elements)
    inside = weights.min(axis=1) > 0.0
    np.testing.assert_array_equal(chosen[inside], deepest[inside])
    assert inside.sum() > 20 and (chosen != deepest).any()


def test_a_body_says_how_its_surfaces_are_embedded(block: Callable[..., str], tmp_path: Path) -> None:
    """A collision surface and a cavity, one corner of which is outside and carried by another element on a grid."""
    corners = [[1.5027, -0.107, 0.633], [0.5, 0.3, 0.4], [0.5, -0.6, 0.3], [0.6, -0.1, -0.7]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]).export(tmp_path / "surface.stl")
    body = {"mesh": block((3, 2, 2), (3.0, 2.4, 2.2)), "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3}
    file = str(tmp_path / "surface.stl")
    body |= {"collision_surface": file, "cavities": {"air": {"surface": file}}}
    carriers = []
    for embedding in ("deepest", "grid"):
        (made,) = make_model(scene_from_dict({"soft_bodies": {"block": {**body, "embedding": embedding}}})).soft_bodies
        carriers += [made.surface.nodes.tolist(), made.cavities[0].surface.nodes.tolist()]
    assert carriers[0] == carriers[1] != carriers[2] == carriers[3]


@pytest.mark.parametrize("run", ["b_CableForce", "e_finger", "e_gripper", "f_step6"])
@pytest.mark.parametrize("embedding", ["deepest", "grid"])
def test_points_are_carried_as_in_sofa(shared: Path, run: str, embedding: Embedding) -> None:
    """Cables and a cavity of scenes with containers of tetrahedra: all points inside, where both embeddings agree.

    A point on a face between two elements may be in either; the record's choice is 3e-7 off there.
    """
    path = shared / "reference" / "sofa-cables" / f"{run}.npz"
    if not path.is_file():
        pytest.skip("the recorded runs of SOFA with cables are not there")
    recorded = np.load(path)
    names = [key.removesuffix("_emb_tet") for key in recorded.files if key.endswith("_emb_tet")]
    for name in names:
        body = name.split("_")[0]
        mesh_nodes, elements, points = recorded[f"{body}_x0"], recorded[f"{body}_tets"], recorded[f"{name}_x0"]
        found = embed(points, mesh_nodes, elements, embedding)
        carried_in_sofa = elements[recorded[f"{name}_emb_tet"]], recorded[f"{name}_emb_w"]
        np.testing.assert_allclose(*(_by_node(*one, len(mesh_nodes)) for one in (found, carried_in_sofa)), atol=5e-7)
    assert names


def _by_node(nodes: np.ndarray, weights: np.ndarray, node_count: int) -> np.ndarray:
    """The weight of every node in every point."""
    table = np.zeros((len(nodes), node_count))
    np.add.at(table, (np.arange(len(nodes))[:, None], nodes), weights)
    return table
