"""Points that follow a mesh."""

import numpy as np
from blocks import make_block
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.bodies.embedding import embed

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


def test_a_point_outside_belongs_to_the_element_of_nearest_centroid() -> None:
    """As in SOFA's BarycentricMapping; its weights are extrapolated and still give the point back."""
    points = np.random.default_rng(4).uniform(1.05, 1.3, (50, 3)) * [15, 10, 10]
    nodes, weights = embed(points, MESH.nodes, MESH.elements)
    centroids = MESH.nodes[MESH.elements].mean(axis=1)
    nearest = np.linalg.norm(points[:, None] - centroids, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nodes, MESH.elements[nearest])
    np.testing.assert_allclose(np.einsum("pk,pkd->pd", weights, MESH.nodes[nodes]), points, atol=1e-12)
    assert (weights.min(axis=1) < 0.0).all()
