"""Is a surface closed, and which way does it face."""

import warnings

import numpy as np
import pytest
from blocks import make_block

from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, count_open_edges, enclosed_volume
from taichisoft.mesh.surface import closed_outward

MESH = make_block((2, 2, 2), (4.0, 3.0, 2.0))
SKIN = boundary_triangles(MESH.elements)


def test_a_closed_surface_stays_as_it_is() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert closed_outward(MESH.nodes, SKIN, "skin.stl") is SKIN
    assert enclosed_volume(MESH.nodes, SKIN) == pytest.approx(24.0, rel=1e-14)


def test_one_that_is_inside_out_is_turned_round_with_a_warning() -> None:
    with pytest.warns(UserWarning, match=r"skin\.stl: is inside out; its triangles are turned round"):
        turned = closed_outward(MESH.nodes, SKIN[:, ::-1], "skin.stl")
    assert enclosed_volume(MESH.nodes, turned) == pytest.approx(24.0, rel=1e-14)


def with_one_turned(triangles: np.ndarray) -> np.ndarray:
    turned = triangles.copy()
    turned[0] = turned[0, ::-1]
    return turned


@pytest.mark.parametrize(
    ("triangles", "open_edges"),
    [
        (SKIN, 0),
        (SKIN[1:], 3),  # a hole
        (SKIN[:1], 3),
        (with_one_turned(SKIN), 6),  # one triangle faces the other way: its edges run twice in one direction
        (np.vstack([SKIN, SKIN[:1]]), 3),  # one stands twice
    ],
)
def test_every_edge_joins_two_triangles_of_one_orientation(triangles: np.ndarray, open_edges: int) -> None:
    assert bool(count_open_edges(triangles)) == bool(open_edges)
    if open_edges:
        with pytest.raises(MeshError, match=r"^skin\.stl: is not closed: \d+ edges do not join exactly two"):
            closed_outward(MESH.nodes, triangles, "skin.stl")


def test_a_surface_without_volume_is_refused() -> None:
    """Two triangles back to back are closed, and enclose nothing."""
    with pytest.raises(MeshError, match="encloses no volume"):
        closed_outward(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), "flat.stl")


def test_the_volume_does_not_depend_on_the_origin() -> None:
    """A kilometre away the coordinates keep ten digits behind the point; about the middle no more are lost, while
    about the origin the terms would be of 1e18 mm^3."""
    far = MESH.nodes + 1e6
    assert enclosed_volume(far, SKIN) == pytest.approx(24.0, rel=1e-8)
