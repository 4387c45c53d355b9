"""Walls found with rays: their thickness and how many elements they are thick, whatever the body's shape."""

import numpy as np
import pytest
from blocks import make_block

from taichisoft import VolumeMesh
from taichisoft_meshing import wall_quality as wall_quality
from taichisoft_meshing.wall_quality import MANY, Walls, find_walls, measure_surfaces, measure_walls


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
