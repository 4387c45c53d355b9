"""Sections by a plane: what is cut closes again, and keeps volume, area and whatever is linear."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.errors import MeshError
from taichisoft.mesh import (
    SectionPlane,
    boundary_triangles,
    closed_cap,
    cut_tetrahedra,
    read_volume_mesh,
    split_triangles,
)

MESH = read_volume_mesh(Path(__file__).parents[2] / "data/meshes/tutorial-coarse.msh")


def areas(triangles):
    """Area vectors of triangles, shape (count, 3)."""
    a, b, c = np.moveaxis(triangles[..., :3], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


@given(
    normal=st.tuples(*3 * [st.floats(-1.0, 1.0)]).filter(lambda n: np.linalg.norm(n) > 0.1), share=st.floats(0.02, 0.98)
)
def test_a_cut_body_is_closed_and_the_two_caps_are_equal(normal, share):
    """The sum of a closed surface's area vectors is zero; the cap of elements has the area of the outline's inside.

    Round-off alone: 1e-9 of the surface. The mesh has cavities, so that outlines lie within others.
    """
    unit = np.array(normal) / np.linalg.norm(normal)
    heights = MESH.nodes @ unit
    offset = heights.min() + share * np.ptp(heights)
    plane = SectionPlane(tuple(unit), float(offset), False)
    skin = MESH.nodes[boundary_triangles(MESH.elements)]
    below, above, sides = split_triangles(skin, plane.height(skin))
    cap, _ = cut_tetrahedra(MESH.nodes[MESH.elements], plane.height(MESH.nodes[MESH.elements]), plane.normal)
    whole = np.linalg.norm(areas(skin), axis=1).sum()
    assert np.linalg.norm(areas(below), axis=1).sum() + np.linalg.norm(areas(above), axis=1).sum() == pytest.approx(
        whole
    )
    assert areas(below).sum(axis=0) + areas(cap).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9 * whole)
    assert areas(cap) @ unit == pytest.approx(np.linalg.norm(areas(cap), axis=1), abs=1e-9)
    filled = closed_cap(sides, plane.normal)
    # The outline is filled between levels that are rounded to 1e-7 mm.
    assert areas(filled).sum(axis=0) @ unit == pytest.approx(areas(cap).sum(axis=0) @ unit, abs=1e-5 * whole)


def test_what_is_linear_in_the_elements_is_linear_on_their_section():
    plane = SectionPlane.parse("x+2*y=-20")
    values = 3.0 * MESH.nodes[:, 0] - MESH.nodes[:, 2] + 5.0
    corners = np.column_stack([MESH.nodes, values])[MESH.elements]
    cap, element = cut_tetrahedra(corners, plane.height(corners[..., :3]), plane.normal)
    assert np.abs(plane.height(cap[..., :3])).max() < 1e-9
    assert cap[..., 3] == pytest.approx(3.0 * cap[..., 0] - cap[..., 2] + 5.0)
    assert len(cap) == len(element) > 100
    lowest, highest = (getattr(MESH.nodes[MESH.elements[element]], end)(axis=1) for end in ("min", "max"))
    assert (cap[..., :3].min(axis=1) >= lowest - 1e-9).all() and (cap[..., :3].max(axis=1) <= highest + 1e-9).all()


def test_a_plane_is_written_as_an_equation_and_says_what_is_kept():
    eye = np.array([0.0, 50.0, 0.0])
    assert SectionPlane.parse("y = 2").facing(eye).normal == (0.0, 1.0, 0.0), "the near part is left out"
    assert SectionPlane.parse("y=2").facing(-eye) == SectionPlane((-0.0, -1.0, -0.0), -2.0, True)
    assert SectionPlane.parse("y<2").facing(-eye).height(eye) == 48.0, "y < 2 is kept, whoever looks"
    assert SectionPlane.parse("y>2").height(eye) == -48.0
    assert SectionPlane.parse("3*x+4z=10").offset == 2.0


@pytest.mark.parametrize("text", ["", "y", "y==0", "q=1", "y=", "=0", "0*x=1", "y=nan", "y=1e99", "x=0,y=0", "y=1.2.3"])
def test_anything_else_is_refused_in_one_line(text):
    with pytest.raises(MeshError, match="must be a plane in mm, as y=0"):
        SectionPlane.parse(text)
