"""A mould that can be cast: parts come off, fill their block, and can be printed; and what cannot is named."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import solid_shapes
import trimesh
from conftest import Figures

from taichisoft.base import call_apart
from taichisoft.errors import GoalMissed, MeshError
from taichisoft_meshing.cad_body import read_step
from taichisoft_meshing.finger_dimensions import FingerParameters
from taichisoft_meshing.mesh_commands import geometry_job, mould_check, pour_line
from taichisoft_meshing.mould_check import (
    CheckedCast,
    check_cast,
    check_mould,
    find_undercuts,
    read_mould_record,
    wall_thickness,
)
from taichisoft_meshing.mould_parts import write_mould
from taichisoft_outputs.material_files import find_material

SMALL = {
    "body": {"length": 55.0},
    "slots": {"count": 1},
    "chambers": {"count": 2},
    "channel": {"end": 34.0},
    "stiff_layer": {"end": 40.0},
}
"""A finger of two chambers, whose mould takes a third of the time."""
UP = np.array([0.0, 1.0, 0.0])


def write(folder: Path, tables: Mapping[str, Any], **form: Any) -> dict[str, Any]:
    job = geometry_job("tutorial", None, {})
    merged = {key: {**job.tables.get(key, {}), **tables.get(key, {})} for key in {*job.tables, *tables}}
    write_mould(type(job)(job.kind, merged, job.file, {}), folder, form)
    return read_mould_record(folder)


def part(folder: Path, name: str) -> trimesh.Trimesh:
    return trimesh.load(folder / f"tutorial{name}.stl")


def check_upper(folder: Path) -> CheckedCast:
    record = read_mould_record(folder)
    return check_cast(folder, record["casts"][0], record["printable_mm"])


@pytest.fixture(scope="module")
def undercut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Chambers 2 mm wider than the channel through which their core would have to come, and a slot of 0.5 mm."""
    folder = tmp_path_factory.mktemp("undercut")
    write(folder, {**SMALL, "chambers": {"count": 2, "depth": 17.0}, "slots": {"count": 1, "width": 0.5}})
    return folder


def test_the_shipped_fingers_mould_passes_its_check(tmp_path: Path, figures: Figures) -> None:
    """Every part comes off, walls are thick enough, and parts and silicone fill the block to 1e-3: here to 2e-5, since
    triangles are shared where parts touch, and only the round gaps around the pegs are not those of the formula."""
    write(tmp_path, {})
    casts = check_mould(tmp_path)
    assert [problem for cast in casts for problem in cast.problems] == []
    assert [[one.name for one in cast.parts] for cast in casts] == [["lid", "cast", "box"], ["lid", "cast", "tray"]]
    for cast in casts:
        figures.at_most(f"unfilled share of {cast.name}", abs(cast.unfilled), 2e-5)
    assert len(list(tmp_path.glob("*.step"))) == 7  # six parts and the finger
    body = read_step(tmp_path / "tutorial.step")
    stiff, soft = (solid.volume for solid in body.solids)
    assert len(body.voids) == 1
    poured = {pour["what"]: pour["mm3"] for cast in read_mould_record(tmp_path)["casts"] for pour in cast["pours"]}
    figures.close("stiff layer [mm^3]", stiff, poured["the stiff layer, into that room"], 1e-6 * stiff)
    figures.close("finger [mm^3]", stiff + soft, part(tmp_path, "").volume, 1e-5 * soft)


def test_castings_without_draft_are_the_drawn_finger(tmp_path: Path, figures: Figures) -> None:
    """What is poured less what fills the holes of the lids, with the stiff layer, is the volume of the silicone; the
    slide leaves the bore up to the base, where the drawing is closed."""
    record = write(tmp_path, {**SMALL, "inlet": {"diameter": 2.0}}, draft=0.0)
    tables = geometry_job("tutorial", None, {}).tables
    merged = {key: {**value, **SMALL.get(key, {})} for key, value in tables.items()} | {"inlet": {"diameter": 2.0}}
    finger = FingerParameters.model_validate(merged)
    silicone = finger.solid_volume - finger.cavity_volume
    figures.close("finger.stl [mm^3]", part(tmp_path, "").volume, silicone, 1e-4 * silicone)  # the bore has flat faces
    poured = sum(pour["mm3"] for cast in record["casts"] for pour in cast["pours"])
    plug = math.pi * finger.inlet.plug
    holes = sum(_volume_above(part(tmp_path, f"-{name}-cast"), top) for name, top in (("upper", 22.0), ("layer", 30.0)))
    figures.close("poured into the finger [mm^3]", poured - holes, silicone - plug, 2e-5 * silicone)
    slide = check_upper(tmp_path).parts[0]
    assert slide.name == "slide"
    np.testing.assert_array_equal(slide.comes_off, [1.0, 0.0, 0.0])
    assert slide.problems == []


def _volume_above(mesh: trimesh.Trimesh, y: float) -> float:
    """Volume of the part above a height, which is prisms along y."""
    flat = (np.abs(mesh.triangles[:, :, 1] - mesh.bounds[1, 1]) < 1e-9).all(axis=1)
    return float(mesh.area_faces[flat].sum() * (mesh.bounds[1, 1] - y))


def test_draft_leans_walls_and_keeps_their_thickness(tmp_path: Path, figures: Figures) -> None:
    """Between parallel faces that lean by an angle a wall drawn w wide has w cos(angle): sides 2.5 mm, slots 2.7 mm."""
    write(tmp_path, SMALL, draft=3.0)
    cast = part(tmp_path, "-upper-cast")
    thickness, places, triangles = wall_thickness(cast.triangles)
    leaning = np.abs(np.abs(cast.face_normals[triangles, 1]) - math.sin(math.radians(3.0))) < 1e-6
    across = np.abs(cast.face_normals[triangles, 2]) > 0.9
    sides = thickness[leaning & across & (thickness < 5.0) & (places[:, 1] < 22.0)]
    assert len(sides) > 10
    figures.close("least side wall [mm]", sides.min(), 2.5 * math.cos(math.radians(3.0)), 1e-4)
    figures.close("largest side wall [mm]", sides.max(), 2.5 * math.cos(math.radians(3.0)), 1e-4)


def test_an_undercut_is_named(undercut: Path) -> None:
    """Two chambers overhang the channel by 1 mm at both sides: four places, where the silicone holds the lid."""
    lid = check_upper(undercut).parts[0]
    assert [one.obstacle for one in lid.undercuts] == ["cast"] * 4
    middles = np.array([one.middle for one in lid.undercuts])
    np.testing.assert_allclose(np.sort(np.abs(middles[:, 2])), 8.0, atol=0.3)
    np.testing.assert_allclose(np.sort(middles[:, 0]), [-31.5, -31.5, -18.5, -18.5], atol=1.0)
    assert all(0.3 < one.extent[2] <= 1.01 for one in lid.undercuts)
    assert "lid: undercut: cast is in its way over" in lid.problems[0]


def test_a_wall_too_thin_to_print_is_named(undercut: Path) -> None:
    box = check_upper(undercut).parts[-1]
    assert box.thickness == pytest.approx(0.5, abs=0.25)
    assert "box: a wall of" in box.problems[0]
    assert "is too thin to print" in box.problems[0]


def test_the_command_draws_every_part_and_fails_for_an_undercut(undercut: Path) -> None:
    """`mould check` reads the files as they are, and its exit code says whether something is wrong."""
    with pytest.raises(GoalMissed, match="undercut: cast is in its way"):
        mould_check(undercut)
    assert {file.stem for file in undercut.glob("*.png")} == {file.stem for file in undercut.glob("*-*.stl")}


def test_a_hook_holds_and_a_wedge_does_not() -> None:
    """A beam with a foot below a plate cannot be drawn up; without the foot, or beside the plate, it can."""
    beam = solid_shapes.box((4, 10, 4), (0, 5, 0)).triangles
    foot = solid_shapes.box((8, 2, 4), (0, -1, 0)).triangles
    plate = solid_shapes.box((4, 2, 4), (4, 3, 0)).triangles
    assert find_undercuts(beam, {"plate": plate}, UP) == []
    hook = np.concatenate([beam, foot])
    (found,) = find_undercuts(hook, {"plate": plate}, UP)
    assert found.obstacle == "plate"
    np.testing.assert_allclose(found.middle[:2], [3.0, 1.0], atol=0.2)  # from the foot's underside to the plate's top
    np.testing.assert_allclose(found.extent[:2], [2.0, 6.0], atol=0.4)
    assert find_undercuts(hook, {"plate": plate}, -UP) == []


def test_thickness_of_a_plate_and_a_tube() -> None:
    """A plate of 0.7 mm; between two coaxial cylinders the wall is the difference of radii, less the flat faces'."""
    plate = solid_shapes.box((20, 0.7, 20)).triangles
    assert wall_thickness(plate)[0].min() == pytest.approx(0.7, rel=1e-9)
    tube = trimesh.creation.annulus(4.0, 5.0, 10.0, sections=64)
    assert wall_thickness(tube.triangles)[0].min() == pytest.approx(1.0, rel=2e-3)  # 1 - cos(pi/64) is 1.2e-3


def test_what_to_weigh_is_said() -> None:
    """Mass from the density of the material; a ratio only where the material says one."""
    pour = {"what": "the upper part", "silicone": "soft", "mm3": 30000.0}
    assert pour_line(pour, None) == "the upper part: 30.0 cm^3 of soft silicone"
    skin, rtv = find_material("dragon-skin-30"), find_material("rtv615")
    assert "32.1 g: 16.1 g of A and 16.1 g of B, by weight or volume" in pour_line(pour, skin)
    assert "its file has no mixing ratio" in pour_line(pour, rtv)


@pytest.mark.parametrize(
    ("tables", "form", "message"),
    [
        (
            {"slots": {"width": 0.6}},
            {"draft": 5.0},
            r"tutorial.toml: --draft 5: the slots would close; must be at most",
        ),
        ({"stiff_layer": {"bottom": 20.0}}, {}, r"stiff_layer.bottom = 20: must be at least 22 \(channel.top\)"),
        ({}, {"wall": 2.0}, "--wall 2: must be from 5 to 50"),
        ({}, {"draft": math.nan}, "--draft nan: must be from 0 to 10"),
        ({}, {"parting": "z=0"}, "--parting z=0: a finger is parted where its channel ends"),
    ],
)
def test_what_cannot_be_cast_is_refused(tmp_path: Path, tables: Any, form: Any, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        write(tmp_path, tables, **form)
    with pytest.raises(MeshError, match=r"mould.json: not readable: .*`taichisoft mould` writes it"):
        check_mould(tmp_path)


@pytest.mark.parametrize(("parting", "aspect"), [((0.0, 0.0, 1.0), 3.0), ((1.0, 0.0, 0.0), 2.0)])
def test_pictures_of_parts_look_along_the_parting(parting: tuple[float, ...], aspect: float) -> None:
    """On the right a block is a rectangle of its two other sides; in a corner there is nothing."""
    corners = trimesh.creation.box((60.0, 20.0, 10.0)).triangles
    colours = np.tile([0.5, 0.6, 0.7], (len(corners), 1))
    (picture,) = call_apart(
        "taichisoft_meshing.body_pictures:draw_views", [(corners, colours, np.array(parting))], time_limit=300.0
    )
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    for along in (picture[:height, width:], picture[height:, width:]):
        rows, columns = np.nonzero((along < 250).any(axis=2))
        sides = np.ptp(rows) + 1, np.ptp(columns) + 1
        assert max(sides) / min(sides) == pytest.approx(aspect, rel=0.02)
        assert len(rows) == pytest.approx(sides[0] * sides[1], rel=0.01)
        assert (along[0] == 255).all()
