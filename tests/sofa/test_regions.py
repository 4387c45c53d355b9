"""Regions of SOFA's ROI engines: closed, several at once, cells by all corners or by their middle."""

import numpy as np
import pytest

from taichisoft_sofa.components.engines import cells_inside, in_boxes, in_oriented_boxes, in_spheres

POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [3.0, 3.0, 3.0]])


def test_the_faces_of_a_box_belong_to_it_and_corners_may_be_reversed() -> None:
    inside = in_boxes([[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    assert inside(POINTS).tolist() == [True, True, True, False, False]
    assert inside(np.array([[0.5, 0.5, -1e-30]])).tolist() == [False]


def test_several_boxes_are_joined() -> None:
    inside = in_boxes([[-1, -1, -1, 0.5, 0.5, 0.5], [2, 2, 2, 4, 4, 4]])
    assert inside(POINTS).tolist() == [True, False, False, False, True]


def test_an_oriented_box_reaches_half_its_depth_to_each_side() -> None:
    # A square of edge 2 in the plane x = z, with its middle at the origin.
    s = np.sqrt(0.5)
    box = [-s, -1.0, -s, s, -1.0, s, s, 1.0, s, 0.5]
    inside = in_oriented_boxes([box])
    along, normal = np.array([s, 0.0, s]), np.array([s, 0.0, -s])
    points = np.array([0.99 * along, 1.01 * along, 0.24 * normal, -0.24 * normal, 0.26 * normal, [0.0, 0.99, 0.0]])
    assert inside(points).tolist() == [True, False, True, True, False, True]


def test_one_radius_stands_for_all_spheres() -> None:
    inside = in_spheres([[0.0, 0.0, 0.0], [3.0, 3.0, 2.0]], [1.0])
    assert inside(POINTS).tolist() == [True, True, True, True, True]
    assert in_spheres([[0.0, 0.0, 0.0]], [0.9])(POINTS).tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(("strict", "found"), [(True, []), (False, [0])])
def test_a_cell_belongs_by_all_its_corners_or_by_its_middle(strict: bool, found: list[int]) -> None:
    inside = in_boxes([[0.2, 0.2, 0.2, 0.3, 0.3, 0.3]])
    assert cells_inside(POINTS, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), inside, strict).tolist() == found
