"""Bodies between surfaces, meshed: kept or new triangles, walls of two elements, volumes as the files have them."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block
from conftest import examples
from hypothesis import HealthCheck, example, given
from hypothesis import strategies as st
from solid_shapes import Surface, ball, box, save, together, turned_round

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, count_open_edges, enclosed_volume, read_surface, tetrahedron_volumes
from taichisoft_meshing import file_bodies
from taichisoft_meshing.file_bodies import SurfacesBody
from taichisoft_meshing.geometry_file import mesh_geometry, read_geometry
from taichisoft_meshing.gmsh_session import GmshFailure, _surfaces, compare_volumes
from taichisoft_meshing.inner_nodes import (
    cut_edges,
    through_edges,
    without_flat_skin,
    without_inverted,
    without_slivers,
)
from taichisoft_meshing.mesh_quality import QualityLimits, measure, missed_limits

# Flat faces: the volumes are those of the drawing, but for the single precision of STL.
FLAT = 1e-6


def body(folder: Path, outer: Surface, *cavities: Surface, **tables: Any) -> SurfacesBody:
    names = [save(cavity, folder / f"cavity{number}.stl").name for number, cavity in enumerate(cavities)]
    save(outer, folder / "body.stl")
    return SurfacesBody({"outer": "body.stl", "cavity": names, **tables}, folder / "body.toml")


def silicone(mesh: VolumeMesh) -> float:
    volumes = tetrahedron_volumes(mesh.nodes, mesh.elements)
    assert volumes.min() > 0
    return float(volumes.sum())


def assert_skins_are_the_boundary(mesh: VolumeMesh) -> None:
    """Closed, a cavity facing into the silicone, and all together exactly the boundary of the tetrahedra."""
    skins = {name: triangles for name, triangles in mesh.surface_groups.items() if name != "base"}
    assert all(count_open_edges(triangles) == 0 for triangles in skins.values())
    assert all(enclosed_volume(mesh.nodes, triangles) > 0 for triangles in skins.values())
    boundary = {tuple(sorted(triangle)) for triangle in boundary_triangles(mesh.elements).tolist()}
    assert {tuple(sorted(triangle)) for triangles in skins.values() for triangle in triangles.tolist()} == boundary
    assert sum(map(len, skins.values())) == len(boundary)


def test_flat_faces_keep_their_volume(tmp_path: Path) -> None:
    """A long box whose side has two cavities in it, one of them with a corner that points inward."""
    bent = trimesh.creation.extrude_triangulation(
        np.array([[0, 0], [8, 0], [8, 8], [4, 8], [4, 4], [0, 4.0]]),
        np.array([[0, 1, 4], [0, 4, 5], [1, 2, 4], [2, 3, 4]]),
        4.0,
    )
    bent.apply_translation([-10, -4, -2])
    geometry = body(tmp_path, box((30, 20, 20)), bent, box((5, 5, 5), (8, 0, 0)), mesh={"largest": 6})
    mesh = geometry.mesh()
    assert list(mesh.surface_groups) == ["outer", "cavity_0", "cavity_1"]
    assert silicone(mesh) == pytest.approx(12000 - 192 - 125, rel=FLAT)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity_0"]) == pytest.approx(192, rel=FLAT)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity_1"]) == pytest.approx(125, rel=FLAT)
    assert_skins_are_the_boundary(mesh)
    assert len(mesh.element_groups["silicone"]) == len(mesh.elements)
    finer = geometry.mesh(3.0)
    assert len(finer.nodes) > 2 * len(mesh.nodes)
    again = geometry.mesh()
    assert np.array_equal(again.nodes, mesh.nodes) and np.array_equal(again.elements, mesh.elements)


@pytest.mark.parametrize(
    "cavity", [ball(6, parts=3), trimesh.creation.torus(5, 3, 16, 16), trimesh.creation.cylinder(5, 10)]
)
def test_curved_surfaces_are_meshed_as_fine_as_their_curvature(tmp_path: Path, cavity: Surface) -> None:
    """Chords of a sixteenth turn cut off about 5 %, and the outside, which is flat, stays coarse."""
    mesh = body(tmp_path, box((30, 20, 20), parts=2), cavity, mesh={"largest": 5}).mesh()
    wall = enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"])
    assert 0.93 * cavity.volume < wall < cavity.volume
    assert silicone(mesh) == pytest.approx(12000 - wall, rel=1e-9)
    assert_skins_are_the_boundary(mesh)
    assert len(mesh.surface_groups["outer"]) < 500
    coarse = len(mesh.surface_groups["cavity"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is coarse
        rough = body(tmp_path, box((30, 20, 20), parts=2), cavity, mesh={"largest": 5, "curvature": 8}).mesh()
    assert len(rough.surface_groups["cavity"]) < 0.6 * coarse


def test_the_outside_may_be_curved_too(tmp_path: Path) -> None:
    mesh = body(tmp_path, ball(10, parts=3), ball(6, parts=3), mesh={"largest": 10}).mesh()
    for name, wanted in (("outer", ball(10, parts=3).volume), ("cavity", ball(6, parts=3).volume)):
        assert 0.93 * wanted < enclosed_volume(mesh.nodes, mesh.surface_groups[name]) < wanted


def test_a_coarse_mesh_of_a_curved_cavity_is_said(tmp_path: Path) -> None:
    geometry = body(tmp_path, box((30, 20, 20)), ball(6, parts=3), mesh={"largest": 7, "curvature": 8})
    with pytest.warns(UserWarning, match=r"body.toml: cavity has \d+.* instead of 896.\d+, .*% off: the curved"):
        geometry.mesh()


def test_the_given_triangles_can_be_kept(tmp_path: Path) -> None:
    """Node for node and triangle for triangle, in the files' order."""
    cavity = ball(6, parts=2)
    geometry = body(tmp_path, together(box((30, 20, 20), parts=2), turned_round(cavity)), keep_surface=True, cavities=1)
    mesh = geometry.mesh(5.0)
    shells = (geometry.body.outer, *geometry.body.cavities)
    given = np.vstack([shell.vertices for shell in shells])
    assert np.array_equal(mesh.nodes[: len(given)], given)
    assert len(mesh.nodes) > len(given)
    start = 0
    for name, shell in zip(("outer", "cavity"), shells, strict=True):
        wanted = {tuple(np.roll(triangle, -triangle.argmin())) for triangle in shell.triangles + start}
        assert {tuple(np.roll(triangle, -triangle.argmin())) for triangle in mesh.surface_groups[name]} == wanted
        start += len(shell.vertices)
    assert silicone(mesh) == pytest.approx(12000 - cavity.volume, rel=1e-6)
    assert silicone(mesh) == pytest.approx(geometry.body.volume, rel=1e-9)
    assert_skins_are_the_boundary(mesh)


half_sides = st.tuples(*[st.floats(1.0, 4.0)] * 3)
places = st.tuples(*[st.floats(-0.9, 0.9)] * 3)


@examples(6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(half_sides, places, st.booleans())
@example((1, 3, 4), (0, 0.5, 0.75), True)  # gmsh's relocation inverts four tetrahedra
def test_any_box_in_a_box(tmp_path: Path, half: tuple, place: tuple, keep: bool) -> None:
    """Volumes are exact and the cavity is closed, for walls of at least 0.3 mm."""
    outer = np.array([30.0, 14.0, 12.0])
    at = np.array(place) * (outer / 2 - half - 0.3)
    geometry = body(tmp_path, box(outer), box(2 * np.array(half), at), keep_surface=keep, mesh={"largest": 6})
    mesh = geometry.mesh()
    wall = 8 * np.prod(half)
    assert silicone(mesh) == pytest.approx(np.prod(outer) - wall, rel=FLAT)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"]) == pytest.approx(wall, rel=2 * FLAT)
    assert_skins_are_the_boundary(mesh)


def test_smaller_elements_at_the_cavity(tmp_path: Path) -> None:
    tables = {"largest": 8}
    even = body(tmp_path, box((60, 20, 20)), box((6, 6, 6), (20, 0, 0)), mesh=tables).mesh()
    graded = body(tmp_path, box((60, 20, 20)), box((6, 6, 6), (20, 0, 0)), mesh={**tables, "smallest": 2}).mesh()
    assert len(graded.surface_groups["cavity"]) > 5 * len(even.surface_groups["cavity"])

    def far(mesh: VolumeMesh) -> int:
        return int((mesh.nodes[np.unique(mesh.surface_groups["outer"]), 0] < -10).sum())

    assert far(graded) < 1.5 * far(even)


def test_the_base_is_chosen_by_a_plane(tmp_path: Path) -> None:
    base = {"point": [-15, 3, 4], "normal": [-2, 0, 0]}
    mesh = body(tmp_path, box((30, 20, 20)), base=base, cavities=0, mesh={"largest": 10}).mesh()
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["base"]], 1, 0)
    assert np.cross(b - a, c - a).sum(axis=0) / 2 == pytest.approx([-400, 0, 0], abs=1e-3)
    assert list(mesh.surface_groups) == ["outer", "base"]


def test_another_way_is_tried_when_one_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[tuple[bool, int]] = []
    classify = file_bodies._classify

    def failing(model: Any, shells: Any, angle: float, cut: bool) -> Any:
        tried.append((cut, len(shells)))
        if len(tried) < 3:
            raise GmshFailure("no luck")
        return classify(model, shells, angle, cut)

    monkeypatch.setattr(file_bodies, "_classify", failing)
    mesh = body(tmp_path, box((30, 20, 20)), box((4, 4, 4)), mesh={"largest": 10}).mesh()
    assert tried == [(False, 2), (True, 2), (True, 2)]
    assert silicone(mesh) == pytest.approx(12000 - 64, rel=FLAT)
    monkeypatch.setattr(file_bodies, "_classify", lambda *_: (_ for _ in ()).throw(GmshFailure("no luck")))
    with pytest.raises(MeshError, match=r"^gmsh cannot mesh .*body.toml: no luck; gmsh's log is .*log$"):
        body(tmp_path, box((30, 20, 20)), cavities=0).mesh()


def test_a_body_without_a_cavity_is_said(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=r"body.stl: the body has no cavity$"):
        assert body(tmp_path, box((30, 20, 20))).body.cavities == ()


@pytest.mark.parametrize(
    ("tables", "problem"),
    [
        ({}, "outer: this key is missing"),
        ({"outer": "body.stl", "cavities": 2}, "cavities = 2: the files have 1$"),
        ({"outer": "body.stl", "cavty": "x.stl"}, "cavty: unknown key; did you mean 'cavity'"),
        ({"outer": "body.stl", "scale": 0}, "scale = 0: input should be greater than 0"),
        ({"outer": "body.stl", "cavity": 3}, "cavity = 3: must be a list"),
        ({"outer": "body.stl", "keep_surface": "yes"}, "keep_surface = 'yes': input should be a valid boolean"),
        ({"outer": "body.stl", "feature_angle": 200}, "feature_angle = 200: input should be less than 180"),
        (
            {"outer": "body.stl", "mesh": {"largest": float("nan")}},
            "mesh.largest = nan: input should be a finite number",
        ),
        ({"outer": "body.stl", "mesh": {"largest": -1}}, "mesh.largest = -1: input should be greater than 0"),
        (
            {"outer": "body.stl", "mesh": {"largest": 2, "smallest": 3}},
            "mesh: smallest = 3: must be at most largest, 2",
        ),
        ({"outer": "body.stl", "mesh": {"smallest": 3}}, "mesh: smallest = 3: needs largest beside it"),
        ({"outer": "body.stl", "mesh": {"largest": 31}}, "size 31: is larger than the body; must be at most 30 mm"),
        (
            {"outer": "body.stl", "mesh": {"largest": 0.01}},
            "size = 0.01: must be at least 0.27 mm; it would make about ",
        ),
        ({"outer": "body.stl", "base": {"point": [0, 0, 0]}}, "base.normal"),
        (
            {"outer": "body.stl", "base": {"point": [0, 0, 0], "normal": [0, 0, 0]}},
            r"base: normal = \[0, 0, 0\]: has no d",
        ),
        (
            {"outer": "body.stl", "base": {"point": [0, 0, 0], "normal": [1, 0, 0]}, "mesh": {"largest": 10}},
            r"base: no triangle of the outer surface lies in this plane; it spans \[-15.0, -10.0, -10.0\] to",
        ),
    ],
)
def test_what_is_wrong_in_the_tables_is_told(tmp_path: Path, tables: dict, problem: str) -> None:
    save(together(box((30, 20, 20)), turned_round(box((4, 4, 4)))), tmp_path / "body.stl")
    with pytest.raises(MeshError, match=f"^{tmp_path}/body.toml: {problem}"):
        SurfacesBody(tables, tmp_path / "body.toml").mesh()


def test_a_file_names_its_surfaces_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "parts").mkdir()
    save(box((30, 20, 20)), tmp_path / "parts" / "body.stl")
    save(box((4, 4, 4)), tmp_path / "parts" / "cavity.ply")
    file = tmp_path / "finger.toml"
    file.write_text('kind = "surfaces"\nouter = "parts/body.stl"\ncavity = "parts/cavity.ply"\nmesh.largest = 10\n')
    geometry = read_geometry(file)
    assert geometry.presets == {"coarse": 3.44, "medium": 1.72, "fine": 0.859}  # type: ignore[attr-defined]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = mesh_geometry(geometry, None, file)
    assert silicone(mesh) == pytest.approx(12000 - 64, rel=FLAT)
    assert mesh.source == str(file)


# Walls of two elements between unchanged surfaces.


@examples(20)
@given(st.tuples(*[st.integers(1, 4)] * 3), st.integers(0, 1000))
def test_cut_edges_keep_the_volume_and_the_boundary(cells: tuple[int, int, int], seed: int) -> None:
    """The parts of a block with shaken nodes have positive volumes and meet face to face."""
    block = make_block(cells, (3.0, 4.0, 5.0))
    nodes = block.nodes + np.random.default_rng(seed).uniform(-0.1, 0.1, block.nodes.shape)
    through = through_edges(block.elements)
    cut_nodes, cut, parents = cut_edges(nodes, block.elements, through)
    parts = np.bincount(parents, tetrahedron_volumes(cut_nodes, cut))
    np.testing.assert_allclose(parts, tetrahedron_volumes(nodes, block.elements), rtol=1e-9)
    assert len(cut_nodes) == len(nodes) + len(through)
    assert np.array_equal(cut_nodes[: len(nodes)], nodes)
    volumes = tetrahedron_volumes(cut_nodes, cut)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(tetrahedron_volumes(nodes, block.elements).sum(), rel=1e-12)
    before, after = (np.sort(boundary_triangles(elements), axis=1) for elements in (block.elements, cut))
    assert np.array_equal(np.unique(before, axis=0), np.unique(after, axis=0))
    assert len(through_edges(cut)) == 0


def test_an_edge_between_the_inside_and_the_boundary_stays() -> None:
    """The edges inside 2 x 2 x 2 boxes are those around the node in the middle, and those that cut corners."""
    block = make_block((2, 2, 2), (2.0, 2.0, 2.0))
    middle = int(np.argmin(np.linalg.norm(block.nodes, axis=1)))
    through = through_edges(block.elements)
    assert len(through) > 0
    assert (through != middle).all()
    assert (through[:, 0] < through[:, 1]).all()


@examples(20)
@given(st.integers(0, 1000), st.floats(0.1, 2.0))
def test_nodes_moved_through_a_face_go_back(seed: int, distance: float) -> None:
    """Shaken by up to two edges: no element is inverted, and nodes are either where they were or where they went."""
    block = make_block((3, 3, 3), (3.0, 3.0, 3.0))
    moved = block.nodes + np.random.default_rng(seed).uniform(-distance, distance, block.nodes.shape)
    kept = without_inverted(block.nodes, moved, block.elements)
    assert tetrahedron_volumes(kept, block.elements).min() > 0
    back, there = (kept == block.nodes).all(axis=1), (kept == moved).all(axis=1)
    assert (back | there).all()
    if (tetrahedron_volumes(moved, block.elements) > 0).all():
        assert there.all()


def test_overlapping_parts_are_united_on_request(tmp_path: Path) -> None:
    """Two bars of one file, crossed as a T, and a chamber in one: the volume is that of the drawing."""
    bars = together(box((30, 10, 10)), box((10, 30, 10), (0, 12, 0)), turned_round(box((6, 4, 4), (-8, 0, 0))))
    with pytest.raises(MeshError, match="parts of one body, unite = true joins them"):
        body(tmp_path, bars).mesh()
    mesh = body(tmp_path, bars, unite=True, cavities=1, mesh={"largest": 6}).mesh()
    assert_skins_are_the_boundary(mesh)
    overlap = 10 * 8 * 10
    assert silicone(mesh) == pytest.approx(3000 + 3000 - overlap - 96, rel=1e-5)
    with pytest.raises(MeshError, match="unite = true: has one part only"):
        body(tmp_path, box((30, 10, 10)), unite=True).mesh()


@examples(10)
@given(st.integers(0, 1000), st.floats(0.99, 0.9999))
def test_slivers_vanish_by_moves_of_inner_nodes(seed: int, part: float) -> None:
    """A node inside, moved until tetrahedra around it are nearly flat, comes back among them; all others stay."""
    block = make_block((3, 3, 3), (3.0, 3.0, 3.0))
    inside = np.setdiff1d(block.elements, boundary_triangles(block.elements))
    node = int(np.random.default_rng(seed).choice(inside))
    element = block.elements[(block.elements == node).any(axis=1)][0]
    nodes = block.nodes.copy()
    nodes[node] += part * (nodes[element[element != node]].mean(axis=0) - nodes[node])
    flat = replace(block, nodes=nodes)
    assert measure(flat).radius_ratios.min() < 0.03
    mended = without_slivers(flat)
    assert measure(mended).radius_ratios.min() > 0.03
    assert tetrahedron_volumes(mended.nodes, mended.elements).min() > 0
    stayed = np.isin(np.arange(len(nodes)), inside, invert=True)
    assert np.array_equal(mended.nodes[stayed], nodes[stayed])
    assert without_slivers(mended) is mended


@pytest.mark.parametrize("sides", [2, 3])
def test_flat_slivers_on_a_surface_are_left_out(sides: int) -> None:
    """On a block lies a pyramid without height, or on its bent top a tetrahedron in the hollow of two triangles."""
    block = make_block((3, 3, 1), (3.0, 3.0, 1.0))
    nodes, elements, upper = block.nodes.copy(), block.elements, block.nodes[:, 2] == block.nodes[:, 2].max()
    nodes[upper, 2] += 0.01 * nodes[upper, 0] ** 2
    top = [its for its in boundary_triangles(elements).tolist() if upper[its].all()]
    if sides == 3:
        nodes = np.vstack([nodes, nodes[top[0]].mean(axis=0) + 0.01 * np.array([0.0, 0.0, 1.0])])
        added = [*top[0], len(nodes) - 1]
    else:
        quads = [[*its, *set(other) - set(its)] for its in top for other in top if len(set(its) & set(other)) == 2]
        added = next(quad for quad in quads if tetrahedron_volumes(nodes, np.array([quad]))[0] > 1e-4)
    elements = np.vstack([elements, added]).astype(np.int32)
    everything = np.arange(len(elements), dtype=np.int32)
    flat = VolumeMesh("flat", nodes, elements, {"outer": boundary_triangles(elements)}, {"silicone": everything})
    assert measure(flat.check()).radius_ratios.min() < 0.03
    mended = without_flat_skin(flat)
    assert np.array_equal(mended.elements, block.elements)
    assert len(mended.nodes) == len(block.nodes)
    assert_skins_are_the_boundary(mended)
    assert without_flat_skin(mended) is mended


def test_a_kept_surface_gets_walls_of_two_elements(tmp_path: Path) -> None:
    save(box((30, 20, 20), parts=2), tmp_path / "body.stl")
    save(box((24, 14, 14), parts=2), tmp_path / "cavity.stl")
    meshes = []
    for across in ({"elements_across_walls": 1}, {}):  # two unless somebody wants fewer
        tables = {
            "outer": "body.stl",
            "cavity": "cavity.stl",
            "keep_surface": True,
            "mesh": {**across, "largest": 10},
            "base": {"point": [15, 0, 0], "normal": [1, 0, 0]},
        }
        meshes.append(SurfacesBody(tables, tmp_path / "body.toml").mesh())
    plain, split = meshes
    assert measure(plain).elements_across_walls == 1
    assert measure(split).elements_across_walls == 2
    for name, triangles in plain.surface_groups.items():
        assert np.array_equal(split.surface_groups[name], triangles)
    on_surfaces = np.unique(boundary_triangles(plain.elements))
    assert np.array_equal(split.nodes[on_surfaces], plain.nodes[on_surfaces])
    assert tetrahedron_volumes(split.nodes, split.elements).sum() == pytest.approx(12000 - 24 * 14 * 14, rel=1e-9)
    assert len(split.element_groups["silicone"]) == len(split.elements)


def test_how_many_elements_are_one_or_two(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"body.toml: mesh.elements_across_walls = 3: input should be 1 or 2$"):
        SurfacesBody({"outer": "body.stl", "mesh": {"elements_across_walls": 3}}, tmp_path / "body.toml")


# Meshes of gmsh are compared with the bodies that they should be.


@pytest.fixture
def block() -> VolumeMesh:
    """27 boxes of 10 mm less the inner one, in tetrahedra: 26000 mm^3 around 1000."""
    return make_block((3, 3, 3), (30.0, 30.0, 30.0), hollow=True)


@pytest.mark.parametrize(
    ("silicone", "cavity", "tolerance", "problem"),
    [
        (26000.1, 1000, 1e-6, r"^block: silicone has 26000 mm\^3 in the mesh instead of 26000.1, 0.00038 % off; try"),
        (26000, 1010, 1e-6, r"^block: cavity has 1000 mm\^3 in the mesh instead of 1010, 0.99 % off; try another"),
        (26000, 1400, None, r"^block: cavity has 1000 mm\^3 in the mesh instead of 1400, 29 % off; try another si"),
    ],
)
def test_a_wrong_volume_is_refused(
    block: VolumeMesh, silicone: float, cavity: float, tolerance: float | None, problem: str
) -> None:
    compare_volumes(block, 26000, [1000], 1e-9)
    with pytest.raises(MeshError, match=problem):
        compare_volumes(block, silicone, [cavity], tolerance)


def test_what_chords_cut_off_is_said(block: VolumeMesh) -> None:
    with pytest.warns(UserWarning, match=r"^block: cavity has 1000 mm\^3 .* 1150, 13 % off: the curved surfaces are"):
        compare_volumes(block, 26000, [1150], None)


def test_surfaces_must_be_the_whole_boundary(block: VolumeMesh) -> None:
    boundary = boundary_triangles(block.elements)
    cavity = block.surface_groups["cavity"]
    outer = boundary[~np.isin(np.sort(boundary), cavity).all(axis=1)]
    shells = _surfaces(block.elements, [outer[:, ::-1], cavity])  # in whatever sense gmsh has them
    assert [enclosed_volume(block.nodes, shell) for shell in shells] == pytest.approx([27000, -1000])
    for wrong in ([outer], [outer, cavity[1:]], [outer, cavity, block.elements[:1, :3]]):
        with pytest.raises(GmshFailure, match="the tetrahedra do not end at the surfaces"):
            _surfaces(block.elements, wrong)


def test_a_surface_that_was_to_be_kept_and_was_not_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """gmsh may put a node on an edge that it cannot have otherwise; here one is moved."""
    meshed = file_bodies.meshed_body

    def moved(*arguments: Any) -> VolumeMesh:
        mesh = meshed(*arguments)
        mesh.nodes[0] += 1e-9
        return mesh

    monkeypatch.setattr(file_bodies, "meshed_body", moved)
    save(box((30, 20, 20)), tmp_path / "body.stl")
    geometry = SurfacesBody({"outer": "body.stl", "cavities": 0, "keep_surface": True}, tmp_path / "body.toml")
    with pytest.raises(
        MeshError, match=r"body.toml: gmsh cannot fill the body without changing its surface; remove keep"
    ):
        geometry.mesh()


# The surfaces of the PneuNet gripper tutorial, which are not part of the project.

MESHES = Path(__file__).resolve().parents[2].parent / "shared" / "tutorial-meshes"
OUTER, CAVITY = "pneunetCut.stl", "pneunetCavityCut.stl"
BASE = {"point": [0, 0, 0], "normal": [1, 0, 0]}

needs_tutorial = pytest.mark.skipif(
    not (MESHES / OUTER).is_file(), reason="needs ../shared/tutorial-meshes, which are not part of the project"
)


@needs_tutorial
@pytest.mark.parametrize(("keep", "cavity"), [(False, [CAVITY]), (True, [CAVITY]), (True, [])])
def test_the_tutorials_finger(keep: bool, cavity: list[str]) -> None:
    """The first file has both surfaces; the cavity that the second one repeats is still one."""
    tables = {"outer": OUTER, "cavity": cavity, "keep_surface": keep, "cavities": 1, "base": BASE}
    tables["mesh"] = {"elements_across_walls": 1}
    mesh = SurfacesBody(tables, MESHES / "finger.toml").mesh(10.0)
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).sum() == pytest.approx(51162.5, rel=1e-8)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"]) == pytest.approx(8887.5, rel=1e-9)
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["base"]], 1, 0)
    assert np.cross(b - a, c - a).sum(axis=0) / 2 == pytest.approx([600, 0, 0], abs=1e-3)
    if keep:
        assert len(mesh.surface_groups["outer"]) + len(mesh.surface_groups["cavity"]) == 2968
        given = read_surface(MESHES / OUTER)[0]
        first = mesh.nodes[: len(given)]
        assert np.array_equal(first[np.lexsort(first.T)], given[np.lexsort(given.T)])
    else:
        assert 550 < len(mesh.nodes) < 700


def test_thin_walls_are_meshed_again(tmp_path: Path) -> None:
    """A ball with a wall of 0.5 mm, and elements of 8 mm: shorter ones in the wall, and moved nodes, keep the limits.

    Of elements of 12 mm none may be shorter than 3 mm, six times the wall, so that two times it makes no other meshes.
    """
    geometry = body(tmp_path, ball(15), ball(14.5), mesh={"largest": 8})
    with pytest.warns(UserWarning, match="flat in thin walls; tried again with 4 times the .*, but no less than 2 mm$"):
        mesh = geometry.mesh()
    assert_skins_are_the_boundary(mesh)
    assert not missed_limits(measure(mesh), QualityLimits())
    assert silicone(mesh) == pytest.approx(geometry.body.volume, rel=0.04)
    with pytest.warns(UserWarning, match="tried again") as warned:
        geometry.mesh(12.0)
    assert ["tried again" in str(warning.message) for warning in warned].count(True) == 1


THIN = MESHES.parent / "strangers" / "meshes"


@pytest.mark.skipif(not THIN.is_dir(), reason="needs ../shared/strangers, which are not part of the project")
@pytest.mark.parametrize("size", [None, 6.0])
def test_thin_walls_of_others_keep_the_limits(size: float | None) -> None:
    """SofaGym's finger with four chambers, which had slivers of 0.0006 to 0.015."""
    geometry = SurfacesBody({"outer": "sg_finger.stl"}, THIN / "body.toml")
    mesh = geometry.mesh(size)
    assert_skins_are_the_boundary(mesh)
    assert not missed_limits(measure(mesh), QualityLimits())
    assert silicone(mesh) == pytest.approx(geometry.body.volume, rel=0.04)
