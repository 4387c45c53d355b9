"""STEP bodies of several solids, with open chambers and numbered faces: a finger of a designer."""

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
from taichisoft.mesh import VolumeMesh, boundary_triangles, count_open_edges, element_volumes, enclosed_volume
from taichisoft.scene import scene_from_dict
from taichisoft_meshing.body_pictures import draw_faces
from taichisoft_meshing.cad_body import cap_triangles, read_step, rims
from taichisoft_meshing.file_bodies import StepBody, through_edges
from taichisoft_meshing.mesh_commands import with_options
from taichisoft_meshing.mesh_job import MeshJob, mesh_for_scene
from taichisoft_meshing.mesh_quality import faults, measure
from taichisoft_meshing.wall_quality import find_walls

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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`finger.step`, whose solids have the names "body" and "stiff layer", as CAD writes them."""
    folder = tmp_path_factory.mktemp("solids")
    path = write_step(folder / "finger.step", finger)
    names = {"1": "'body'", "2": "'stiff layer'"}
    unnamed = r"'Open CASCADE STEP translator [\d.]+ \d+\.(\d)'"
    path.write_text(re.sub(unnamed, lambda found: names[found[1]], path.read_text()))
    return folder


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))


def step_body(folder: Path, name: str = "finger.step", **tables: Any) -> StepBody:
    return StepBody({"file": name, **tables}, folder / "body.toml")


@pytest.fixture(scope="module")
def meshed(folder: Path) -> VolumeMesh:
    """The finger with its inlet closed and the shared face as a group, all said on the way."""
    (glue,) = (face.number for face in read_step(folder / "finger.step").faces if len(face.solids) == 2)
    with pytest.warns(UserWarning, match=r"finger.step: the flat end, face \d+ and \d+, is the group 'base'"):
        return step_body(folder, cavities=2, close_inlets=True, faces={"paper": glue}, mesh={"largest": 6}).mesh()


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


def test_what_is_open_is_said_with_its_place(folder: Path) -> None:
    opening = r"opening 1, 4 mm\^2 wide in face \d+ around \[0, 6, 3\] mm before 520 mm\^3 of air; close_inlets = true"
    with pytest.warns(UserWarning, match=f"finger.step: a chamber is open; {opening} makes cavities .*, and false "):
        assert len(step_body(folder).cavity_volumes) == 1
    with pytest.raises(MeshError, match=f"cavities = 2: .*finger.step has 1; a cavity is a void .*; {opening}"):
        _ = step_body(folder, cavities=2).body
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert step_body(folder, close_inlets=False).cavity_volumes == pytest.approx([CLOSED])
        assert step_body(folder, close_inlets=[1]).cavity_volumes == pytest.approx([CLOSED, OPEN + INLET])


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


def test_thin_walls_get_finer_elements(folder: Path) -> None:
    """Triangles on walls have edges of at most 1.5 times the ratio, the rest stay as they were."""
    coarse, fine = (
        step_body(
            folder, close_inlets=True, mesh={"largest": 8, "elements_across_walls": 1, "wall_ratio": ratio}
        ).mesh()
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
        step_body(folder, close_inlets=False, mesh={"largest": 8, "wall_ratio": 0.001}).mesh()


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
def test_numbers_and_names_that_are_wrong_are_told(folder: Path, tables: dict[str, Any], problem: str) -> None:
    with pytest.raises(MeshError, match=f"body.toml: {problem}"):
        step_body(folder, **{"close_inlets": False, "mesh": {"largest": 10}, **tables}).mesh()


def test_a_body_of_another_unit_is_doubted(tmp_path: Path) -> None:
    """Drawn in metres, written as millimetres."""
    path = write_step(tmp_path / "small.step", lambda occ: occ.addBox(0, 0, 0, 0.04, 0.02, 0.02))
    assert "small.step: its longest side = 0.04" in read_step(path).doubt


def test_several_planes_are_one_base(folder: Path) -> None:
    planes = [{"point": [x, 0, 0], "normal": [1, 0, 0]} for x in (0, LENGTH)]
    mesh = step_body(folder, close_inlets=False, base=planes, mesh={"largest": 10}).mesh()
    assert set(np.unique(mesh.nodes[mesh.surface_groups["base"]][..., 0])) == {0.0, LENGTH}


def test_solids_that_overlap_are_refused(tmp_path: Path) -> None:
    path = write_step(tmp_path / "body.step", lambda occ: [occ.addBox(0, 0, 0, 2, 2, 2), occ.addBox(1, 0, 0, 2, 2, 2)])
    with pytest.raises(MeshError, match=r"solids 1 and 2 overlap by 4 mm\^3; cut one from the other"):
        read_step(path)


def test_options_and_keys_of_scenes_are_keys_of_the_geometry(folder: Path) -> None:
    job = MeshJob("step", {"file": "finger.step", "mesh": {"largest": 6.0}}, folder / "finger.step", {})
    changed = with_options(job, 2, ["7=base", "9 = base", "1=pad"], ["2=stiff"], close_inlets=True).tables
    assert changed == {
        "file": "finger.step",
        "mesh": {"largest": 6.0, "order": 2},
        "faces": {"base": [7, 9], "pad": [1]},
        "solids": {"stiff": 2},
        "close_inlets": True,
    }
    with pytest.warns(UserWarning, match="is the group 'base'"):
        mesh = mesh_for_scene(folder / "finger.step", size=6.0, order=2, set={"close_inlets": False})
    assert mesh.elements.shape[1] == 10


def test_from_step_to_a_gripper(folder: Path) -> None:
    """Three fingers straight from the STEP file, the layer of another stiffness: pressure in both chambers bends them.

    The layer stretches least, so that each tip moves away from the chambers' side, towards its layer.
    """
    mesh = {"file": str(folder / "finger.step"), "size": 10.0, "set": {"close_inlets": True}}
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
    simulation = taichisoft.Simulation(scene_from_dict({"gravity": [0, 0, 0], "soft_bodies": fingers}, folder))
    start = simulation.state.position.copy()
    names = [f"{finger}.{name}" for finger in fingers for name in ("cavity_0", "cavity_1")]
    for step in range(1, 4):
        report = simulation.step(taichisoft.Control(pressure=dict.fromkeys(names, 1.0 * step)))
    assert report.observation.volumes["finger0.cavity_1"] > OPEN + INLET
    tip = start[:, 0] > LENGTH - 1e-6
    assert (simulation.state.position - start)[tip, 2].max() < -0.1


def test_the_picture_has_the_number_of_each_face_that_is_seen(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The eleven faces of the outside, which no other hides, and none of the closed chamber and between the solids."""
    from matplotlib.axes import Axes

    body, drawn, text = read_step(folder / "finger.step"), [], Axes.text

    def keep(axes: Axes, x: float, y: float, words: str, **style: Any) -> Any:
        drawn.append(words)
        return text(axes, x, y, words, **style)

    monkeypatch.setattr(Axes, "text", keep)
    draw_faces(body, tmp_path / "faces.png")
    behind = body.openings[0].faces
    assert {str(number) for number in body.outside - behind} <= set(drawn)
    assert not {str(face.number) for face in body.faces if face.number not in body.outside} & set(drawn)
