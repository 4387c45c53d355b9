"""Bodies from STEP files, meshed."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from solid_shapes import write_step
from test_step_files import two_voids

from taichisoft.errors import MeshError
from taichisoft.mesh import count_open_edges, enclosed_volume, tetrahedron_volumes
from taichisoft_meshing.file_bodies import StepBody, through_edges
from taichisoft_meshing.geometry_file import mesh_geometry, read_geometry


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
