"""The pneumatic finger: its dimensions and their refusals, its groups, and its meshes in all shapes."""

import math
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from fingers import finger_from_dict, read_finger, refusal, sharp_fingers
from hypothesis import HealthCheck, given

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mechanics import select_nodes
from taichisoft.mechanics.selection import select_elements
from taichisoft.mesh import boundary_triangles, enclosed_volume, tetrahedron_volumes
from taichisoft.scene import data_folder
from taichisoft.scene.soft_body import NodeSelection, Selection
from taichisoft_meshing.finger_dimensions import ElementSizes, FingerParameters
from taichisoft_meshing.pneunet_finger import mesh_finger, surface_groups, thin_walls
from taichisoft_meshing.wall_quality import radius_ratios

TUTORIAL = data_folder() / "fingers" / "tutorial.toml"


def test_the_defaults_are_the_shipped_tutorials_finger() -> None:
    assert read_finger(TUTORIAL) == FingerParameters()


def test_the_volumes_are_the_tutorials() -> None:
    finger = FingerParameters()
    assert finger.solid_volume == pytest.approx(60050, rel=1e-12)
    assert finger.cavity_volume == pytest.approx(8887.5, rel=1e-12)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body": {"length": -115.0}}, "body.length = -115.0: input should be greater than 0"),
        ({"body": {"width": 0}}, "body.width = 0: input should be greater than 0"),
        ({"slots": {"depth": math.nan}}, "slots.depth = nan: input should be a finite number"),
        ({"slots": {"depth": math.inf}}, "slots.depth = inf: input should be a finite number"),
        ({"slots": {"count": -1}}, "slots.count = -1: input should be greater than or equal to 0"),
        ({"slots": {"count": 2.5}}, "slots.count = 2.5: input should be a valid integer"),
        ({"chambers": {"count": 0}}, "chambers.count = 0: input should be greater than or equal to 1"),
        ({"body": {"height": "30"}}, "body.height = '30': input should be a valid number"),
        ({"body": {"height": True}}, "body.height = True: input should be a valid number"),
        ({"body": 30.0}, "body = 30.0: must be a table, [body]"),
    ],
)
def test_a_wrong_value_is_named_with_its_key(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables) == message or refusal(tables).startswith(f"{message}, ")


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"slots": {"dept": 16.5}}, "slots.dept: unknown key; did you mean 'depth'?"),
        ({"chamber": {}}, "chamber: unknown key; did you mean 'chambers'?"),
        (
            {"zzz": 1},
            "zzz: unknown key; valid keys: wall, walls, body, slots, channel, chambers, inlet, stiff_layer, mesh",
        ),
    ],
)
def test_an_unknown_key_names_the_nearest_right_one(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables) == message


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body": {"tip_height": 30.0}}, "body.tip_height = 30: must be at most 29.9"),
        ({"body": {"taper_length": 115.0}}, "body.taper_length = 115: must be at most 114.9"),
        ({"body": {"length": 99.0}}, "channel.end = 99: must be at most 98.9 (to leave a wall at the tip)"),
        ({"body": {"height": 22.0}}, "channel.top = 22: must be at most 21.9 (to leave a wall at the back)"),
        ({"body": {"width": 15.0}}, "channel.width = 15: must be at most 14.8 (to leave walls at its sides)"),
        (
            {"channel": {"start": 0.05}},
            "channel.start = 0.05: must be at least 0.1 (to leave a wall at the base)",
        ),
        ({"channel": {"end": 16.0}}, "channel.end = 16: must be at least 16.1 (beyond channel.start)"),
        ({"channel": {"top": 19.5}}, "channel.top = 19.5: must be at least 19.6 (above channel.bottom)"),
        ({"channel": {"bottom": 4.05}}, "channel.bottom = 4.05: must be at least 4.1 (to leave a wall above"),
        ({"chambers": {"depth": 20.0}}, "chambers.depth = 20: must be at most 19.8 (to leave walls"),
        (
            {"chambers": {"height": 19.5}},
            "chambers.height = 19.5: must be at most 15.4 (to leave a wall above",
        ),
        ({"chambers": {"pitch": 5.0}}, "chambers.pitch = 5: must be at least 5.1 (beyond chambers.width)"),
        ({"chambers": {"first": 15.0}}, "chambers.first = 15: must be at least 16 (channel.start)"),
        (
            {"chambers": {"count": 8}},
            "chambers.count = 8: the last chamber would end 112 mm from the base, beyond channel.end = 99; "
            "must be at most 7",
        ),
        (
            {"slots": {"first": 0.05}},
            "slots.first = 0.05: must be at least 0.1 (to leave a wall at the base)",
        ),
        ({"slots": {"pitch": 2.5}}, "slots.pitch = 2.5: must be at least 2.6 (beyond slots.width)"),
        (
            {"slots": {"count": 7}},
            "slots.count = 7: the last slot would end 104.411 mm from the base; must end",
        ),
        (
            {"slots": {"depth": 19.5}},
            "slots.depth = 19.5: must be at most 19.4 (to leave a wall below the channel)",
        ),
        (
            {"slots": {"first": 21.05}},
            "slots.depth = 16.5: slot 1 (21.05 to 23.55 mm from the base) cuts into chamber 1, "
            "which begins at 16; must be at most 8.4, or the slots must pass between the chambers",
        ),
        ({"mesh": {"smallest": 19.0}}, "mesh.smallest = 19: must be at most 18 (mesh.largest)"),
        ({"mesh": {"largest": 0.1, "smallest": 0.1}}, "mesh.largest = 0.1: must be at least 0.44"),
    ],
)
def test_a_wall_that_vanishes_is_named_with_what_would_be_valid(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables).startswith(message)


def test_slots_below_the_chambers_may_stand_anywhere() -> None:
    finger = finger_from_dict({"slots": {"first": 16.0, "depth": 8.4}})
    assert finger.slots.depth == 8.4


def test_a_size_replaces_the_largest_and_scales_the_smallest(tmp_path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text("[mesh]\nlargest = 8.0\nsmallest = 4.0\nelements_across_walls = 3\ncurvature = 12\n")
    sizes = read_finger(path, size=6.0).mesh
    assert sizes == ElementSizes(largest=6.0, smallest=3.0, elements_across_walls=3, curvature=12)
    with pytest.raises(MeshError, match=r"mesh\.largest = -1\.0: input should be greater than 0"):
        read_finger(path, size=-1.0)


def test_a_file_that_is_absent_or_no_toml_is_refused_in_one_line(tmp_path) -> None:
    path = tmp_path / "finger.toml"
    with pytest.raises(MeshError, match=r"finger\.toml: no such file; a geometry file \(\.toml\) is needed$"):
        read_finger(path)
    for content in (b"length = \n", b"\xff\xfe"):
        path.write_bytes(content)
        with pytest.raises(MeshError, match=r"finger\.toml: not readable as TOML: [^\n]+$"):
            read_finger(path)


# Walls by their thickness, fillets, inlet, stiff layer and base: positions that follow, and refusals.


def test_the_tutorials_thin_walls() -> None:
    """Sides, slots to chambers (2.59 and 2.91: the slots are not quite in the middle), slots to channel."""
    assert sorted(set(thin_walls(FingerParameters()).round(6))) == [2.5, 2.5894, 2.9106, 3.0]


@pytest.mark.parametrize("tables", [{"wall": 2.0}, {"walls": {"side": 2.0}}])
def test_the_side_wall_takes_the_place_of_the_cavitys_width(tables: dict[str, Any]) -> None:
    finger = finger_from_dict({**tables, "chambers": {"depth": 15.0}})
    assert (finger.chambers.depth, finger.channel.width) == (16.0, 16.0)
    assert finger.body.width == 20.0
    assert thin_walls(finger)[0] == 2.0


def test_the_tutorials_thicknesses_give_the_tutorials_positions() -> None:
    walls = {"side": 2.5, "back": 8.0, "floor": 8.5, "web": 3.0}
    finger = finger_from_dict({"walls": walls})
    assert finger.model_copy(update={"walls": FingerParameters().walls}) == FingerParameters()


def test_each_thickness_decides_its_positions() -> None:
    finger = finger_from_dict({"walls": {"back": 6.0, "floor": 7.0, "web": 2.0, "slot": 2.0}})
    assert (finger.channel.bottom, finger.channel.top) == (21.5, 24.0)
    assert finger.chambers.height == 14.5
    assert finger.slots.depth == 19.5
    assert (finger.slots.first, finger.slots.width, finger.slots.pitch) == (23.0, 4.0, 13.0)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"wall": 0.0}, "wall = 0.0: input should be greater than 0"),
        ({"wall": -2.0}, "wall = -2.0: input should be greater than 0"),
        ({"wall": float("nan")}, "wall = nan: input should be a finite number"),
        ({"wall": 10.0}, "wall = 10: must be at most 9.95 (to leave a cavity in body.width)"),
        ({"wall": 0.05}, "channel.width = 19.9: must be at most 19.8 (to leave walls at its sides)"),
        ({"wall": 2.0, "walls": {"side": 2.0}}, "wall = 2: is short for walls.side, which is given too"),
        ({"walls": {"side": 12.0}}, "walls.side = 12: must be at most 9.95"),
        ({"walls": {"back": 28.0}}, "walls.back = 28: must be at most 27.4 (to leave room for the channel)"),
        ({"walls": {"floor": 19.5}}, "walls.floor = 19.5: must be at most 19.4 (to leave chambers below channel.b"),
        ({"walls": {"web": 19.5}}, "walls.web = 19.5: must be at most 19.4 (to leave slots below channel.bottom)"),
        ({"walls": {"slot": 4.0}}, "walls.slot = 4: must be at most 3.95 (to leave slots between the chambers)"),
        ({"walls": {"web": 2.0}, "slots": {"count": 0}}, "walls.web = 2: there are no slots, slots.count = 0"),
        ({"walls": {"sides": 2.0}}, "walls.sides: unknown key; did you mean 'side'?"),
        ({"slots": {"fillet_radius": 1.25}}, "slots.fillet_radius = 1.25: must be at most 1.2 (below half of slots"),
        ({"slots": {"fillet_radius": -1.0}}, "slots.fillet_radius = -1.0: input should be greater than or equal"),
        ({"chambers": {"fillet_radius": 2.5}}, "chambers.fillet_radius = 2.5: must be at most 2.45 (below half of"),
        (
            {"chambers": {"fillet_radius": 2.0, "height": 2.0}},
            "chambers.fillet_radius = 2: must be at most 1.9 (below chambers.height)",
        ),
        ({"inlet": {"diameter": 2.5}}, "inlet.diameter = 2.5: must be at most 2.3 (to open into the near end of"),
        ({"inlet": {"diameter": 2.0, "plug": 16.0}}, "inlet.plug = 16: must be at most 15.9 (to leave a bore"),
        ({"inlet": {"diameter": 2.0, "plug": 0.0}}, "inlet.plug = 0.0: input should be greater than 0"),
        ({"body": {"base_length": 16.0}}, "body.base_length = 16: must be at most 15.9 (to end before the channel)"),
        (
            {"body": {"base_length": 12.0}, "slots": {"first": 10.0, "depth": 5.0}},
            "body.base_length = 12: must be at most 9.9 (to end before the slots)",
        ),
        ({"stiff_layer": {"start": 100.0}}, "stiff_layer.end = 100: must be at least 100.1 (beyond stiff_layer.st"),
        ({"stiff_layer": {"end": 116.0}}, "stiff_layer.end = 116: must be at most 115 (body.length)"),
        ({"stiff_layer": {"thickness": 8.0}}, "stiff_layer.thickness = 8: must be at most 7.5 (body.height"),
        ({"stiff_layer": {"bottom": 30.0}}, "stiff_layer.bottom = 30: must be at most 29.9 (below body.height)"),
        ({"stiff_layer": {"width": 21.0}}, "stiff_layer.width = 21: must be at most 20 (body.width)"),
        ({"mesh": {"largest": 0.0}}, "mesh.largest = 0.0: input should be greater than 0"),
        ({"mesh": {"largest": -4.0}}, "mesh.largest = -4.0: input should be greater than 0"),
        ({"mesh": {"smallest": float("nan")}}, "mesh.smallest = nan: input should be a finite number"),
        ({"mesh": {"largest": 116.0}}, "mesh.largest = 116: must be at most 115 (body.length: elements larger th"),
        (
            {"mesh": {"elements_across_walls": 0}},
            "mesh.elements_across_walls = 0: input should be greater than or equal to 1",
        ),
    ],
)
def test_what_leaves_no_room_is_named_with_what_would_be_valid(tables: dict[str, Any], message: str) -> None:
    assert refusal(tables).startswith(message)


def test_what_is_absent_need_not_fit() -> None:
    """A layer of no thickness, a bore of no diameter and fillets of no slots may have any other dimension."""
    finger_from_dict({"stiff_layer": {"thickness": 0.0, "end": 500.0}, "inlet": {"plug": 99.0}})
    finger_from_dict({"slots": {"count": 0, "fillet_radius": 9.0}})


# Groups of a finger's mesh, which scenes select by name: they hold what a box would.

BASE = NodeSelection(box=((-10.0, 0.0, -20.0), (0.0, 30.0, 20.0)))
STIFF_LAYER = Selection(box=((-100.0, 22.5, -8.0), (-19.0, 28.0, 8.0)))


@pytest.fixture(
    scope="module", params=[ElementSizes(), ElementSizes(largest=10.0, smallest=10.0)], ids=["graded", "even"]
)
def mesh(request: pytest.FixtureRequest) -> VolumeMesh:
    return mesh_finger(FingerParameters(mesh=request.param))


def test_the_stiff_layer_is_what_the_tutorials_box_selects(mesh: VolumeMesh) -> None:
    by_group = select_elements(mesh, Selection(group="stiff_layer"), "regions.0")
    assert np.array_equal(by_group, select_elements(mesh, STIFF_LAYER, "regions.0"))


def test_base_block_lies_within_the_tutorials_box(mesh: VolumeMesh) -> None:
    by_group = select_nodes(mesh, NodeSelection(group="base_block"), "anchors.0")
    assert set(by_group) <= set(select_nodes(mesh, BASE, "anchors.0"))
    assert set(select_nodes(mesh, NodeSelection(group="base"), "anchors.0")) <= set(by_group)


def test_a_graded_mesh_ends_at_the_base_block() -> None:
    mesh = mesh_finger(FingerParameters())
    by_group = select_nodes(mesh, NodeSelection(group="base_block"), "anchors.0")
    assert np.array_equal(by_group, select_nodes(mesh, BASE, "anchors.0"))
    held = mesh.elements[mesh.element_groups["base_block"]]
    edges = mesh.nodes[held[:, 1:]] - mesh.nodes[held[:, :1]]
    assert np.linalg.det(edges).sum() / 6 == pytest.approx(10 * 30 * 20, rel=1e-9)


def test_a_finger_without_stiff_layer_has_no_such_group() -> None:
    assert set(mesh_finger(finger_from_dict({"stiff_layer": {"thickness": 0.0}})).element_groups) == {
        "silicone",
        "base_block",
    }


def test_a_layer_thinner_than_the_elements_is_refused() -> None:
    thin = finger_from_dict({"stiff_layer": {"thickness": 0.01, "start": 20.0, "end": 20.5}})
    with pytest.raises(MeshError) as refused:
        mesh_finger(thin, "finger.toml")
    assert str(refused.value) == (
        "finger.toml: stiff_layer.thickness = 0.01: no element has its middle in the layer; must be larger, or 0 for "
        "none, or mesh.largest = 18 smaller"
    )


# Groups of boundary triangles, from the closed pieces of a body's boundary.


def voxels(solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit cubes where `solid` says so, six tetrahedra each; x goes from 0 down to -len(solid)."""
    cells = np.argwhere(solid)
    steps = np.eye(3, dtype=int)
    elements = []
    for a, b in permutations(range(3), 2):
        path = [np.zeros(3, dtype=int), steps[a], steps[a] + steps[b], np.ones(3, dtype=int)]
        elements.append(np.stack([cells + step for step in path], axis=1))
    corners, indices = np.unique(np.vstack(elements).reshape(-1, 3), axis=0, return_inverse=True)
    tetrahedra = indices.reshape(-1, 4)
    nodes = corners * np.array([-1.0, 1.0, 1.0])
    inverted = np.linalg.det(nodes[tetrahedra[:, 1:]] - nodes[tetrahedra[:, :1]]) < 0
    tetrahedra[inverted] = tetrahedra[inverted][:, [0, 1, 3, 2]]
    return nodes, tetrahedra


def block_with_holes(*holes: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    solid = np.ones((9, 3, 3), dtype=bool)
    for hole in holes:
        solid[hole] = False
    return voxels(solid)


def test_a_body_without_a_cavity_has_a_skin_and_a_base() -> None:
    nodes, elements = block_with_holes()
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base"]
    assert enclosed_volume(nodes, surfaces["outer"]) == pytest.approx(81)
    assert len(surfaces["base"]) == 18
    assert (nodes[surfaces["base"], 0] == 0).all()


def test_the_only_cavity_has_no_number() -> None:
    nodes, elements = block_with_holes((4, 1, 1))
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base", "cavity"]
    assert enclosed_volume(nodes, surfaces["cavity"]) == pytest.approx(1)


def test_several_cavities_are_numbered_from_the_base_on() -> None:
    nodes, elements = block_with_holes((7, 1, 1), (1, 1, 1), (4, 1, 1), (5, 1, 1))
    nodes, elements = nodes[::-1], len(nodes) - 1 - elements  # their order decides nothing
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base", "cavity_0", "cavity_1", "cavity_2"]
    volumes = [enclosed_volume(nodes, surfaces[f"cavity_{number}"]) for number in range(3)]
    assert volumes == pytest.approx([1, 2, 1])
    assert [nodes[surfaces[f"cavity_{number}"], 0].max() for number in range(3)] == [-1, -4, -7]


def test_a_body_in_two_pieces_is_refused() -> None:
    nodes, elements = block_with_holes()
    with pytest.raises(MeshError, match="the body has 2 outer skins; it must be one piece of silicone"):
        surface_groups(np.vstack([nodes, nodes + 20]), np.vstack([elements, elements + len(nodes)]))


# Fingers of all shapes: the mesh has the volumes of the drawing, and its surfaces are closed.

FLAT = 1e-6
"""Largest error of a volume between flat faces; only rounding is missing, some 1e-14."""

# Without those of other kinds, which their own tests mesh.
SHIPPED = [file for file in sorted((data_folder() / "fingers").glob("*.toml")) if "\nkind" not in file.read_text()]


def silicone(mesh: VolumeMesh) -> float:
    return float(tetrahedron_volumes(mesh.nodes, mesh.elements).sum())


def air(mesh: VolumeMesh) -> float:
    return enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"])


def assert_closed(triangles: np.ndarray) -> None:
    """Every edge is passed exactly once in each direction."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert np.array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))


def assert_sound(mesh: VolumeMesh) -> None:
    """Positive elements, closed surfaces that together are the boundary, the base in its plane, groups in range."""
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).min() > 0
    groups = mesh.surface_groups
    assert list(groups) == ["outer", "base", "cavity"]
    assert_closed(groups["outer"])
    assert_closed(groups["cavity"])
    skins = np.sort(np.vstack([groups["outer"], groups["cavity"]]), axis=1)
    boundary = np.sort(boundary_triangles(mesh.elements), axis=1)
    assert np.array_equal(np.unique(skins, axis=0), np.unique(boundary, axis=0))
    assert len(skins) == len(boundary)
    assert np.array_equal(mesh.element_groups["silicone"], np.arange(len(mesh.elements)))
    assert (mesh.nodes[groups["base"], 0] == 0).all()


# Generation from scratch: shrinking a failure of gmsh would take minutes, and the tables are readable as they are.
@examples(12, derandomize=True, suppress_health_check=list(HealthCheck))
@given(sharp_fingers())
def test_any_sharp_finger_has_the_volumes_of_its_drawing(tables: dict[str, Any]) -> None:
    body, slots, channel, chambers = (tables[name] for name in ("body", "slots", "channel", "chambers"))
    mesh = mesh_finger(finger_from_dict(tables))
    assert_sound(mesh)
    duct = (channel["end"] - channel["start"]) * (channel["top"] - channel["bottom"]) * channel["width"]
    cavity = duct + chambers["count"] * chambers["width"] * chambers["height"] * chambers["depth"]
    taper = body["taper_length"] * (body["height"] - body["tip_height"]) / 2
    side_view = body["length"] * body["height"] - taper - slots["count"] * slots["width"] * slots["depth"]
    assert air(mesh) == pytest.approx(cavity, rel=FLAT)
    assert silicone(mesh) == pytest.approx(side_view * body["width"] - cavity, rel=FLAT)
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["base"]], 1, 0)
    base = np.cross(b - a, c - a).sum(axis=0) / 2
    assert base == pytest.approx([body["height"] * body["width"], 0, 0], rel=FLAT, abs=1e-9)


@pytest.mark.parametrize("file", SHIPPED, ids=[file.stem for file in SHIPPED])
def test_every_shipped_finger_is_meshed(file: Path) -> None:
    finger = read_finger(file)
    mesh = mesh_finger(finger)
    assert_sound(mesh)
    assert {"stiff_layer", "base_block"} <= set(mesh.element_groups)
    tolerance = 0.01 if finger.is_curved else FLAT
    assert air(mesh) == pytest.approx(finger.cavity_volume, rel=tolerance)
    assert silicone(mesh) == pytest.approx(finger.solid_volume - finger.cavity_volume, rel=tolerance)
    assert radius_ratios(mesh.nodes, mesh.elements).min() > 0.05  # slivers invert first in a large bend


def test_four_fingers_ship() -> None:
    assert [file.stem for file in SHIPPED] == ["long", "slim", "soft-tip", "tutorial"]


@pytest.mark.parametrize("curvature", [8, 16])
def test_the_air_lacks_what_lies_between_an_arc_and_its_chords(curvature: int) -> None:
    """A quarter of a circle of radius r has n = curvature / 4 chords at least; between n of them and it lie
    pi r^2 / 4 - n r^2 sin(pi / 2 n) / 2. gmsh may take a chord more than that, (n + 1) / n, and an edge aslant."""
    tables = {"chambers": {"fillet_radius": 1.5, "count": 2}, "slots": {"count": 1}, "mesh": {"curvature": curvature}}
    finger = finger_from_dict(tables)
    mesh = mesh_finger(finger)
    assert_sound(mesh)
    chords = curvature / 4
    between = 1.5**2 * (math.pi / 4 - chords * math.sin(math.pi / 2 / chords) / 2)
    fillets = 2 * finger.chambers.count
    most = fillets * between * finger.chambers.depth
    assert 0.9 * (chords / (chords + 1)) ** 2 * most < finger.cavity_volume - air(mesh) < most


def test_fillets_of_slots_add_silicone() -> None:
    sharp = FingerParameters()
    rounded = finger_from_dict({"slots": {"fillet_radius": 1.0}})
    assert rounded.solid_volume - sharp.solid_volume == pytest.approx(6 * 2 * (1 - math.pi / 4) * 20.0)
    assert rounded.cavity_volume == sharp.cavity_volume


def test_an_inlet_is_part_of_the_closed_cavity() -> None:
    finger = finger_from_dict({"inlet": {"diameter": 2.0, "plug": 4.0}, "mesh": {"curvature": 12}})
    mesh = mesh_finger(finger)
    assert_sound(mesh)
    assert finger.cavity_volume - FingerParameters().cavity_volume == pytest.approx(math.pi * 12.0)
    bore = mesh.nodes[np.unique(mesh.surface_groups["cavity"])]
    bore = bore[bore[:, 0] > -16.0 + 1e-6]
    np.testing.assert_allclose(bore.max(axis=0), [-4.0, 21.75, 1.0], atol=1e-6)
    np.testing.assert_allclose(np.hypot(bore[:, 1] - 20.75, bore[:, 2]).max(), 1.0, atol=1e-6)
    assert air(mesh) == pytest.approx(finger.cavity_volume, rel=1e-3)
