"""`taichisoft mesh`: what it writes, what it says, and what it refuses."""

import json
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from conftest import Command
from solid_shapes import box, save, write_step

from taichisoft import read_volume_mesh, write_volume_mesh
from taichisoft.mesh import read_surface
from taichisoft.running import plugins
from taichisoft_meshing import mesh_set


class Result:
    """The end of a command: exit code, standard output and error."""

    def __init__(self, code: int, output: str, error: str):
        self.code, self.output, self.error = code, output, error

    @property
    def figures(self) -> dict[str, str]:
        """Label and value of the first rows of each name."""
        figures: dict[str, str] = {}
        for line in self.output.splitlines():
            cells = line.split("│")
            if len(cells) > 3:
                figures.setdefault(cells[1].strip(), cells[2].strip())
        return figures


@pytest.fixture
def command(command: Command) -> Iterator[Callable[..., Result]]:
    import block_kind

    plugins.register_plugin(block_kind)
    yield lambda *arguments: Result(*command(*arguments))
    plugins.unregister_plugin("block_kind")


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A geometry file that is meshed at once."""
    path = tmp_path / "block.toml"
    path.write_text('kind = "block"\n')
    return path


@pytest.fixture(autouse=True)
def nothing_half_written(tmp_path: Path) -> Iterator[None]:
    yield
    assert not list(tmp_path.rglob("*.partial"))


def test_a_shipped_finger_is_meshed_and_reported(command, tmp_path: Path) -> None:
    output = tmp_path / "new" / "folder" / "finger.msh"
    result = command("mesh", "tutorial", "-o", output, "--size", 14)
    assert result.code == 0, result.error
    mesh = read_volume_mesh(output)
    assert result.figures["nodes"] == str(len(mesh.nodes))
    assert result.figures["tetrahedra"] == str(len(mesh.elements))
    assert result.figures["silicone"] == "51162.5"
    assert result.figures["cavity"] == "8887.5"
    assert 0 < float(result.figures["radius ratio, smallest"]) < float(result.figures["radius ratio, median"]) < 1
    assert 10 < float(result.figures["longest edge"]) < 30
    assert "warning: walls of one element, too stiff where they bend: linear ones much" in result.output
    assert set(mesh.surface_groups) == {"outer", "base", "cavity"}
    assert list(output.parent.iterdir()) == [output]


def test_a_folder_gets_the_whole_set(command, block: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out" / "body"
    assert command("mesh", block, "-o", folder).code == 0
    names = ["body-cavity.stl", "body-outer.stl", "body.msh", "body.vtk", "body.vtu", "mesh-report.png", "mesh.json"]
    assert sorted(file.name for file in folder.iterdir()) == names
    meshes = [read_volume_mesh(folder / f"body{suffix}") for suffix in (".msh", ".vtk", ".vtu")]
    for mesh in meshes:
        np.testing.assert_array_equal(mesh.nodes, meshes[0].nodes)
        np.testing.assert_array_equal(mesh.elements, meshes[0].elements)
    vertices, triangles = read_surface(folder / "body-cavity.stl")
    cavity = meshes[0].surface_groups["cavity"]
    assert len(triangles) == len(cavity)
    np.testing.assert_array_equal(vertices[triangles], meshes[0].nodes[cavity])  # every digit


def test_the_record_says_what_the_mesh_is(command, block: Path, tmp_path: Path) -> None:
    block.write_text('kind = "block"\nstretch = 2.0\n[quality]\nradius_ratio = 0.2\n')
    assert command("mesh", block, "-o", tmp_path / "body", "--preset", "fine", "--set", "solid=false").code == 0
    record = json.loads((tmp_path / "body" / "mesh.json").read_text())
    assert record["kind"] == "block"
    assert record["parameters"] == {"stretch": 2.0, "solid": False, "quality": {"radius_ratio": 0.2}}
    assert record["asked"] == {"preset": "fine"}
    assert record["counts"] == {"nodes": 1331 - 7**3, "tetrahedra": 6 * (1000 - 8**3)}
    assert record["volumes_mm3"] == {"silicone": 250000.0 - 128000.0, "cavity": 128000.0, "outer": 250000.0}
    assert record["groups"]["surfaces"] == {"cavity": {"triangles": 2 * 6 * 64}}
    assert record["limits"]["radius_ratio"] == 0.2
    assert record["quality"]["walls"][0]["thinnest_mm"] == 5.0
    assert record["quality"]["elements_across_walls"] == 1
    assert set(record["versions"]) == {"taichisoft", "gmsh"}
    assert record["problems"] == []


def test_equal_inputs_give_equal_files_and_equal_hashes(
    command, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def meshed(name: str, *options: object) -> dict:
        assert command("mesh", block, "-o", tmp_path / name / "body", *options).code == 0
        return json.loads((tmp_path / name / "body" / "mesh.json").read_text())

    first, again = meshed("first"), meshed("again")
    assert first == again
    monkeypatch.setattr(mesh_set, "draw_report", lambda *_: None)  # it takes the longest
    assert meshed("finer", "--size", 5)["inputs_sha256"] != first["inputs_sha256"]
    block.write_text('# a comment\nkind = "block"   # changes nothing\n')
    assert meshed("comment")["inputs_sha256"] == first["inputs_sha256"]
    assert meshed("solid", "--set", "solid=true")["inputs_sha256"] != first["inputs_sha256"]


def test_a_new_set_replaces_the_old_one_and_leaves_other_files(command, block: Path, tmp_path: Path) -> None:
    folder = tmp_path / "body"
    assert command("mesh", block, "-o", folder).code == 0
    (folder / "notes.txt").write_text("mine")
    assert command("mesh", block, "-o", folder, "--set", "solid=true").code == 0
    names = ["body-outer.stl", "body.msh", "body.vtk", "body.vtu", "mesh-report.png", "mesh.json", "notes.txt"]
    assert sorted(file.name for file in folder.iterdir()) == names
    assert "cavity" not in json.loads((folder / "mesh.json").read_text())["volumes_mm3"]


def test_a_set_that_cannot_be_written_leaves_the_old_one(
    command, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "body"
    assert command("mesh", block, "-o", folder).code == 0
    before = {file.name: file.read_bytes() for file in folder.iterdir()}

    def fill_the_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mesh_set, "mesh_record", fill_the_disk)
    result = command("mesh", block, "-o", folder, "--size", 5)
    assert result.code == 2
    assert result.error == f"taichisoft: {folder}: cannot be written: No space left on device\n"
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_a_record_never_stands_beside_files_of_another_mesh(
    command, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk fails while the files are moved: without its record nobody takes them for one set."""
    folder = tmp_path / "body"
    assert command("mesh", block, "-o", folder).code == 0
    replace = Path.replace

    def fail_at_the_picture(self: Path, target: Path) -> Path:
        if target == folder / "mesh-report.png":
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fail_at_the_picture)
    assert command("mesh", block, "-o", folder, "--size", 5).error.endswith("cannot be written: Input/output error\n")
    assert not (folder / "mesh.json").exists()


@pytest.mark.skipif(os.name != "posix", reason="locks of folders")
def test_a_set_waits_while_another_is_moved_into_its_folder(command, block: Path, tmp_path: Path) -> None:
    """Else the files of both would lie there mixed, beside the record of one."""
    import fcntl

    output, record = tmp_path / "out", tmp_path / "out" / "mesh.json"
    assert command("mesh", block, "-o", output).code == 0
    older, new = record.read_bytes(), tmp_path / "new"
    new.mkdir()
    (new / "mesh.json").write_text("{}")
    handle = os.open(output, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    moving = threading.Thread(target=mesh_set.move_set, args=(new, output))
    moving.start()
    moving.join(timeout=0.5)
    assert moving.is_alive()
    assert record.read_bytes() == older
    os.close(handle)
    moving.join()
    assert [file.name for file in output.iterdir()] == ["mesh.json"]


def test_ctrl_c_while_a_set_is_written_comes_when_it_is_whole(
    command, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = mesh_set.draw_report

    def interrupt(*arguments: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        draw(*arguments)

    monkeypatch.setattr(mesh_set, "draw_report", interrupt)
    assert command("mesh", block, "-o", tmp_path / "body").code == 130
    assert len(json.loads((tmp_path / "body" / "mesh.json").read_text())["files_sha256"]) == 6
    assert len(list((tmp_path / "body").iterdir())) == 7


def test_ctrl_c_before_leaves_nothing(command, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sleep = time.sleep

    def interrupt(seconds: float) -> None:
        """What threads of other tests wait for goes on."""
        if threading.current_thread() is threading.main_thread():
            signal.raise_signal(signal.SIGINT)
        sleep(seconds)

    monkeypatch.setattr(time, "sleep", interrupt)
    assert command("mesh", block, "-o", tmp_path / "body").code == 130
    assert list(tmp_path.iterdir()) == [block]


def test_a_name_that_ends_in_a_number_is_a_folder(command, block: Path, tmp_path: Path) -> None:
    assert command("mesh", block, "-o", tmp_path / "wall-1.5").code == 0
    assert (tmp_path / "wall-1.5" / "wall-1.5.msh").is_file()


def test_a_mesh_is_not_meshed_again(command, tmp_path: Path) -> None:
    write_volume_mesh(make_block((1, 1, 1), (1.0, 1.0, 1.0)), tmp_path / "body.vtk")
    refused = command("mesh", tmp_path / "body.vtk", "-o", tmp_path / "out")
    assert refused.code == 2
    assert "body.vtk: is a mesh of tetrahedra already; a scene takes it as it is" in refused.error


def test_missed_limit_is_named_and_only_force_writes(command, block: Path, tmp_path: Path) -> None:
    block.write_text('kind = "block"\n[quality]\nradius_ratio = 0.8\nelements_across_walls = 2\n')
    refused = command("mesh", block, "-o", tmp_path / "body")
    assert refused.code == 2
    limit = f"taichisoft: {block}: the smallest radius ratio, 0.7174, is below quality.radius_ratio = 0.8"
    assert re.fullmatch(
        r" in \d+ elements, the worst at \[[-\d., ]+\] mm \(and 1 more\); "
        "try another size, or --force writes the mesh all the same\n",
        refused.error.removeprefix(limit),
    )
    assert "not written" in refused.output
    assert list(tmp_path.iterdir()) == [block]
    forced = command("mesh", block, "-o", tmp_path / "body", "--force")
    assert forced.code == 0
    assert "warning: elements across walls, 1, is below quality.elements_across_walls = 2" in forced.output
    assert len(json.loads((tmp_path / "body" / "mesh.json").read_text())["problems"]) == 2


def test_a_mesh_that_is_not_the_body_is_refused(command, block: Path, tmp_path: Path) -> None:
    refused = command("mesh", block, "-o", tmp_path / "body.msh", "--set", "turned=true")
    assert "surface 'cavity' is inside out: it encloses -27000 mm^3" in refused.error
    assert not (tmp_path / "body.msh").exists()


def test_what_was_warned_of_while_meshing_is_said(command, block: Path, tmp_path: Path) -> None:
    result = command("mesh", block, "-o", tmp_path / "body.vtu", "--set", "remark=the surface was mended")
    assert "warning: the surface was mended\n" in result.output
    assert result.error == ""


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--size", "0"], "--size 0: must be a positive, finite number of millimetres"),
        (["--size", "-3"], "--size -3: must be a positive, finite number of millimetres"),
        (["--size", "nan"], "--size nan: must be a positive, finite number of millimetres"),
        (["--nodes", "3"], "--nodes 3: must lie between 4, "),
        (["--nodes", "1000000000"], "--nodes 1000000000: must lie between 4, a single tetrahedron, and 1000000"),
        (["--size", "3", "--preset", "fine"], "--size and --preset: only one of them can be given"),
        (["--preset", "finest"], "preset 'finest': unknown; did you mean 'fine'?"),
        (["--set", "stretch"], "--set stretch: must look like body.width=21"),
        (["--set", "stretch.x=3"], "stretch = {'x': 3}"),
        (["--set", "stetch=3"], "stetch: unknown key"),
        (["--set", "quality.radius_ratio=2"], "quality.radius_ratio = 2: input should be less than or equal to 1"),
        (["--face", "base"], "--face base: must look like 7=base: a number and the name of its group"),
        (["--section", "up"], "section 'up' must be a plane in mm"),
        (["second.toml"], "second.toml: one file is meshed at a time; several need --surfaces"),
    ],
)
def test_options_that_are_wrong_are_named(
    command, block: Path, tmp_path: Path, arguments: list[str], problem: str
) -> None:
    if "stretch.x=3" in arguments:
        problem = "Block failed in mesh(): TypeError"
    result = command("mesh", block, "-o", tmp_path / "body", *arguments)
    assert result.code == (1 if "failed" in problem else 2)  # of a plug-in that does not check what it is given
    assert problem in result.error
    assert list(tmp_path.iterdir()) == [block]


def test_surfaces_and_step_files_are_meshed_as_they_are(command, tmp_path: Path) -> None:
    """A box of 30 mm with two cavities, the files in different folders; the same from CAD, with one cavity."""
    (tmp_path / "air").mkdir()
    outer = save(box((30, 30, 30), parts=2), tmp_path / "outer.stl")
    cavities = [save(box((8, 8, 8), at=(x, 0, 0), parts=1), tmp_path / "air" / f"{x}.ply") for x in (-8, 8)]
    kept = command(
        "mesh", "--surfaces", outer, *cavities, "--set", "keep_surface=true", "-o", tmp_path / "kept.msh", "--size", 9
    )
    assert kept.code == 0, kept.error
    assert kept.figures["cavity_0"] == kept.figures["cavity_1"] == "512.0"
    groups = read_volume_mesh(tmp_path / "kept.msh").surface_groups
    assert (len(groups["outer"]), len(groups["cavity_0"])) == (12 * 16, 12 * 4)
    meshed = command("mesh", "--surfaces", outer, *cavities, "-o", tmp_path / "meshed.msh", "--set", "cavities=2")
    assert meshed.code == 0, meshed.error
    assert len(read_volume_mesh(tmp_path / "meshed.msh").surface_groups["outer"]) != 12 * 16

    def draw(occ: Any) -> object:
        return occ.cut([(3, occ.addBox(0, 0, 0, 30, 30, 30))], [(3, occ.addBox(10, 10, 10, 10, 10, 10))])

    body = write_step(tmp_path / "body.step", draw)
    from_cad = command("mesh", body, "-o", tmp_path / "cad.vtu", "--preset", "coarse")
    assert from_cad.code == 0, from_cad.error
    assert from_cad.figures["silicone"] == "26000.0"
    assert "cavities = 3" in command("mesh", body, "-o", tmp_path / "x.msh", "--set", "cavities=3").error


def test_the_faces_of_a_step_body_are_listed_and_become_groups(command, tmp_path: Path) -> None:
    """Two boxes, one on the other: solids and faces by their numbers, and pictures of them and of a section."""
    body = write_step(tmp_path / "two.step", lambda occ: [occ.addBox(0, 0, z, 9, 4, 2) for z in (0, 2)])
    listed = command("mesh", "info", body, "-o", tmp_path / "faces.json")
    faces = json.loads((tmp_path / "faces.json").read_text())["faces"]
    assert len(faces) == 11, "one is shared"
    (top,) = [one for one in faces if one["centre_mm"] == [4.5, 2.0, 4.0]]
    assert (top["area_mm2"], top["normal"], top["solids"]) == (36.0, [0.0, 0.0, 1.0], [2])
    assert re.search(rf"│ +{top['number']} │ 2 +│ +36.0 │ 4.5, 2, 4 +│ 0, 0, 1 ", listed.output), listed.output
    options = ["--face", f"{top['number']}=pad", "--solid", "1=stiff", "--section", "x=3", "--size", 4]
    meshed = command("mesh", body, "-o", tmp_path / "two", *options)
    assert meshed.code == 0, meshed.error
    mesh = read_volume_mesh(tmp_path / "two" / "two.msh")
    assert np.all(mesh.nodes[mesh.surface_groups["pad"]][..., 2] == 4.0)
    assert set(mesh.element_groups) == {"silicone", "stiff", "solid_2"}


def test_a_surface_names_the_option_that_it_needs(command, tmp_path: Path) -> None:
    (tmp_path / "skin.stl").write_text("something")
    error = command("mesh", tmp_path / "skin.stl", "-o", tmp_path / "body").error
    assert error.endswith("skin.stl: is not a geometry file (.toml); --surfaces meshes it as it is\n")


def test_what_cannot_be_meshed_leaves_the_old_file_alone(command, tmp_path: Path) -> None:
    output = tmp_path / "finger.msh"
    output.write_text("the mesh of yesterday")
    finger = tmp_path / "finger.toml"
    finger.write_text("[slots]\ndepth = 25.0\n")
    assert command("mesh", finger, "-o", output).error.startswith(f"taichisoft: {finger}: slots.depth = 25: must be ")
    assert "none of the shipped fingers: " in command("mesh", "thumb", "-o", output).error
    assert output.read_text() == "the mesh of yesterday"


def test_unwritable_output_is_refused_before_meshing(command, tmp_path: Path) -> None:
    assert "is not a kind of volume mesh file" in command("mesh", "tutorial", "-o", tmp_path / "finger.stl").error
    (tmp_path / "file").touch()
    below_a_file = tmp_path / "file" / "finger.msh"
    assert (
        f"--output {below_a_file}: its folder cannot be made" in command("mesh", "tutorial", "-o", below_a_file).error
    )
    assert (
        f"--output {tmp_path / 'file'}: is a file; a folder"
        in command("mesh", "tutorial", "-o", tmp_path / "file").error
    )


def test_a_folder_that_nobody_may_write_to_is_refused(command, tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    user, nobody = os.getuid(), 65534
    os.setreuid(nobody if user == 0 else user, -1)  # root may write anywhere
    try:
        assert "no permission to write" in command("mesh", "tutorial", "-o", closed / "finger.msh").error
    finally:
        os.setreuid(user, -1)
