"""Meshes of order 2: the sides of their elements follow the surfaces of the geometry."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fingers import finger_from_dict
from solid_shapes import write_step

from taichisoft import VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import count_open_edges, element_volumes, least_volumes, tetrahedron_volumes, with_middle_nodes
from taichisoft_meshing.file_bodies import StepBody, SurfacesBody
from taichisoft_meshing.gmsh_session import LEAST, CurvedSides, with_curved_sides
from taichisoft_meshing.mesh_quality import faults, measure
from taichisoft_meshing.pneunet_finger import mesh_finger
from taichisoft_meshing.tendon_finger import TendonFinger

RADIUS, BORE, LENGTH = 10.0, 6.0, 15.0


def tube(occ: Any) -> None:
    """A closed tube: a cylinder with a cylindrical void, both along z."""
    outside = occ.addCylinder(0, 0, 0, 0, 0, LENGTH, RADIUS)
    occ.cut([(3, outside)], [(3, occ.addCylinder(0, 0, 4, 0, 0, LENGTH - 8, BORE))])


BODIES = {
    "ball": (lambda occ: occ.addSphere(0, 0, 0, RADIUS), 4 / 3 * np.pi * RADIUS**3),
    "tube": (tube, np.pi * (RADIUS**2 * LENGTH - BORE**2 * (LENGTH - 8))),
}


def volume(mesh: VolumeMesh) -> float:
    return float(element_volumes(mesh.nodes, mesh.elements).sum())


def step_mesh(folder: Path, name: str, **sizes: Any) -> VolumeMesh:
    write_step(folder / f"{name}.step", BODIES[name][0])
    sizes = {"largest": 8.0, "curvature": 8, **sizes}
    return StepBody({"file": f"{name}.step", "mesh": sizes}, folder / "body.toml").mesh().check()


@pytest.mark.filterwarnings("ignore:.*no cavity", "ignore:.*meshed coarsely")
@pytest.mark.parametrize("across", [1, 2])
@pytest.mark.parametrize("name", BODIES)
def test_curved_sides_have_the_volume_of_the_solid(tmp_path: Path, name: str, across: int) -> None:
    """Eight edges around a full turn: at least ten times nearer to the exact volume than straight sides are."""
    straight = step_mesh(tmp_path, name, elements_across_walls=across)
    curved = step_mesh(tmp_path, name, elements_across_walls=across, order=2)
    assert curved.elements.shape == (len(straight.elements), 10)
    np.testing.assert_array_equal(curved.elements[:, :4], straight.elements)
    np.testing.assert_array_equal(curved.nodes[: len(straight.nodes)], straight.nodes)
    exact = BODIES[name][1]
    assert abs(volume(straight) / exact - 1) > 0.02
    assert abs(volume(curved) - exact) < 0.1 * abs(volume(straight) - exact)


@pytest.mark.filterwarnings("ignore:.*meshed coarsely")
def test_surfaces_follow_and_stay_closed(tmp_path: Path) -> None:
    """All nodes of the void's wall, middles too, are on its cylinder or lids; files and figures take such meshes."""
    mesh = step_mesh(tmp_path, "tube", largest=4.0, elements_across_walls=1, order=2)
    for name in ("outer", "cavity"):
        assert count_open_edges(mesh.surface_groups[name]) == 0
    wall = mesh.nodes[np.unique(mesh.surface_groups["cavity"])]
    on_lid = np.isclose(wall[:, 2], 4) | np.isclose(wall[:, 2], LENGTH - 4)
    np.testing.assert_allclose(np.hypot(*wall[~on_lid, :2].T), BORE, rtol=1e-6)
    assert np.hypot(*wall[on_lid, :2].T).max() == pytest.approx(BORE, rel=1e-6)
    write_volume_mesh(mesh, tmp_path / "tube.msh")
    again = read_volume_mesh(tmp_path / "tube.msh")
    np.testing.assert_array_equal(again.nodes, mesh.nodes)
    np.testing.assert_array_equal(again.elements, mesh.elements)
    quality = measure(mesh)
    assert not faults(quality)
    assert quality.volumes.sum() == pytest.approx(volume(mesh))
    straight = step_mesh(tmp_path, "tube", largest=4.0, elements_across_walls=1)
    assert {wall.sides for wall in quality.walls} == {wall.sides for wall in measure(straight).walls}


@pytest.mark.filterwarnings("ignore:.*stay straight")
def test_fillets_of_a_finger_are_followed() -> None:
    """What flat sides cut from the fillets is nearly all there."""
    tables = {"chambers": {"fillet_radius": 1.5, "count": 2}, "slots": {"count": 1}}
    meshes = [mesh_finger(finger_from_dict({**tables, "mesh": {"curvature": 8, "order": k}})) for k in (1, 2)]
    finger = finger_from_dict(tables)
    missing = [abs(volume(mesh) - finger.solid_volume + finger.cavity_volume) for mesh in meshes]
    assert missing[1] < 0.1 * missing[0]


def test_flat_faces_have_straight_sides(tmp_path: Path) -> None:
    """A finger without fillets, and one for a cable, whose `order` a size on the command line does not take away."""
    plain = {"chambers": {"count": 2}, "slots": {"count": 1}}
    first = mesh_finger(finger_from_dict(plain))
    second = mesh_finger(finger_from_dict({**plain, "mesh": {"order": 2}}))
    np.testing.assert_allclose(second.nodes, with_middle_nodes(first).nodes, atol=1e-9)
    tendon = TendonFinger({"mesh": {"order": 2}}, tmp_path / "tendon.toml")
    assert tendon.mesh(7.0).elements.shape[1] == 10


def test_a_side_that_would_turn_an_element_over_stays_straight() -> None:
    """Two tetrahedra: one middle far inside the other element, and one that bulges a little, which stays."""
    nodes = np.vstack([np.zeros(3), 4.0 * np.eye(3), [4.0, 4.0, 4.0]])
    elements = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    assert (tetrahedron_volumes(nodes, elements) > 0).all()
    mesh = VolumeMesh("two", nodes, elements, {"outer": np.array([[0, 2, 1]])})
    sides = CurvedSides(np.array([[0, 1], [2, 4]]), np.array([[2.0, 2.5, 2.5], [2.1, 4.1, 2.1]]))
    with pytest.warns(UserWarning, match="^two: 1 sides stay straight"):
        curved = with_curved_sides(mesh, sides).check()
    moved = (curved.nodes != with_middle_nodes(mesh).nodes).any(axis=1)
    assert moved.sum() == 1
    np.testing.assert_array_equal(curved.nodes[moved], sides.middles[1:])
    assert (least_volumes(curved.nodes, curved.elements) >= LEAST * tetrahedron_volumes(nodes, elements)).all()


def test_surfaces_of_triangles_have_no_order(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="order"):
        SurfacesBody({"outer": "outer.stl", "mesh": {"order": 2}}, tmp_path / "body.toml")
