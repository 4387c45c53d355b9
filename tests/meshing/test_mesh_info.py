"""`taichisoft mesh info`: the figures of anything that can be read."""

import functools
import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from blocks import make_block
from conftest import Command

from taichisoft import Simulation, VolumeMesh, scene_from_dict, write_volume_mesh
from taichisoft.mesh import write_stl


@pytest.fixture
def info(command: Command) -> Command:
    """Exit code, standard output and error of the command."""
    return functools.partial(command, "mesh", "info")


def hollow() -> VolumeMesh:
    return make_block((5, 5, 5), (50.0, 50.0, 50.0), hollow=True)


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu"])
def test_every_mesh_format(info, tmp_path: Path, suffix: str) -> None:
    write_volume_mesh(hollow(), tmp_path / f"hollow{suffix}")
    code, output, _ = info(tmp_path / f"hollow{suffix}")
    assert code == 0
    for figure in ("208", "588", "98000.0", "27000.0", "closed, faces the silicone, inside", "cavity to outer"):
        assert figure in output
    assert "warning: walls of one element" in output


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu"])
def test_scenes_know_the_surfaces_that_are_listed(tmp_path: Path, suffix: str) -> None:
    """Without groups in the file the chamber of 30 mm is "cavity" all the same."""
    write_volume_mesh(replace(hollow(), surface_groups={}), tmp_path / f"hollow{suffix}")
    body = {
        "mesh": str(tmp_path / f"hollow{suffix}"),
        "density": 1e-6,
        "young_modulus": 100.0,
        "poisson_ratio": 0.3,
        "cavities": {"air": {"group": "cavity"}},
    }
    simulation = Simulation(scene_from_dict({"soft_bodies": {"box": body}}, tmp_path))
    assert simulation.observe().volumes["box.air"] == pytest.approx(27000.0, rel=1e-9)


def test_a_shipped_mesh_by_its_name(info) -> None:
    code, output, _ = info("tutorial-coarse")
    assert code == 0
    assert "51162.5" in output


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_every_surface_format(info, tmp_path: Path, suffix: str) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / f"box{suffix}")
    code, output, _ = info(tmp_path / f"box{suffix}")
    assert code == 0
    for figure in ("22.0", "1 × 2 × 3", "6.0", "outward", "closed"):
        assert figure in output


def test_a_surface_with_a_hole_or_inside_out(info, tmp_path: Path) -> None:
    mesh = hollow()
    cavity = mesh.surface_groups["cavity"]
    write_stl(mesh.nodes, cavity[1:], tmp_path / "open.stl")
    code, output, error = info(tmp_path / "open.stl")
    assert (code, "none" in output) == (1, True)
    problem = "is not a closed surface: it has edges of one triangle only (3), the first from "
    where = error.removeprefix(f"taichisoft: {tmp_path / 'open.stl'}: {problem}")
    assert re.fullmatch(r"\[[-\d., ]+\] to \[[-\d., ]+\] mm; fill the hole\n", where)
    write_stl(mesh.nodes, cavity[:, ::-1], tmp_path / "turned.stl")
    code, output, _ = info(tmp_path / "turned.stl")
    assert (code, "inward" in output) == (0, True)


def test_a_surface_is_judged_as_it_is_meshed(info, tmp_path: Path) -> None:
    """Triangles that face the wrong side are turned round with a word; walls that cross are refused; metres told."""
    box = trimesh.creation.box((10.0, 20.0, 30.0))
    box.faces[::2] = box.faces[::2, ::-1]
    box.export(tmp_path / "mixed.stl")
    code, output, _ = info(tmp_path / "mixed.stl")
    assert (code, "6000.0" in output) == (0, True)
    assert "warning: triangles that face the other way than their neighbours are turned round" in output
    apart = trimesh.creation.box((10.0, 20.0, 30.0)).apply_translation([5.0, 1.0, 1.0])
    trimesh.util.concatenate([trimesh.creation.box((10.0, 20.0, 30.0)), apart]).export(tmp_path / "parts.stl")
    code, _, error = info(tmp_path / "parts.stl")
    assert code == 1
    assert "both face the same way: if they are parts of one body, unite = true joins them" in error
    trimesh.creation.box((0.01, 0.02, 0.03)).export(tmp_path / "metres.stl")
    code, output, _ = info(tmp_path / "metres.stl")
    assert (code, "`--set scale=1000` meshes a file in metres" in " ".join(output.split())) == (0, True)


def test_a_mesh_that_is_not_fit_is_shown_all_the_same(info, tmp_path: Path) -> None:
    mesh = hollow()
    turned = mesh.elements.copy()
    turned[7] = turned[7][[0, 1, 3, 2]]
    write_volume_mesh(VolumeMesh("hollow", mesh.nodes, turned), tmp_path / "turned.vtk")
    code, output, error = info(tmp_path / "turned.vtk")
    assert code == 1
    assert "inverted tetrahedra" in output
    assert "turned.vtk: element 7 is inverted" in error


def test_what_cannot_be_measured_or_read_is_refused(info, tmp_path: Path) -> None:
    nodes = hollow().nodes.copy()
    nodes[3, 1] = np.nan
    write_volume_mesh(VolumeMesh("hollow", nodes, hollow().elements), tmp_path / "nan.msh")
    code, output, error = info(tmp_path / "nan.msh")
    assert (code, output) == (2, "")
    assert "nan.msh: node 3 has a coordinate that is not finite" in error
    nodes[3, 1] = 1e200
    write_volume_mesh(VolumeMesh("hollow", nodes, hollow().elements), tmp_path / "huge.msh")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of numpy, whose products have no number
        code, output, error = info(tmp_path / "huge.msh")
    assert (code, output) == (2, "")
    assert "huge.msh: node 3 has a coordinate of 1e+200 mm; 1e+09 mm is the most" in error
    for name in ("empty.msh", "empty.stl", "empty.vtu", "empty.ply"):
        (tmp_path / name).touch()
        code, _, error = info(tmp_path / name)
        assert code == 2
        assert f"{name}: is empty; a " in error
    code, _, error = info(tmp_path / "absent.msh")
    assert code == 2
    assert "absent.msh: no such file, and none of the shipped meshes: " in error
    (tmp_path / "notes.txt").touch()
    assert (
        "'.txt' is not a kind of mesh or surface file; valid: .msh, .vtk, .vtu, .stl, .obj, .ply"
        in info(tmp_path / "notes.txt")[2]
    )


@pytest.mark.parametrize("option", ["-o", "--output"])
def test_the_figures_are_written_too(info, tmp_path: Path, option: str) -> None:
    write_volume_mesh(hollow(), tmp_path / "hollow.msh")
    file = tmp_path / "new" / "figures.json"
    code, output, _ = info(tmp_path / "hollow.msh", option, file)
    assert (code, f"written to {file}\n" in output) == (0, True)
    record = json.loads(file.read_text())
    assert record["counts"] == {"nodes": 208, "tetrahedra": 588}
    assert record["volumes_mm3"] == pytest.approx({"silicone": 98000.0, "outer": 125000.0, "cavity": 27000.0})
    assert record["quality"]["elements_across_walls"] == 1
    assert (record["problems"], len(record["remarks"])) == ([], 1)
    assert [path.name for path in file.parent.iterdir()] == ["figures.json"]


def test_what_speaks_against_a_mesh_is_written_and_drawn(info, tmp_path: Path) -> None:
    mesh = hollow()
    turned = mesh.elements.copy()
    turned[7] = turned[7][[0, 1, 3, 2]]
    write_volume_mesh(VolumeMesh("hollow", mesh.nodes, turned), tmp_path / "turned.vtk")
    assert info(tmp_path / "turned.vtk", "-o", tmp_path / "turned.json")[0] == 1
    problems = json.loads((tmp_path / "turned.json").read_text())["problems"]
    assert problems[0].startswith("element 7 is inverted")
    assert problems[1] == "1 elements have no positive volume"
    assert info(tmp_path / "turned.vtk", "-o", tmp_path / "turned.png")[0] == 1
    assert (tmp_path / "turned.png").read_bytes()[:4] == b"\x89PNG"


def test_the_figures_of_a_surface_are_written_too(info, tmp_path: Path) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    assert info(tmp_path / "box.stl", "-o", tmp_path / "box.json")[0] == 0
    record = json.loads((tmp_path / "box.json").read_text())
    assert record.pop("extent_mm") == pytest.approx([1.0, 2.0, 3.0])
    assert (record.pop("area_mm2"), record.pop("volume_mm3")) == pytest.approx((22.0, 6.0))
    assert record == {"file": "box.stl", "triangles": 12, "closed": True, "pieces": 1, "problems": []}


@pytest.mark.parametrize("output", ["box.png", "box", "box.txt"])
def test_another_kind_of_file_is_refused(info, tmp_path: Path, output: str) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    code, shown, error = info(tmp_path / "box.stl", "-o", tmp_path / output)
    assert (code, shown) == (2, "")
    suffix = Path(output).suffix
    assert error == f"taichisoft: {tmp_path / output}: '{suffix}' is not a kind of report file; valid: .json\n"
    assert info("tutorial-coarse", "-o", tmp_path / "coarse.svg")[2].endswith("valid: .json, .png\n")
