"""The figures of whole meshes, and what speaks against them."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import make_block

from taichisoft import VolumeMesh
from taichisoft.mesh import boundary_triangles, with_middle_nodes
from taichisoft_meshing.mesh_quality import QualityLimits, cautions, faults, measure, missed_limits
from taichisoft_meshing.wall_quality import winding_numbers


def hollow() -> VolumeMesh:
    """A cube of 50 mm with a hollow of 30 mm, its surfaces not named but for the cavity."""
    return make_block((5, 5, 5), (50.0, 50.0, 50.0), hollow=True)


def beside(first: VolumeMesh, second: VolumeMesh, offset: float) -> VolumeMesh:
    """Two meshes in one, the second moved along x."""
    nodes = np.vstack([first.nodes, second.nodes + np.array([offset, 0, 0])])
    elements = np.vstack([first.elements, second.elements + len(first.nodes)])
    surfaces = first.surface_groups | {
        name: group + len(first.nodes)
        for name, group in second.surface_groups.items()
        if name not in first.surface_groups
    }
    return VolumeMesh("both", nodes, elements, surfaces)


def test_the_figures_of_a_hollow_cube() -> None:
    quality = measure(hollow())
    assert quality.volumes.sum() == pytest.approx(50**3 - 30**3)
    surfaces = {surface.name: surface for surface in quality.surfaces}
    assert surfaces["outer"].volume == pytest.approx(50**3)
    assert surfaces["outer"].area == pytest.approx(6 * 50**2)
    assert surfaces["cavity"].volume == pytest.approx(30**3)
    assert surfaces["cavity"].open_edges == surfaces["outer"].open_edges == 0
    assert (quality.components, quality.duplicate_nodes, quality.inverted, quality.outside) == (1, 0, 0, ())
    assert quality.elements_across_walls == 1
    assert faults(quality) == []
    assert missed_limits(quality, QualityLimits()) == []


def test_surfaces_without_names_are_told_by_which_way_they_face() -> None:
    quality = measure(replace(hollow(), surface_groups={}))
    assert {surface.name: round(surface.volume) for surface in quality.surfaces} == {"outer": 125000, "cavity": 27000}
    nameless = replace(hollow(), surface_groups={})
    names = [surface.name for surface in measure(beside(nameless, nameless, 60.0)).surfaces]
    assert names == ["outer", "cavity_0", "cavity_1"]


def test_a_wall_of_one_element_is_warned_of() -> None:
    (caution,) = cautions(measure(hollow()))
    assert caution.endswith(
        ": cavity to outer (100% of the area); try a smaller size, elements_across_walls = 2, or order = 2"
    )
    assert cautions(measure(make_block((2, 2, 2), (1.0, 1.0, 1.0)))) == []
    (unit,) = cautions(measure(make_block((2, 2, 2), (0.04, 0.02, 0.02))))
    assert unit == "its longest side = 0.04 mm: soft robots have 1 to 20000; 0.04 m are 40 mm"


def test_a_wall_of_one_quadratic_element_is_none_that_is_warned_of() -> None:
    quality = measure(with_middle_nodes(hollow()))
    assert quality.elements_across_walls == 1
    assert cautions(quality) == []


def test_two_pieces_are_a_fault_and_so_are_nodes_that_should_be_one() -> None:
    """Two cubes side by side that share no node: two pieces, and their nodes in the common plane stand twice."""
    cube = make_block((2, 2, 2), (2.0, 2.0, 2.0))
    apart, touching = measure(beside(cube, cube, 3.0)), measure(beside(cube, cube, 2.0))
    assert faults(apart) == ["1 pieces are not joined to the first by a face"]
    assert "9 nodes have the position of another node" in faults(touching)


def test_pieces_that_only_share_an_edge_are_two() -> None:
    nodes = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    mesh = VolumeMesh("two", nodes, np.array([[0, 2, 3, 1], [0, 4, 5, 1]])).check()
    found = faults(measure(mesh))
    assert found[0] == "1 pieces are not joined to the first by a face"
    assert found[1].startswith("surface 'outer' is not closed: ")


def test_inverted_elements_are_counted() -> None:
    cube = make_block((1, 1, 1), (1.0, 1.0, 1.0))
    elements = cube.elements.copy()
    elements[[0, 3]] = elements[[0, 3]][:, [0, 1, 3, 2]]
    assert faults(measure(VolumeMesh("cube", cube.nodes, elements)))[0] == "2 elements have no positive volume"


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda cavity: cavity[:, ::-1], "surface 'cavity' is inside out: it encloses -27000 mm^3"),
        (lambda cavity: cavity[1:], "surface 'cavity' is not closed: 3 edges do not join two triangles"),
    ],
)
def test_a_cavity_must_be_closed_and_face_into_the_silicone(change, fault: str) -> None:
    mesh = hollow()
    assert faults(measure(replace(mesh, surface_groups={"cavity": change(mesh.surface_groups["cavity"])}))) == [fault]


def test_a_cavity_must_lie_inside() -> None:
    """The hollow of a second cube beside the first, where only the first is called the outer skin."""
    both = beside(hollow(), hollow(), 60.0)
    first = measure(hollow())
    outer = next(surface.triangles for surface in first.surfaces if surface.name == "outer")
    shifted = hollow().surface_groups["cavity"] + len(hollow().nodes)
    groups = {"outer": outer, "cavity_0": hollow().surface_groups["cavity"], "cavity_1": shifted}
    assert measure(replace(both, surface_groups=groups)).outside == ("cavity_1",)


def test_a_cavity_that_touches_the_skin_is_not_inside() -> None:
    """The cavity touches an inner edge of the skin, where more than half of the space around a node is silicone."""
    block = make_block((4, 4, 3), (4.0, 4.0, 3.0))
    means = block.nodes[block.elements].mean(axis=1)
    angle = VolumeMesh("angle", block.nodes, block.elements[(means[:, 0] < 0) | (means[:, 1] < 0)])
    edge = np.flatnonzero(np.isclose(block.nodes, [0.0, 0.0, 0.5]).all(axis=1))
    inner = (np.abs(block.nodes) < [1.5, 1.5, 1.0]).all(axis=1)
    corners = np.isin(angle.elements, edge) | inner[angle.elements]
    tip = angle.elements[corners.all(axis=1) & np.isin(angle.elements, edge).any(axis=1)][0]
    surface = boundary_triangles(tip.reshape(1, 4))
    assert measure(replace(angle, surface_groups={"cavity": surface})).outside == ("cavity",)


def test_winding_numbers_tell_inside_from_outside() -> None:
    cube = next(surface for surface in measure(hollow()).surfaces if surface.name == "outer")
    points = np.array([[0, 0, 0], [24.9, 24.9, 24.9], [25.1, 0, 0], [100, 3, 2]])
    np.testing.assert_allclose(winding_numbers(points, hollow().nodes[cube.triangles]), [1, 1, 0, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("limit", "line"),
    [
        ({"radius_ratio": 0.8}, "the smallest radius ratio, 0.7174, is below quality.radius_ratio = 0.8"),
        (
            {"smallest_dihedral_angle": 60.0},
            "the smallest dihedral angle, 45 degrees, is below quality.smallest_dihedral_angle = 60",
        ),
        (
            {"largest_dihedral_angle": 80.0},
            "the largest dihedral angle, 90 degrees, is above quality.largest_dihedral_angle = 80",
        ),
        ({"shortest_edge": 11.0}, "the shortest edge, 10 mm, is below quality.shortest_edge = 11"),
        ({"elements_across_walls": 2}, "elements across walls, 1, is below quality.elements_across_walls = 2"),
    ],
)
def test_each_limit_is_named_with_the_measure_and_its_value(limit: dict, line: str) -> None:
    assert missed_limits(measure(hollow()), QualityLimits(**limit)) == [line]
