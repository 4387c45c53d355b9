"""Sizes of elements: for a number of nodes, at cavities and on curved surfaces, with curved sides."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from fingers import finger_from_dict, sharp_fingers
from hypothesis import given
from hypothesis import strategies as st
from solid_shapes import write_step

from taichisoft import Geometry, VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import count_open_edges, element_volumes, least_volumes, tetrahedron_volumes, with_middle_nodes
from taichisoft_meshing.body_tables import MOST_MESHES, WITHIN, size_for_nodes
from taichisoft_meshing.file_bodies import StepBody, SurfacesBody
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters
from taichisoft_meshing.gmsh_session import LEAST, CurvedSides, with_curved_sides
from taichisoft_meshing.mesh_quality import faults, measure
from taichisoft_meshing.pneunet_finger import (
    PneunetFinger,
    layer_boxes,
    layer_count,
    mesh_finger,
    slot_boxes,
    thin_walls,
    walled_boxes,
)
from taichisoft_meshing.tendon_finger import TendonFinger
from taichisoft_meshing.wall_quality import find_walls, radius_ratios

TUTORIAL = PneunetFinger({}, Path("tutorial.toml"))


def across(mesh: VolumeMesh, thickest: float) -> set[int]:
    """Numbers of elements across the walls that are at most so thick [mm]."""
    walls = find_walls(mesh.nodes, mesh.elements)
    return set(walls.elements_across[walls.thickness < thickest].tolist())


@pytest.mark.parametrize(("preset", "nodes"), [("coarse", 550), ("medium", 2000), ("fine", 6000)])
def test_a_preset_gives_the_tutorials_finger_about_so_many_nodes(preset: str, nodes: int) -> None:
    mesh = TUTORIAL.mesh(TUTORIAL.presets[preset])
    assert len(mesh.nodes) == pytest.approx(nodes, rel=0.15)
    assert radius_ratios(mesh.nodes, mesh.elements).min() > 0.2
    assert across(mesh, 3.1) == ({2} if preset == "fine" else {1})


def test_presets_are_multiples_of_the_thinnest_wall() -> None:
    thinner = PneunetFinger({"wall": 1.25}, Path("finger.toml"))
    assert thinner.presets == {name: size / 2 for name, size in TUTORIAL.presets.items()}


def test_elements_are_small_at_the_cavity_and_grow_away_from_it() -> None:
    """Edges grow in the 16 mm of solid silicone at base and tip, by 0.5 mm a millimetre beyond a wall of 3 mm."""
    mesh = mesh_finger(FingerParameters(mesh=ElementSizes(largest=12.0, smallest=4.0)))
    corners = mesh.nodes[mesh.elements]
    edges = np.linalg.norm(corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]], axis=2).mean(axis=1)
    middles = corners.mean(axis=1)
    at_cavity = (middles[:, 0] < -16) & (middles[:, 0] > -99) & (middles[:, 1] > 8.5) & (middles[:, 1] < 22)
    in_tip = middles[:, 0] < -107
    assert np.median(edges[at_cavity]) == pytest.approx(4.0, rel=0.15)
    before_cavity = (middles[:, 0] < -10) & (middles[:, 0] > -12)
    assert np.median(edges[before_cavity]) == pytest.approx(4.0 + 0.5 * 2, rel=0.15)
    assert np.median(edges[in_tip]) > 1.5 * np.median(edges[at_cavity])


@pytest.mark.parametrize(
    ("smallest", "wanted", "layers"),
    [(9.0, 2, 1), (3.01, 2, 1), (3.0, 2, 2), (2.0, 2, 2), (2.01, 3, 2), (2.0, 3, 3), (1.0, 1, 1)],
)
def test_layers_come_when_their_elements_are_not_too_flat(smallest: float, wanted: int, layers: int) -> None:
    """Up to 2.4 times as long as thick: 2.4 * 2.5 mm / 2 = 3 mm for two layers, 2 mm for three."""
    sizes = ElementSizes(largest=2 * smallest, smallest=smallest, elements_across_walls=wanted)
    assert layer_count(FingerParameters(mesh=sizes)) == layers


def test_an_even_mesh_heeds_no_wall() -> None:
    assert layer_count(FingerParameters(mesh=ElementSizes(largest=1.0, smallest=1.0))) == 1


@given(sharp_fingers())
def test_layers_stay_inside_their_walls(tables: dict[str, Any]) -> None:
    """Between the cavity and what is behind each wall; those of neighbouring chambers do not meet."""
    finger = finger_from_dict(tables)
    body, thin = finger.body, thin_walls(finger)
    for walled, box in zip(walled_boxes(finger), layer_boxes(finger, 2 / 3), strict=True):
        below, above = walled.box.lower - box.lower, box.upper - walled.box.upper
        for depth, wall, shared in zip((below, above), walled.walls, walled.shared, strict=True):
            assert (depth >= 0.4 * thin[0]).all()
            assert (depth < np.where(shared, 0.5, 0.75) * wall).all()
        assert (box.lower > [-body.length, 0.0, -body.width / 2]).all()
        assert (box.upper < [0.0, body.height, body.width / 2]).all()
    slots, chambers = slot_boxes(finger), layer_boxes(finger, 2 / 3)[1:]
    assert all(one.lower[0] > other.upper[0] for one, other in pairwise(chambers))
    for slot in (slot for slot in slots if slot.upper[1] > finger.channel.bottom - finger.chambers.height):
        assert all(slot.upper[0] < box.lower[0] or box.upper[0] < slot.lower[0] for box in chambers)


def test_layers_from_both_sides_of_a_wall_stay_apart() -> None:
    """A wall of 1.8 mm between two chambers: each side takes a third of it, half of two thirds."""
    finger = finger_from_dict({"slots": {"count": 0}, "chambers": {"pitch": 6.8}})
    behind, ahead = layer_boxes(finger, 0.5)[1:3]
    assert (behind.lower[0], ahead.upper[0]) == pytest.approx((-21.6, -22.2))


@pytest.mark.parametrize("layers", [2, 3])
def test_every_thin_wall_has_the_layers(layers: int) -> None:
    """The walls are those of sides and back, and between chambers; a report counts 95 % of their area."""
    finger = finger_from_dict(
        {
            "body": {"length": 40.0, "height": 15.0, "width": 12.0, "tip_height": 12.0, "taper_length": 5.0,
                     "base_length": 4.0},
            "channel": {"start": 8.0, "end": 30.0, "bottom": 10.0, "top": 12.0, "width": 8.0},
            "chambers": {"count": 3, "width": 4.0, "pitch": 9.0, "first": 8.0, "height": 5.0, "depth": 8.0},
            "slots": {"count": 1, "first": 14.0, "width": 1.0, "depth": 8.0},
            "stiff_layer": {"thickness": 0.0},
            "mesh": {"largest": 6.0, "smallest": 4.8 / layers, "elements_across_walls": layers},
        }
    )  # fmt: skip
    assert layer_count(finger) == layers
    mesh = mesh_finger(finger)
    assert min(across(mesh, 3.1)) == layers
    assert radius_ratios(mesh.nodes, mesh.elements).min() > 0.15


# The size that gives a number of nodes, on geometries whose number of nodes is a formula.


def spiral(count: int) -> VolumeMesh:
    """A string of tetrahedra with so many nodes."""
    turn = 0.5 * np.arange(count)
    nodes = np.column_stack([np.cos(turn), np.sin(turn), 0.1 * turn])
    return VolumeMesh("spiral", nodes, np.arange(count - 3)[:, None] + np.arange(4))


class Counted(Geometry):
    """A geometry with count(size) nodes; what it is asked for is kept."""

    def __init__(self, count: Callable[[float], float], **presets: float):
        self.count, self._presets = count, presets
        self.asked: list[float | None] = []

    @property
    def presets(self) -> dict[str, float]:
        return self._presets

    def mesh(self, size: float | None = None) -> VolumeMesh:
        self.asked.append(size)
        return spiral(round(self.count(5.0 if size is None else size)))


@examples(50)
@given(
    dimension=st.floats(1.5, 3.0), factor=st.floats(1e3, 1e5), nodes=st.integers(50, 5000), start=st.floats(0.5, 50.0)
)
def test_a_power_of_the_size_is_found(dimension: float, factor: float, nodes: int, start: float) -> None:
    geometry = Counted(lambda size: min(max(factor * size**-dimension, 4), 20_000), coarse=start)
    size, mesh = size_for_nodes(geometry, nodes)
    assert abs(len(mesh.nodes) / nodes - 1) <= WITHIN
    assert len(mesh.nodes) == len(geometry.mesh(size).nodes)
    assert len(geometry.asked) <= MOST_MESHES + 1


def test_search_without_presets_starts_at_the_own_size() -> None:
    geometry = Counted(lambda size: 4000 * size**-2.0)
    size, mesh = size_for_nodes(geometry, 700)
    assert geometry.asked[0] is None
    assert abs(len(mesh.nodes) / 700 - 1) <= WITHIN
    assert size == pytest.approx(math.sqrt(4000 / 700), rel=0.1)


def test_jump_over_the_number_is_refused_with_the_nearest() -> None:
    geometry = Counted(lambda size: 1000 if size > 5.0 else 2000, coarse=18.0)
    with pytest.raises(MeshError) as refused:
        size_for_nodes(geometry, 1400)
    assert str(refused.value).startswith(
        "nodes = 1400: no size was found that gives as many within 15%; the nearest mesh has 1000, with largest "
        "elements of "
    )


def test_sizes_that_the_body_refuses_are_limits_of_the_search() -> None:
    def count(size: float) -> float:
        if size > 5.0:
            raise MeshError("body.toml: size = 6: must be at most 5")
        if size < 1.0:
            raise MeshError("body.toml: size = 0.5: must be at least 1")
        return 10_000 * size**-3.0

    for nodes, largest in ((90, 5.0), (9000, 1.1)):
        size, mesh = size_for_nodes(Counted(count, coarse=3.0), nodes)
        assert abs(len(mesh.nodes) / nodes - 1) <= WITHIN
        assert size <= largest
    with pytest.raises(MeshError, match=r"nodes = 60: .* the nearest mesh has \d+, .*; body.toml: size = 6: must be"):
        size_for_nodes(Counted(count, coarse=3.0), 60)


def test_a_body_that_cannot_be_meshed_is_no_matter_of_its_size() -> None:
    def count(size: float) -> float:
        raise MeshError("body.toml: gmsh cannot mesh it")

    with pytest.raises(MeshError, match=r"^body.toml: gmsh cannot mesh it$"):
        size_for_nodes(Counted(count, coarse=10.0), 100)


@pytest.mark.parametrize("nodes", [-5, 0, 3, 1_000_001, 10**9])
def test_too_few_and_too_many_nodes_are_refused(nodes: int) -> None:
    geometry = Counted(lambda size: 100.0)
    with pytest.raises(MeshError, match=f"^nodes = {nodes}: must lie between 4, .*, and 1000000$"):
        size_for_nodes(geometry, nodes)
    assert geometry.asked == []


# Meshes of order 2: the sides of their elements follow the surfaces of the geometry.

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
