"""Bodies of STEP files: read, refused, meshed, with solids, faces, cavities and openings by their numbers."""

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from solid_shapes import write_step

import taichisoft
from taichisoft.errors import MeshError
from taichisoft.mesh import (
    VolumeMesh,
    boundary_triangles,
    count_open_edges,
    element_volumes,
    enclosed_volume,
    tetrahedron_volumes,
)
from taichisoft.scene import scene_from_dict
from taichisoft_meshing.body_pictures import draw_faces, labels_apart
from taichisoft_meshing.cad_body import cap_triangles, read_step, rims
from taichisoft_meshing.file_bodies import StepBody
from taichisoft_meshing.geometry_file import mesh_geometry, read_geometry
from taichisoft_meshing.inner_nodes import through_edges
from taichisoft_meshing.mesh_commands import with_options
from taichisoft_meshing.mesh_job import MeshJob, mesh_for_scene
from taichisoft_meshing.mesh_quality import faults, measure
from taichisoft_meshing.wall_quality import find_walls


def two_voids(occ: Any) -> None:
    """A block of 12000 mm^3 with a ball and a box in it."""
    voids = [(3, occ.addSphere(10, 10, 10, 5)), (3, occ.addBox(20, 8, 8, 4, 4, 4))]
    occ.cut([(3, occ.addBox(0, 0, 0, 30, 20, 20))], voids)


def test_a_body_with_two_voids(tmp_path: Path) -> None:
    solid = read_step(write_step(tmp_path / "body.step", two_voids))
    assert sorted(solid.void_volumes) == pytest.approx([64, 4 / 3 * np.pi * 125], rel=1e-9)
    assert solid.volume == pytest.approx(12000 - sum(solid.void_volumes), rel=1e-9)
    assert solid.extent == pytest.approx([30, 20, 20], abs=1e-5)
    assert not solid.flat


def test_a_file_in_metres_is_taken_to_millimetres(tmp_path: Path) -> None:
    """And one in millimetres is read as such after it."""
    path = write_step(tmp_path / "body.stp", lambda occ: occ.addBox(0, 0, 0, 3, 2, 1))
    millimetres = path.read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in millimetres
    metres = tmp_path / "metres.step"
    metres.write_text(millimetres.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    for _ in range(2):
        assert read_step(metres).volume == pytest.approx(6e9)
        assert read_step(path).volume == pytest.approx(6.0)
    assert read_step(path).flat


def body_in_a_void(occ: Any) -> None:
    occ.cut([(3, occ.addBox(0, 0, 0, 10, 10, 10))], [(3, occ.addBox(2, 2, 2, 6, 6, 6))])
    occ.addBox(4, 4, 4, 2, 2, 2)


@pytest.mark.parametrize(
    ("draw", "problem"),
    [
        (
            lambda occ: [occ.addBox(0, 0, 0, 10, 20, 20), occ.addBox(40, 0, 0, 10, 10, 10)],
            r"has 2 solids, of 4000, 1000 mm\^3, and solid 2 shares no face with those joined to solid 1",
        ),
        (body_in_a_void, r"has 2 solids, of 784, 8 mm\^3, and solid 2 shares no face"),
        (lambda occ: occ.addRectangle(0, 0, 0, 1, 1), "has no solid body, and 1 face; export the body as a solid"),
    ],
)
def test_one_body_of_solids_is_needed(tmp_path: Path, draw: Callable[[Any], object], problem: str) -> None:
    path = write_step(tmp_path / "body.step", draw)
    with pytest.raises(MeshError, match=f"^{path}: {problem}"):
        read_step(path)


def edited(change: Callable[[str], str]) -> Callable[[Path], None]:
    def edit(path: Path) -> None:
        write_step(path, lambda occ: occ.addBox(0, 0, 0, 1, 1, 1))
        text = path.read_text()
        assert change(text) != text
        path.write_text(change(text))

    return edit


@pytest.mark.parametrize(
    ("write", "problem"),
    [
        (lambda path: None, r"no such file; a STEP file \(.step, .stp\) is needed"),
        (lambda path: path.mkdir(), "cannot be read: Is a directory"),
        (lambda path: path.write_text(" \n"), "is not a STEP file: it does not begin with ISO"),
        (
            lambda path: path.write_text("solid body\nendsolid"),
            "is not a STEP file: it does not begin with ISO-10303-21",
        ),
        (lambda path: path.write_text("ISO-10303-21;\nHEADER;\nEND-ISO-10303-21;\n"), "it has no section DATA"),
        (edited(lambda text: text[: len(text) // 2]), "stops too early: it does not end with END-ISO-10303-21"),
        (
            edited(lambda text: text.replace("(0.,0.,0.)", "(0.,NaN,0.)", 1)),
            r"line \d+ has the number NaN, which is not finite",
        ),
        (edited(lambda text: text.replace("CLOSED_SHELL", "OPEN_WORD")), "has no solid body|not readable as STEP"),
    ],
)
def test_files_that_are_no_step_files_are_told(tmp_path: Path, write: Callable[[Path], None], problem: str) -> None:
    path = tmp_path / "body.step"
    write(path)
    with pytest.raises(MeshError, match=f"^{path}: .*({problem})"):
        read_step(path)


def test_another_suffix_is_told(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"body.iges: '.iges' is not a kind of STEP file; valid: .step, .stp$"):
        read_step(tmp_path / "body.iges")


def test_names_that_read_like_numbers_are_names(tmp_path: Path) -> None:
    path = tmp_path / "body.step"
    edited(lambda text: text.replace("MANIFOLD_SOLID_BREP(''", "MANIFOLD_SOLID_BREP('(NaN,inf)'"))(path)
    assert read_step(path).volume == pytest.approx(1.0)


# Bodies from STEP files, meshed.


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three bodies: flat faces and a box in it, a ball and a box in it, and no void."""
    folder = tmp_path_factory.mktemp("step")
    write_step(folder / "flat.step", flat)
    write_step(folder / "voids.step", two_voids)
    write_step(folder / "full.step", lambda occ: occ.addBox(0, 0, 0, 10, 10, 10))
    return folder


def flat(occ: Any) -> None:
    occ.cut([(3, occ.addBox(0, 0, 0, 30, 20, 20))], [(3, occ.addBox(20, 8, 8, 4, 4, 4))])


def body(folder: Path, name: str, **tables: Any) -> StepBody:
    return StepBody({"file": name, **tables}, folder / "body.toml")


def test_flat_faces_keep_their_volume(folder: Path) -> None:
    base = {"point": [30, 0, 0], "normal": [1, 0, 0]}
    geometry = body(folder, "flat.step", cavities=1, base=base, mesh={"largest": 6})
    mesh = geometry.mesh()
    assert list(mesh.surface_groups) == ["outer", "cavity", "base"]
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).sum() == pytest.approx(12000 - 64, rel=1e-9)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"]) == pytest.approx(64, rel=1e-9)
    assert enclosed_volume(mesh.nodes, mesh.surface_groups["outer"]) == pytest.approx(12000, rel=1e-9)
    assert count_open_edges(mesh.surface_groups["cavity"]) == count_open_edges(mesh.surface_groups["outer"]) == 0
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["base"]], 1, 0)
    assert np.cross(b - a, c - a).sum(axis=0) / 2 == pytest.approx([400, 0, 0], abs=1e-9)
    again = geometry.mesh()
    assert np.array_equal(again.nodes, mesh.nodes) and np.array_equal(again.elements, mesh.elements)
    assert len(geometry.mesh(3.0).nodes) > 2 * len(mesh.nodes)


def test_curved_faces_are_meshed_as_fine_as_their_curvature(folder: Path) -> None:
    """The ball with edges of a sixteenth turn, within 6 %, and each cavity in its own group."""
    mesh = body(folder, "voids.step", cavities=2, mesh={"largest": 7}).mesh()
    ball = 4 / 3 * np.pi * 125
    walls = sorted(enclosed_volume(mesh.nodes, mesh.surface_groups[name]) for name in ("cavity_0", "cavity_1"))
    assert walls[0] == pytest.approx(64, rel=1e-9)
    assert 0.94 * ball < walls[1] < ball
    silicone = tetrahedron_volumes(mesh.nodes, mesh.elements).sum()
    assert silicone == pytest.approx(12000 - sum(walls), rel=1e-9)
    with pytest.warns(UserWarning, match=r"body.toml: cavity_\d has .* mm\^3 in the mesh instead of 523.599, .*% off"):
        rough = body(folder, "voids.step", mesh={"largest": 7, "curvature": 8}).mesh()
    assert len(rough.nodes) < len(mesh.nodes)


def test_the_volume_of_a_bore_converges_with_the_edges_around_it(tmp_path: Path) -> None:
    """An inscribed polygon of n sides lacks 1 - n sin(2 pi / n) / 2 pi of the circle: hardly more is missing, and a
    third of it at least, since no edge is much shorter than asked for."""

    def plate(occ: Any) -> None:
        occ.cut([(3, occ.addBox(0, 0, 0, 20, 20, 6))], [(3, occ.addCylinder(10, 10, -1, 0, 0, 8, 3))])

    write_step(tmp_path / "plate.step", plate)
    bore = np.pi * 9 * 6
    for sides in (8, 32):
        mesh = body(tmp_path, "plate.step", mesh={"largest": 6, "curvature": sides}).mesh()
        missing = (tetrahedron_volumes(mesh.nodes, mesh.elements).sum() - (2400 - bore)) / bore
        polygon = 1 - sides / (2 * np.pi) * np.sin(2 * np.pi / sides)
        assert polygon / 3 < missing < 1.25 * polygon


def test_small_rounds_and_holes_are_dropped(tmp_path: Path) -> None:
    """A plate with fillets of 1 mm and bores of 1.5 and 4 mm radius: below 2 mm only the largest bore is left."""

    def plate(occ: Any) -> None:
        box = occ.addBox(0, 0, 0, 40, 20, 6)
        occ.synchronize()
        upright = [edge for _, edge in occ.getEntities(1) if abs(np.ptp(occ.getBoundingBox(1, edge)[2::3]) - 6) < 1e-3]
        (solid,) = occ.fillet([box], upright, [1.0])
        occ.cut([solid], [(3, occ.addCylinder(x, 10, -1, 0, 0, 8, r)) for x, r in ((8, 1.5), (25, 4))])

    path = write_step(tmp_path / "plate.step", plate)
    corners, bores = (4 - np.pi) * 6, np.pi * np.array([1.5, 4]) ** 2 * 6
    whole = read_step(path)
    assert whole.volume == pytest.approx(4800 - corners - bores.sum(), rel=1e-6)
    with pytest.warns(UserWarning, match=r"defeature = 2: 5 round faces are dropped, .* volume by 1.1 %$"):
        plain = read_step(path, 2.0)
    assert plain.volume == pytest.approx(4800 - bores[1], rel=1e-6)
    assert len(plain.faces) == 7
    with pytest.warns(UserWarning, match="no face has a radius up to 0.5 mm; it has no effect"):
        assert len(read_step(path, 0.5).faces) == len(whole.faces)
    sizes = {"largest": 8.0, "elements_across_walls": 1}
    counts = [len(body(tmp_path, "plate.step", mesh=sizes, defeature=size).mesh().nodes) for size in (0.0, 2.0)]
    assert counts[1] < 0.6 * counts[0]
    with pytest.raises(MeshError, match="defeature = -1"):
        body(tmp_path, "plate.step", defeature=-1)


def test_faces_that_cannot_be_dropped_are_placed(tmp_path: Path) -> None:
    path = write_step(tmp_path / "ball.step", lambda occ: occ.addSphere(5, 0, 0, 2))
    with pytest.raises(
        MeshError, match=r"ball.step: defeature = 3: cannot drop 1 faces, the first at \[.*\] mm; try a"
    ):
        read_step(path, 3.0)


def test_smaller_elements_at_the_cavity(folder: Path) -> None:
    even = body(folder, "flat.step", mesh={"largest": 8}).mesh()
    graded = body(folder, "flat.step", mesh={"largest": 8, "smallest": 2}).mesh()
    assert len(graded.surface_groups["cavity"]) > 2 * len(even.surface_groups["cavity"])


def test_walls_of_two_elements(folder: Path) -> None:
    plain, split = (
        body(folder, "flat.step", mesh={"largest": 10, "elements_across_walls": across}).mesh() for across in (1, 2)
    )
    assert np.array_equal(split.surface_groups["cavity"], plain.surface_groups["cavity"])
    assert len(through_edges(plain.elements)) > 0
    assert len(through_edges(split.elements)) == 0


def test_a_body_without_a_void_is_meshed_and_said(folder: Path) -> None:
    with pytest.warns(UserWarning, match="full.step: the body has no cavity; a cavity is a void without an opening$"):
        mesh = body(folder, "full.step", mesh={"largest": 10}).mesh()
    assert list(mesh.surface_groups) == ["outer"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert body(folder, "full.step", cavities=0).cavity_volumes == ()


@pytest.mark.parametrize(
    ("tables", "problem"),
    [
        ({}, "file: this key is missing"),
        (
            {"file": "flat.step", "cavities": 2},
            "cavities = 2: .*flat.step has 1; a cavity is a void without an opening",
        ),
        ({"file": "full.step", "cavities": 1}, "cavities = 1: .*full.step has 0"),
        ({"file": "flat.step", "cavities": -1}, "cavities = -1: input should be greater than or equal to 0"),
        ({"file": "flat.step", "size": 3}, "size: unknown key"),
        ({"file": "flat.step", "mesh": {"largest": 31}}, "size 31: is larger than the body; must be at most 30 mm"),
        (
            {"file": "flat.step", "base": {"point": [40, 0, 0], "normal": [1, 0, 0]}, "mesh": {"largest": 10}},
            r"base: no triangle of the outer surface lies in this plane; it spans \[0.0, 0.0, 0.0\] to \[30.0, ",
        ),
    ],
)
def test_what_is_wrong_in_the_tables_is_told(folder: Path, tables: dict, problem: str) -> None:
    with pytest.raises(MeshError, match=f"^{folder}/body.toml: {problem}"):
        StepBody(tables, folder / "body.toml").mesh()


def test_a_file_names_its_step_file_beside_it(folder: Path) -> None:
    file = folder / "finger.toml"
    file.write_text('kind = "step"\nfile = "flat.step"\n')
    geometry = read_geometry(file)
    assert geometry.presets == {"coarse": 3.44, "medium": 1.72, "fine": 0.859}  # type: ignore[attr-defined]
    mesh = mesh_geometry(geometry, 8.0, file)
    assert mesh.source == str(file)
    assert list(mesh.surface_groups) == ["outer", "cavity"]


# STEP bodies of several solids, with open chambers and numbered faces: a finger of a designer.

LENGTH, WIDTH, HEIGHT, LAYER = 40.0, 12.0, 12.0, 2.0
CLOSED, OPEN, INLET = 14.0 * 6.0 * 7.0, 12.0 * 6.0 * 7.0, 4.0 * 2.0 * 2.0
"""Volumes of the two chambers and of the duct that leads from the base into one of them [mm^3]."""


def finger(occ: Any) -> None:
    """An upper part with two chambers, both without a floor, and the layer under it that is their floor.

    The duct's floor is the layer, too, so that its rim is the edge of three faces of one solid and one of the other.
    """
    upper = (3, occ.addBox(0, 0, LAYER, LENGTH, WIDTH, HEIGHT - LAYER))
    chambers = [(3, occ.addBox(4, 3, LAYER, 12, 6, 7)), (3, occ.addBox(22, 3, LAYER, 14, 6, 7))]
    occ.cut([upper], [*chambers, (3, occ.addBox(-1, 5, LAYER, 6, 2, 2))])
    occ.addBox(0, 0, 0, LENGTH, WIDTH, LAYER)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`finger.step`, whose solids have the names "body" and "stiff layer", as CAD writes them."""
    drawn = tmp_path_factory.mktemp("solids")
    path = write_step(drawn / "finger.step", finger)
    names = {"1": "'body'", "2": "'stiff layer'"}
    unnamed = r"'Open CASCADE STEP translator [\d.]+ \d+\.(\d)'"
    path.write_text(re.sub(unnamed, lambda found: names[found[1]], path.read_text()))
    return drawn


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))


def step_body(drawn: Path, name: str = "finger.step", **tables: Any) -> StepBody:
    return StepBody({"file": name, **tables}, drawn / "body.toml")


@pytest.fixture(scope="module")
def meshed(drawn: Path) -> VolumeMesh:
    """The finger with its inlet closed and the shared face as a group, all said on the way."""
    (glue,) = (face.number for face in read_step(drawn / "finger.step").faces if len(face.solids) == 2)
    with pytest.warns(UserWarning, match=r"finger.step: the flat end, face \d+ and \d+, is the group 'base'"):
        return step_body(drawn, cavities=2, close_inlets=True, faces={"paper": glue}, mesh={"largest": 6}).mesh()


def test_each_solid_is_a_group_and_they_share_their_faces(meshed: VolumeMesh) -> None:
    volumes = element_volumes(meshed.nodes, meshed.elements)
    layer, upper = meshed.element_groups["stiff_layer"], meshed.element_groups["body"]
    assert len(meshed.element_groups["silicone"]) == len(layer) + len(upper) == len(volumes)
    assert volumes[layer].sum() == pytest.approx(LENGTH * WIDTH * LAYER, rel=1e-9)
    assert volumes[upper].sum() == pytest.approx(LENGTH * WIDTH * (HEIGHT - LAYER) - CLOSED - OPEN - INLET, rel=1e-9)
    assert meshed.nodes[meshed.elements[layer]][..., 2].max() == pytest.approx(LAYER)
    its = [set(map(tuple, np.sort(boundary_triangles(meshed.elements[group]), axis=1))) for group in (layer, upper)]
    paper = set(map(tuple, np.sort(meshed.surface_groups["paper"], axis=1)))
    assert its[0] & its[1] == paper, "the faces between them, cut where a wall got two elements"
    assert len(through_edges(meshed.elements)) == 0
    assert not faults(measure(meshed))


def test_a_chamber_open_at_its_inlet_is_closed_by_a_cap(meshed: VolumeMesh) -> None:
    """Both cavities, and the outside with the cap over the duct, have the volumes of the drawing."""
    groups = meshed.surface_groups
    got = {name: enclosed_volume(meshed.nodes, groups[name]) for name in ("cavity_0", "cavity_1", "outer")}
    assert got == pytest.approx(
        {"cavity_0": CLOSED, "cavity_1": OPEN + INLET, "outer": LENGTH * WIDTH * HEIGHT}, rel=1e-9
    )
    assert not any(count_open_edges(groups[name]) for name in got)
    base = meshed.nodes[groups["base"]]
    assert np.all(base[..., 0] == 0.0)
    assert np.linalg.norm(np.cross(base[:, 1] - base[:, 0], base[:, 2] - base[:, 0]), axis=1).sum() / 2 == (
        pytest.approx(WIDTH * HEIGHT - 4.0)
    ), "both faces of the end; the cap is no silicone that could be held"


def test_what_is_open_is_said_with_its_place(drawn: Path) -> None:
    opening = r"opening 1, 4 mm\^2 wide in face \d+ around \[0, 6, 3\] mm before 520 mm\^3 of air; close_inlets = true"
    with pytest.warns(UserWarning, match=f"finger.step: a chamber is open; {opening} makes cavities .*, and false "):
        assert len(step_body(drawn).cavity_volumes) == 1
    with pytest.raises(MeshError, match=f"cavities = 2: .*finger.step has 1; a cavity is a void .*; {opening}"):
        _ = step_body(drawn, cavities=2).body
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert step_body(drawn, close_inlets=False).cavity_volumes == pytest.approx([CLOSED])
        assert step_body(drawn, close_inlets=[1]).cavity_volumes == pytest.approx([CLOSED, OPEN + INLET])


def chamber(occ: Any, outside: Any, *cut: Any) -> None:
    """A body with a chamber of 6 mm around (0, 0, 10), and what is cut from it besides."""
    occ.cut(outside, [(3, occ.addBox(-3, -3, 7, 6, 6, 6)), *cut])


def block(occ: Any) -> list[tuple[int, int]]:
    return [(3, occ.addBox(-10, -10, 0, 20, 20, 20))]


def inlet(occ: Any) -> int:
    return occ.addBox(-1, -1, -1, 2, 2, 9)


def cylinder(occ: Any) -> list[tuple[int, int]]:
    return [(3, occ.addCylinder(0, 0, 0, 0, 0, 20, 10))]


def nipple(occ: Any) -> list[tuple[int, int]]:
    fused, _ = occ.fuse(block(occ), [(3, occ.addCylinder(0, 0, -5, 0, 0, 6, 3))])
    return fused


@pytest.mark.parametrize(
    ("draw", "volumes"),
    [
        (lambda occ: chamber(occ, block(occ)), []),
        (lambda occ: chamber(occ, block(occ), (3, inlet(occ))), [216 + 28]),
        (lambda occ: chamber(occ, nipple(occ), (3, occ.addBox(-1, -1, -6, 2, 2, 14))), [216 + 48]),
        (lambda occ: chamber(occ, cylinder(occ), (3, occ.addCylinder(0, 0, 10, 20, 0, 0, 2))), [216 + np.pi * 4 * 6.9]),
        (lambda occ: chamber(occ, block(occ), (3, occ.addCylinder(0, 0, -1, 0, 0, 30, 1))), []),
        (lambda occ: chamber(occ, block(occ), (3, occ.addCylinder(-20, 8, 2, 40, 0, 0, 1))), []),
        (lambda occ: chamber(occ, nipple(occ)), []),
        (lambda occ: chamber(occ, block(occ), (3, inlet(occ)), (3, occ.addBox(6, 6, -1, 2, 2, 5))), [216 + 28, 16]),
        (lambda occ: chamber(occ, block(occ), (3, occ.addCone(0, 0, -1, 0, 0, 9, 3, 1))), [216 + 7 / 3 * np.pi * 12.6]),
        (lambda occ: chamber(occ, block(occ), (3, occ.addCylinder(0, -20, 20, 0, 40, 0, 4))), []),
    ],
    ids=["closed", "inlet", "nipple", "radial", "through", "beside", "stud", "two", "countersunk", "groove"],
)
def test_openings_are_told_from_other_shapes(
    tmp_path: Path, draw: Callable[[Any], object], volumes: list[float]
) -> None:
    """Air is open behind each rim that one cap closes: not in through holes, in grooves, or around studs."""
    body = read_step(write_step(tmp_path / "body.step", draw))
    assert [one.volume for one in body.openings] == pytest.approx(volumes, rel=0.03)


def check_cap(flat: np.ndarray) -> None:
    """Areas add up to the polygon's by the shoelace formula, and no corner of it lies inside a triangle."""
    tilted = flat @ np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]) + 5.0
    cap = cap_triangles(tilted)
    ahead = np.roll(flat[cap], -1, axis=1) - flat[cap]
    away = flat[:, None, None] - flat[cap]
    left = ahead[..., 0] * away[..., 1] - ahead[..., 1] * away[..., 0]
    assert not (left > 1e-6).all(axis=-1).any()
    x, y = flat.T
    a, b, c = np.moveaxis(tilted[cap], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@examples(30)
@given(st.lists(st.floats(0.1, 1.0), min_size=3, max_size=14), st.floats(0, 6.3))
def test_caps_cover_any_star(radii: list[float], turn: float) -> None:
    angles = turn + 2 * np.pi * np.arange(len(radii)) / len(radii)
    check_cap(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))


def test_an_ear_with_a_corner_in_it_is_not_cut() -> None:
    """Of the corner below, whose neighbours are nearest to each other; the spike from above ends in it."""
    check_cap(np.array([[0, 0], [1, 3], [0.3, 4], [0, 1], [-0.3, 4], [-1, 3]], dtype=float))


def test_rims_that_touch_are_parted() -> None:
    loops = rims(np.array([[0, 1], [1, 2], [2, 0], [2, 3], [3, 4], [4, 2], [4, 7]]))
    assert sorted(map(sorted, loops)) == [[0, 1, 2], [2, 3, 4]]


def test_curved_layers_have_their_volumes_with_ten_nodes(tmp_path: Path) -> None:
    """A tube around another, each within 1e-3 of the drawing."""

    def draw(occ: Any) -> None:
        bore, glue, skin = (occ.addCylinder(0, 0, 0, 0, 0, 5, radius) for radius in (2, 4, 6))
        inner, _ = occ.cut([(3, glue)], [(3, bore)])
        occ.cut([(3, skin)], inner, removeTool=False)

    path = write_step(tmp_path / "tubes.step", draw)
    with pytest.warns(UserWarning, match="no cavity"):
        mesh = step_body(tmp_path, path.name, mesh={"order": 2, "largest": 4}, solids={"core": 1}).mesh()
    volumes = element_volumes(mesh.nodes, mesh.elements)
    got = sorted(volumes[group].sum() for group in (mesh.element_groups["core"], mesh.element_groups["solid_2"]))
    assert got == pytest.approx([np.pi * 5 * 12, np.pi * 5 * 20], rel=1e-3)


def test_layers_get_two_elements_across(tmp_path: Path) -> None:
    """In the middle of three layers, too, neither of whose faces is the boundary of the body."""
    path = write_step(tmp_path / "layers.step", lambda occ: [occ.addBox(0, 0, 4 * k, 30, 20, 4) for k in range(3)])
    counts = []
    for across in (1, 2):
        with pytest.warns(UserWarning, match="no cavity"):
            mesh = step_body(tmp_path, path.name, mesh={"largest": 9, "elements_across_walls": across}).mesh()
        counts.append(len(through_edges(mesh.elements[mesh.element_groups["solid_2"]])))
    assert counts[0] > 10
    assert counts[1] == 0


def test_thin_walls_get_finer_elements(drawn: Path) -> None:
    """Triangles on walls have edges of at most 1.5 times the ratio, the rest stay as they were."""
    coarse, fine = (
        step_body(drawn, close_inlets=True, mesh={"largest": 8, "elements_across_walls": 1, "wall_ratio": ratio}).mesh()
        for ratio in (0.0, 1.2)
    )
    edges = []
    for mesh in (coarse, fine):
        walls = find_walls(mesh.nodes, mesh.elements)
        corners = mesh.nodes[walls.triangles]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        edges.append((longest / walls.thickness)[walls.thickness < 3.5])
    assert np.quantile(edges[0], 0.9) > 2.0
    assert np.quantile(edges[1], 0.9) < 1.5 * 1.2
    with pytest.raises(MeshError, match=r"mesh.wall_ratio = 0.001: must be at least .* elements"):
        step_body(drawn, close_inlets=False, mesh={"largest": 8, "wall_ratio": 0.001}).mesh()


@pytest.mark.parametrize(
    ("tables", "problem"),
    [
        ({"faces": {"base": 99}}, r"faces.base = 99: the body has \d+ faces; `taichisoft mesh info` lists them"),
        ({"faces": {"base": 0}}, r"faces.base\S* = 0: .* greater than or equal to 1"),
        ({"faces": {"cavity_1": 3}}, "faces.cavity_1: must be a name of letters, digits"),
        ({"solids": {"stiff": 3}}, "solids.stiff = 3: the body has 2 solids"),
        ({"solids": {"body": 2}}, "solids.body: solid 1 has this name; choose another"),
        ({"close_inlets": [2]}, "close_inlets = 2: the body has 1 openings"),
        ({"base": [{"point": [0, 0, 0], "normal": [1, 0, 0]}], "faces": {"base": 3}}, "base and faces.base: only one"),
    ],
)
def test_numbers_and_names_that_are_wrong_are_told(drawn: Path, tables: dict[str, Any], problem: str) -> None:
    with pytest.raises(MeshError, match=f"body.toml: {problem}"):
        step_body(drawn, **{"close_inlets": False, "mesh": {"largest": 10}, **tables}).mesh()


def test_a_body_of_another_unit_is_doubted(tmp_path: Path) -> None:
    """Drawn in metres, written as millimetres."""
    path = write_step(tmp_path / "small.step", lambda occ: occ.addBox(0, 0, 0, 0.04, 0.02, 0.02))
    assert "small.step: its longest side = 0.04" in read_step(path).doubt


def test_several_planes_are_one_base(drawn: Path) -> None:
    planes = [{"point": [x, 0, 0], "normal": [1, 0, 0]} for x in (0, LENGTH)]
    mesh = step_body(drawn, close_inlets=False, base=planes, mesh={"largest": 10}).mesh()
    assert set(np.unique(mesh.nodes[mesh.surface_groups["base"]][..., 0])) == {0.0, LENGTH}


def test_solids_that_overlap_are_refused(tmp_path: Path) -> None:
    path = write_step(tmp_path / "body.step", lambda occ: [occ.addBox(0, 0, 0, 2, 2, 2), occ.addBox(1, 0, 0, 2, 2, 2)])
    with pytest.raises(MeshError, match=r"solids 1 and 2 overlap by 4 mm\^3; cut one from the other"):
        read_step(path)


def test_options_and_keys_of_scenes_are_keys_of_the_geometry(drawn: Path) -> None:
    job = MeshJob("step", {"file": "finger.step", "mesh": {"largest": 6.0}}, drawn / "finger.step", {})
    changed = with_options(job, 2, ["7=base", "9 = base", "1=pad"], ["2=stiff"], close_inlets=True).tables
    assert changed == {
        "file": "finger.step",
        "mesh": {"largest": 6.0, "order": 2},
        "faces": {"base": [7, 9], "pad": [1]},
        "solids": {"stiff": 2},
        "close_inlets": True,
    }
    with pytest.warns(UserWarning, match="is the group 'base'"):
        mesh = mesh_for_scene(drawn / "finger.step", size=6.0, order=2, set={"close_inlets": False})
    assert mesh.elements.shape[1] == 10


def test_from_step_to_a_gripper(drawn: Path) -> None:
    """Three fingers straight from the STEP file, the layer of another stiffness: pressure in both chambers bends them.

    The layer stretches least, so that each tip moves away from the chambers' side, towards its layer.
    """
    mesh = {"file": str(drawn / "finger.step"), "size": 10.0, "set": {"close_inlets": True}}
    one = {
        "mesh": mesh,
        "element": "linear",
        "density": 1.1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "regions": [{"group": "stiff_layer", "young_modulus": 1000.0}],
        "anchors": [{"group": "base"}],
        "cavities": {name: {"group": name} for name in ("cavity_0", "cavity_1")},
    }
    fingers = {f"finger{k}": {**one, "translation": [0.0, 30.0 * k, 0.0]} for k in range(3)}
    simulation = taichisoft.Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": fingers}, drawn))
    start = simulation.state.position.copy()
    names = [f"{finger}.{name}" for finger in fingers for name in ("cavity_0", "cavity_1")]
    for step in range(1, 4):
        report = simulation.step(taichisoft.Control(pressure=dict.fromkeys(names, 1.0 * step)))
    assert report.observation.volumes["finger0.cavity_1"] > OPEN + INLET
    tip = start[:, 0] > LENGTH - 1e-6
    assert (simulation.state.position - start)[tip, 2].max() < -0.1


@given(count=st.integers(1, 60), seed=st.integers(0, 99), spread=st.floats(0.0, 80.0))
@examples(25)
def test_numbers_of_faces_do_not_cover_each_other(count: int, seed: int, spread: float) -> None:
    """Those with space stay at their places; nobody goes further than all of them together are large."""
    places = spread * np.random.default_rng(seed).random((count, 2))
    size = np.array([5.0, 3.0])
    labels = np.array(labels_apart(list(places), size))
    off = np.abs(labels[:, None] - labels)
    assert ((off >= size - 1e-9).any(axis=2) | np.eye(count, dtype=bool)).all()
    assert (labels[0] == places[0]).all()
    assert (np.abs(labels - places) <= 5.0 * np.sqrt(count) * size).all()


def test_the_picture_has_the_number_of_each_face_that_is_seen(
    drawn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The eleven faces of the outside, which no other hides, and none of the closed chamber and between the solids."""
    from matplotlib.axes import Axes

    body, drawn, text = read_step(drawn / "finger.step"), [], Axes.text

    def keep(axes: Axes, x: float, y: float, words: str, **style: Any) -> Any:
        drawn.append(words)
        return text(axes, x, y, words, **style)

    monkeypatch.setattr(Axes, "text", keep)
    draw_faces(body, tmp_path / "faces.png")
    behind = body.openings[0].faces
    assert {str(number) for number in body.outside - behind} <= set(drawn)
    assert not {str(face.number) for face in body.faces if face.number not in body.outside} & set(drawn)
