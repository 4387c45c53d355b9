"""Edges that go through triangles: every pair that may is compared, and the common point lies in both."""

import numpy as np
import pytest
from conftest import examples
from hypothesis import assume, given
from hypothesis import strategies as st

from taichisoft.mesh import common_points, pairs_of_meeting_boxes
from taichisoft.mesh.surface import LEAVES_AT_A_TIME


@given(st.tuples(*[st.floats(-0.4, 1.2)] * 2), st.floats(-0.5, 1.5), st.integers(0, 1000))
def test_an_edge_crosses_a_triangle_where_it_goes_through_it(weights: tuple, along: float, seed: int) -> None:
    """The point is given by its barycentric weights in the triangle's plane and by its share of the edge's length."""
    second, third = weights
    nearest = min(second, third, 1 - second - third, along, 1 - along)
    assume(abs(nearest) > 1e-3)
    generator = np.random.default_rng(seed)
    corners = generator.uniform(-1, 1, (3, 3))
    point = corners[0] + second * (corners[1] - corners[0]) + third * (corners[2] - corners[0])
    direction = generator.uniform(-1, 1, 3)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    assume(abs(direction @ normal) > 0.02)
    ends = np.array([point - along * direction, point + (1 - along) * direction])
    place = common_points(ends[None], corners[None], 1e-9)
    if nearest > 0:
        assert place[0] == pytest.approx(point, abs=1e-9)
    else:
        assert np.isnan(place).all()


@pytest.mark.parametrize("near", [0.0, 1e-6])
def test_an_end_that_touches_a_triangle_lies_in_it(near: float) -> None:
    corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    ends = np.array([[1.0, 1, near], [2, 2, 5]])
    assert common_points(ends[None], corners[None], near)[0] == pytest.approx([1, 1, near])
    assert np.isnan(common_points(ends[None] + [0, 0, 1e-3], corners[None], near)).all()


def test_a_triangle_of_no_area_has_no_point() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert np.isnan(common_points(np.array([[[1.0, -1, 0], [1, 1, 0]]]), corners[None])).all()


@examples(30)
@given(st.integers(0, 10**6), st.integers(1, 400), st.integers(1, 60), st.sampled_from([0.0, 0.3]))
def test_pairs_whose_boxes_meet_are_those_of_a_plain_search(
    seed: int, edge_count: int, count: int, near: float
) -> None:
    """Edges of all lengths, none included; the search halves them, and a plain one compares all pairs."""
    generator = np.random.default_rng(seed)
    edges = generator.uniform(-5, 5, (edge_count, 1, 3)) + generator.exponential(
        generator.choice([0, 0.1, 3], (edge_count, 1, 1)), (edge_count, 2, 3)
    )
    triangles = generator.uniform(-5, 5, (count, 1, 3)) + generator.uniform(-1, 1, (count, 3, 3))
    found = [np.column_stack(pair) for pair in pairs_of_meeting_boxes(edges, triangles, near)]
    lower, upper = edges.min(axis=1)[:, None] - near, edges.max(axis=1)[:, None] + near
    meet = ((lower <= triangles.max(axis=1)) & (triangles.min(axis=1) <= upper)).all(axis=2)
    pairs = np.vstack([np.empty((0, 2), dtype=int), *found])
    assert np.array_equal(pairs[np.lexsort(pairs.T[::-1])], np.argwhere(meet))


def test_many_edges_come_in_several_parts() -> None:
    """So that memory stays bounded."""
    starts = np.arange(64.0 * LEAVES_AT_A_TIME)[:, None, None] * [1, 0, 0]
    edges = starts + np.array([[0.1, 0.1, -1], [0.1, 0.1, 1]])
    triangles = starts + np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]])
    parts = list(pairs_of_meeting_boxes(edges, triangles))
    assert len(parts) > 1
    edge, triangle = np.concatenate([edge for edge, _ in parts]), np.concatenate([found for _, found in parts])
    assert np.array_equal(np.sort(edge), np.arange(len(edges))) and np.array_equal(edge, triangle)
