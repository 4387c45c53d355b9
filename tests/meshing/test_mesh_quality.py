"""The figures of a mesh: shapes of its elements, its walls, and the limits of a geometry file."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, with_middle_nodes
from taichisoft_meshing import wall_quality as wall_quality
from taichisoft_meshing.geometry_file import make_geometry, quality_limits
from taichisoft_meshing.gmsh_session import gmsh_session
from taichisoft_meshing.mesh_quality import QualityLimits, cautions, faults, measure, missed_limits
from taichisoft_meshing.wall_quality import (
    MANY,
    Walls,
    dihedral_angles,
    edge_lengths,
    find_walls,
    measure_surfaces,
    measure_walls,
    radius_ratios,
    winding_numbers,
)


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


def test_wall_of_one_quadratic_element_gives_no_warning() -> None:
    quality = measure(with_middle_nodes(hollow()))
    assert quality.elements_across_walls == 1
    assert cautions(quality) == []


def test_two_pieces_and_duplicate_nodes_are_faults() -> None:
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
def test_each_limit_is_named_with_value_and_place(limit: dict, line: str) -> None:
    quality = measure(hollow())
    (told,) = missed_limits(quality, QualityLimits(**limit))
    place = re.fullmatch(re.escape(line) + r" in \d+ elements?, the worst at (\[.+\]) mm", told)
    if place is None:
        assert told == line and "walls" in line
    else:
        away = np.linalg.norm(quality.centres - json.loads(place[1]), axis=1)
        assert away.min() < 0.01


# The shapes of tetrahedra.

ORDER = np.array([[0, 1, 2, 3]])
REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
CORNER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
LINE = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], dtype=float)


def test_the_regular_tetrahedron_has_the_ratio_1_in_any_size() -> None:
    for size in (1e-3, 1.0, 1e3):
        assert radius_ratios(size * REGULAR, ORDER) == pytest.approx([1], rel=1e-12)
        assert edge_lengths(size * REGULAR, ORDER).ravel() == pytest.approx([size * np.sqrt(8)] * 2, rel=1e-12)


def test_the_corner_of_a_cube_has_the_ratio_of_its_two_spheres() -> None:
    """Circumscribed sqrt(3)/2; inscribed 3 V / S = (1/2) / (3/2 + sqrt(3)/2) = 1 / (3 + sqrt(3))."""
    expected = 3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2)
    assert radius_ratios(CORNER, ORDER) == pytest.approx([expected], rel=1e-12)


def test_a_flat_tetrahedron_has_the_ratio_0() -> None:
    assert radius_ratios(SQUARE, ORDER) == pytest.approx([0], abs=1e-15)
    assert radius_ratios(LINE, ORDER) == pytest.approx([0], abs=1e-15)


def test_dihedral_angles_of_known_tetrahedra() -> None:
    """Regular: acos(1/3). Corner of a cube: 90 degrees at the three edges of the cube, else acos(1/sqrt(3))."""
    assert dihedral_angles(REGULAR, ORDER) == pytest.approx(np.full((1, 6), np.degrees(np.arccos(1 / 3))), rel=1e-12)
    slanted = np.degrees(np.arccos(1 / np.sqrt(3)))
    assert sorted(dihedral_angles(CORNER, ORDER)[0]) == pytest.approx([slanted] * 3 + [90] * 3, rel=1e-12)
    assert sorted(dihedral_angles(SQUARE, ORDER)[0]) == pytest.approx([0] * 4 + [180] * 2)


def test_edges_are_the_shortest_and_the_longest() -> None:
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 1]], dtype=float)
    assert edge_lengths(corners, ORDER).tolist() == [[1.0, 5.0]]


@given(st.integers(0, 2**32 - 1))
def test_measures_ignore_place_and_order_of_nodes(seed: int) -> None:
    random = np.random.default_rng(seed)
    corners = random.random((4, 3))
    turned, _ = np.linalg.qr(random.standard_normal((3, 3)))
    moved = corners @ turned + random.random(3)
    order = random.permutation(4).reshape(1, 4)
    for shape in (radius_ratios, dihedral_angles, edge_lengths):
        here, there = (np.sort(shape(*given).ravel()) for given in ((corners, ORDER), (moved, order)))
        np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-6)


def test_the_radius_ratio_is_gmshs_gamma() -> None:
    nodes = np.random.default_rng(3).random((40, 3))
    elements = np.arange(40).reshape(10, 4)
    with gmsh_session("tetrahedra") as gmsh:
        volume = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(3, volume, np.arange(1, 41), nodes.ravel())
        gmsh.model.mesh.addElementsByType(volume, 4, np.arange(1, 11), elements.ravel() + 1)
        gamma = gmsh.model.mesh.getElementQualities(np.arange(1, 11), "gamma")
    np.testing.assert_allclose(radius_ratios(nodes, elements), np.abs(gamma), rtol=1e-9)


# The table [quality] of a geometry file, for every kind.

FILE = Path("finger.toml")


def test_what_a_file_does_not_say_has_defaults() -> None:
    assert quality_limits({}, FILE) == QualityLimits()
    limits = quality_limits({"quality": {"radius_ratio": 0.2, "elements_across_walls": 2}}, FILE)
    assert limits == QualityLimits(radius_ratio=0.2, elements_across_walls=2)


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"radius_ratio": 2.0}, "quality.radius_ratio = 2.0: input should be less than or equal to 1"),
        ({"radius": 0.1}, "quality.radius: unknown key; did you mean 'radius_ratio'?"),
        ({"elements_across_walls": 2.5}, "quality.elements_across_walls = 2.5: input should be a valid integer"),
        ({"shortest_edge": float("nan")}, "quality.shortest_edge = nan: input should be a finite number"),
        ({"smallest_dihedral_angle": True}, "quality.smallest_dihedral_angle = True: input should be a valid number"),
        (3, "quality = 3: must be a table, [quality]"),
    ],
)
def test_what_is_wrong_is_said_with_the_file(table: object, problem: str) -> None:
    with pytest.raises(MeshError) as refused:
        make_geometry("pneunet_finger", {"quality": table}, FILE)
    assert str(refused.value) == f"finger.toml: {problem}"


def test_a_kind_does_not_see_the_table() -> None:
    make_geometry("pneunet_finger", {"quality": {"radius_ratio": 0.2}}, FILE)  # which knows no such key


# Walls found with rays: their thickness and how many elements they are thick, whatever the body's shape.


@pytest.mark.parametrize("layers", [1, 2, 3, 4, 6])
def test_a_plate_is_as_many_elements_thick_as_it_has_layers(layers: int) -> None:
    """Whatever diagonal the tetrahedra take, no path from one face to the other has fewer edges than layers."""
    plate = make_block((6, 5, layers), (60.0, 50.0, 10.0))
    walls = find_walls(plate.nodes, plate.elements)
    through = np.isclose(walls.thickness, 10.0)
    assert walls.areas[through].sum() == pytest.approx(2 * 60 * 50)
    assert (walls.elements_across[through] == min(layers, MANY)).all()


def test_rays_through_nodes_and_edges_are_not_lost() -> None:
    """Some rays in a block of boxes run along faces of tetrahedra all the way; a turned block adds rounding."""
    for seed in range(3):
        block = make_block((4, 4, 4), (4.0, 4.0, 4.0))
        turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0] if seed else np.eye(3)
        turn *= np.sign(np.linalg.det(turn))
        walls = find_walls(block.nodes @ turn.T, block.elements)
        assert walls.areas.sum() == pytest.approx(6 * 16)
        assert walls.thickness == pytest.approx(np.full(len(walls.areas), 4.0))


def wedge(degrees: float) -> VolumeMesh:
    """A prism of 80 mm between two faces that meet at an angle, sharp: a block whose nodes at one end are made one."""
    block = make_block((8, 4, 4), (80.0, 40.0, 2.0))
    nodes = block.nodes + np.array([40.0, 0.0, 0.0])
    nodes[:, 2] *= nodes[:, 0] * np.tan(np.radians(degrees / 2))
    nodes, merged = np.unique(nodes.round(9), axis=0, return_inverse=True)
    elements = merged[block.elements]
    whole = (np.diff(np.sort(elements, axis=1), axis=1) > 0).all(axis=1)
    return VolumeMesh("wedge", nodes, elements[whole]).check()


def test_the_edge_of_a_wedge_is_no_wall() -> None:
    """A wedge of 10 degrees is a wall, but not where triangles of both faces share a node."""
    mesh = wedge(10.0)
    walls = find_walls(mesh.nodes, mesh.elements)
    assert (walls.elements_across >= 1).all()
    assert walls.thickness.min() > 0.5
    corner = find_walls(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))
    assert len(corner.areas) == 0


def test_faces_that_are_not_parallel_are_no_wall() -> None:
    """A wedge of 60 degrees is no wall; only the parallel ends of the prism remain."""
    mesh = wedge(60.0)
    walls = find_walls(mesh.nodes, mesh.elements)
    assert walls.areas.sum() == pytest.approx(2 * 80 * 80 * np.tan(np.radians(30)))
    assert walls.thickness == pytest.approx(np.full(len(walls.areas), 40.0))


def of_block(mesh: VolumeMesh) -> dict[tuple[str, str], tuple[float, int, float]]:
    walls = measure_walls(mesh, measure_surfaces(mesh))
    return {wall.sides: (wall.thinnest, wall.elements_across, wall.share_of_one) for wall in walls}


def test_walls_are_told_apart_by_their_sides() -> None:
    """A cube of 50 mm with a hollow of 30 mm in the middle: walls of 10 mm on all sides, one box thick."""
    walls = of_block(make_block((5, 5, 5), (50.0, 50.0, 50.0), hollow=True))
    assert walls[("cavity", "outer")] == pytest.approx((10.0, 1, 1.0))
    assert walls[("outer", "outer")] == pytest.approx((50.0, 5, 0.0))
    assert ("cavity", "cavity") not in walls


@pytest.mark.parametrize(("thin", "across"), [(4, 2), (6, 1)])
def test_a_few_edges_straight_through_do_not_make_a_wall_thin(
    thin: int, across: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wall is called one element thick only if more than 5 % of its area is."""
    block = make_block((5, 5, 5), (50.0, 50.0, 50.0), hollow=True)
    cavity, outer = (np.tile(surface.triangles[:1], (100, 1)) for surface in reversed(measure_surfaces(block)))
    elements_across = np.where(np.arange(100) < thin, 1, np.where(np.arange(100) < 50, 2, 3))
    walls = Walls(cavity, outer, np.ones(100), np.full(100, 10.0), elements_across)
    monkeypatch.setattr(wall_quality, "find_walls", lambda nodes, elements: walls)
    assert of_block(block) == {("cavity", "outer"): (10.0, across, thin / 100)}
