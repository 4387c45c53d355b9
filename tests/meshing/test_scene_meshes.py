"""Meshes for scenes: made in a process of their own, kept, and found again."""

import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pytest
import typer
from conftest import Command
from typer.testing import CliRunner

import taichisoft_meshing
from taichisoft import Geometry, VolumeMesh, hookimpl, load_scene, write_volume_mesh
from taichisoft.base import SUFFIX
from taichisoft.errors import MeshError, SceneError
from taichisoft.running import plugins
from taichisoft.running.simulation import load_meshes
from taichisoft.scene import data_folder, scene_from_dict, scene_to_toml
from taichisoft_meshing import gmsh_session, mesh_job
from taichisoft_meshing.body_tables import MOST_ELEMENTS, element_count
from taichisoft_meshing.mesh_job import MeshJob, cache_folder, make_mesh, make_mesh_apart, merge_tables, mesh_for_scene


class Wedge(Geometry):
    """A kind that is meshed in no time: one tetrahedron, as large as the file and the request say."""

    presets: Mapping[str, float] = {"small": 2.0, "large": 9.0}
    meshed = 0

    def __init__(self, tables: Mapping[str, Any], file: Path):
        unknown = set(tables) - {"edge", "scale", "shape"}
        if unknown:
            raise MeshError(f"{file}: {unknown.pop()}: unknown key; valid keys: edge, scale, shape")
        self.edge = tables.get("edge", 1.0) * tables.get("scale", {}).get("x", 1.0)

    def mesh(self, size: float | None = None) -> VolumeMesh:
        Wedge.meshed += 1
        corners = (size or self.edge) * np.vstack([np.zeros(3), np.eye(3)])
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        return VolumeMesh("wedge", corners, np.array([[0, 1, 2, 3]]), {"outer": faces, "base": faces[:1]})


class Kinds:
    @hookimpl
    def taichisoft_geometry_kinds(self) -> Mapping[str, Any]:
        return {"wedge": Wedge}


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A geometry of that kind, and an empty cache."""
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(Wedge, "meshed", 0)
    path = tmp_path / "wedge.toml"
    path.write_text('kind = "wedge"\nedge = 3.0\n')
    with plugins.separate_registry():
        plugins.register_plugin(Kinds())
        yield path


def entries() -> list[Path]:
    """All that is in the cache, but for the checksums of meshes."""
    files = sorted(cache_folder().iterdir())
    return [path for path in files if path.suffix != SUFFIX or path.with_suffix("") not in files]


def same(one: VolumeMesh, other: VolumeMesh) -> bool:
    """Bit for bit, groups and their order included."""
    arrays = [
        [mesh.nodes, mesh.elements, *mesh.surface_groups.values(), *mesh.element_groups.values()]
        for mesh in (one, other)
    ]
    names = [(*mesh.surface_groups, *mesh.element_groups) for mesh in (one, other)]
    return names[0] == names[1] and all(np.array_equal(a, b) for a, b in zip(*arrays, strict=True))


def test_a_mesh_is_made_on_first_use_and_said_to_be(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "taichisoft")
    first = mesh_for_scene(file, size=4.0)
    (entry,) = entries()
    second = mesh_for_scene(file, size=4.0)
    assert Wedge.meshed == 1
    assert same(first, second)
    assert first.source == second.source == str(file)
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == f"meshing {file}, size 4.0"
    assert said[1].startswith(f"meshed {file}, size 4.0: 4 nodes in 0.") and said[1].endswith(" s")
    assert said[2:] == [f"mesh of {file}, size 4.0: 4 nodes, made before ({entry})"]


@pytest.mark.parametrize(
    ("request_", "edge"),
    [({}, 3.0), ({"size": 2.0}, 2.0), ({"preset": "large"}, 9.0), ({"set": {"edge": 5.0}}, 5.0)],
)
def test_the_request_decides(file: Path, request_: dict[str, Any], edge: float) -> None:
    for _ in range(2):
        assert mesh_for_scene(file, **request_).nodes.max() == edge


def changed_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    file.write_text('kind = "wedge"\nedge = 4.0\n')
    return {}


def changed_size(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return {"size": 3.0}


def changed_by_the_scene(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    return {"set": {"scale": {"x": 2.0}}}


def changed_named_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    (file.parent / "shape.stl").write_text("another shape")
    return {}


def changed_gmsh(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setattr(gmsh_session, "version", lambda package: "99.0")
    return {}


def changed_code(file: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    source = file.parent / "kind.py"
    source.write_text("# another way to mesh a wedge")
    monkeypatch.setattr(mesh_job.inspect, "getsourcefile", lambda kind: str(source))
    return {}


@pytest.mark.parametrize(
    "change", [changed_file, changed_size, changed_by_the_scene, changed_named_file, changed_gmsh, changed_code]
)
def test_changed_input_makes_another_mesh(
    file: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[..., dict[str, Any]]
) -> None:
    (file.parent / "shape.stl").write_text("a shape")
    file.write_text('kind = "wedge"\nedge = 3.0\nshape = { outer = ["shape.stl", 1] }\n')
    mesh_for_scene(file)
    mesh_for_scene(file, **change(file, monkeypatch))
    assert Wedge.meshed == 2
    assert len(entries()) == 2


def test_where_the_file_lies_does_not_matter(file: Path) -> None:
    mesh_for_scene(file)
    (file.parent / "folder").mkdir()
    copy = file.parent / "folder" / "wedge.toml"
    copy.write_text(file.read_text())
    assert mesh_for_scene(copy).source == str(copy)
    assert Wedge.meshed == 1


@pytest.mark.parametrize("content", [b"", b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4", b"\x00" * 500])
def test_a_mesh_that_cannot_be_read_any_more_is_made_anew(file: Path, content: bytes) -> None:
    first = mesh_for_scene(file)
    (entry,) = entries()
    entry.write_bytes(content)
    with pytest.warns(UserWarning, match=rf"{entry}.*; it is made again$"):
        assert same(mesh_for_scene(file), first)
    assert same(mesh_for_scene(file), first)
    assert Wedge.meshed == 2


def test_without_a_place_to_keep_it_the_mesh_is_the_same(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = mesh_for_scene(file)
    monkeypatch.setenv("TAICHISOFT_CACHE", str(file))  # a file: no folder can be made in it
    with pytest.warns(UserWarning, match=r"cannot be kept in .*made again every time; TAICHISOFT_CACHE can name"):
        assert same(mesh_for_scene(file), kept)


def test_kept_mesh_with_a_changed_number_is_remade(file: Path) -> None:
    """It can be read, and would be another body."""
    mesh = mesh_for_scene(file)
    (entry,) = entries()
    moved = replace(mesh, nodes=1.1 * mesh.nodes)
    write_volume_mesh(moved, entry)
    with pytest.warns(
        UserWarning, match=rf"{entry}: has changed since it was written, by its checksum; it is made again$"
    ):
        assert same(mesh_for_scene(file), mesh)
    assert same(mesh_for_scene(file), mesh)


def test_a_kind_without_source_is_not_kept(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody could tell when its code has changed."""
    monkeypatch.setattr(mesh_job.inspect, "getsourcefile", lambda kind: None)
    with pytest.warns(UserWarning, match=rf"{file}: the mesh is made again every time: the source of .* cannot be fou"):
        mesh_for_scene(file)
    assert not cache_folder().exists()


@pytest.mark.parametrize(
    ("request_", "problem"),
    [
        ({"set": {"edgy": 3.0}}, r"^{file}: edgy: unknown key; valid keys: edge, scale, shape$"),
        ({"preset": "larg"}, r"^{file}: preset 'larg': unknown; did you mean 'large'\?$"),
    ],
)
def test_a_wrong_request_leaves_nothing(file: Path, request_: dict[str, Any], problem: str) -> None:
    with pytest.raises(MeshError, match=problem.format(file=file)):
        mesh_for_scene(file, **request_)
    assert not cache_folder().exists()


def test_a_mesh_that_misses_a_limit_of_its_file_is_refused(file: Path) -> None:
    file.write_text('kind = "wedge"\n[quality]\nradius_ratio = 0.99\n')
    with pytest.raises(MeshError, match=rf"^{file}: the smallest radius ratio, 0.\d+, is below quality.radius_r"):
        mesh_for_scene(file)
    assert not cache_folder().exists()
    assert mesh_for_scene(file, set={"quality": {"radius_ratio": 0.1}}).nodes.max() == 1.0


def test_tables_are_laid_over_each_other() -> None:
    tables = {"a": 1, "b": {"c": 2, "d": {"e": 3}}}
    assert merge_tables(tables, {"b": {"d": {"e": 4, "f": 5}}, "g": 6}) == {
        "a": 1,
        "b": {"c": 2, "d": {"e": 4, "f": 5}},
        "g": 6,
    }
    assert tables == {"a": 1, "b": {"c": 2, "d": {"e": 3}}}


FINGER = data_folder() / "fingers" / "tutorial.toml"


@pytest.mark.parametrize(
    "mesh", ["tutorial", "tutorial.toml", {"file": "tutorial"}, {"file": "tutorial", "size": 14.0}]
)
def test_a_shipped_geometry_needs_no_suffix(mesh: Any) -> None:
    body = {"mesh": mesh, "mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3}
    found = scene_from_dict({"soft_bodies": {"finger": body}}).soft_bodies["finger"].mesh
    assert Path(found.file) == FINGER
    assert found.request == ({"size": 14.0} if isinstance(mesh, dict) and "size" in mesh else {})


def test_shipped_mesh_wins_over_a_shipped_geometry(file: Path) -> None:
    body = {"mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3}
    bodies = {"own": {**body, "mesh": {"file": "wedge"}}, "shipped": {**body, "mesh": "tutorial-coarse"}}
    scene = scene_from_dict({"soft_bodies": bodies}, folder=file.parent)
    assert [Path(one.mesh.file).name for one in scene.soft_bodies.values()] == ["wedge.toml", "tutorial-coarse.msh"]


def test_a_name_of_neither_a_mesh_nor_a_geometry_lists_both() -> None:
    body = {"mesh": {"file": "tutoriall"}, "mass": 0.04, "young_modulus": 500, "poisson_ratio": 0.3}
    with pytest.raises(SceneError) as refused:
        scene_from_dict({"soft_bodies": {"finger": body}})
    assert str(refused.value).startswith(
        "scene: soft_bodies.finger.mesh.file: tutoriall: no such file, and none of the "
    )
    assert str(refused.value).endswith("; fingers: long, slim, soft-tip, tendon, tutorial; did you mean 'tutorial'?")


SAVE_FINGER = f"""
import numpy, sys
from pathlib import Path
from taichisoft_meshing.mesh_job import mesh_for_scene
mesh = mesh_for_scene(Path({str(FINGER)!r}), size=16.0)
numpy.savez(sys.argv[1], nodes=mesh.nodes, elements=mesh.elements, **mesh.surface_groups)
"""


def test_two_processes_at_once_get_the_same_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And a third one, later, gets the same bits from the cache, in which nothing else is left."""
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    names = [str(tmp_path / f"{number}.npz") for number in range(2)]
    racing = [subprocess.Popen([sys.executable, "-c", SAVE_FINGER, name]) for name in names]
    assert [process.wait() for process in racing] == [0, 0]
    assert len(entries()) == 1
    mesh = mesh_for_scene(FINGER, size=16.0)
    assert len(entries()) == 1
    ours = {"nodes": mesh.nodes, "elements": mesh.elements, **mesh.surface_groups}
    for name in names:
        theirs = np.load(name)
        assert all(np.array_equal(array, theirs[key]) for key, array in ours.items())


def test_bodies_of_a_scene_that_names_a_geometry(file: Path) -> None:
    """A body, and another one like it: one mesh. The scene keeps its request, also when it is written."""
    body = {"mesh": {"file": str(file), "set": {"edge": 7.0}}, "mass": 1.0, "young_modulus": 1.0, "poisson_ratio": 0.3}
    scene = scene_from_dict({"soft_bodies": {"one": body, "two": {"like": "one"}}})
    meshes = load_meshes(scene)
    assert Wedge.meshed == 1
    assert meshes["one"] is meshes["two"]
    assert meshes["one"].nodes.max() == 7.0
    written = file.parent / "scene.toml"
    written.write_text(scene_to_toml(scene))
    assert load_scene(written) == scene
    with pytest.raises(SceneError, match=rf"^soft_bodies.one.mesh: {file}: edgy: unknown key"):
        load_meshes(load_scene(written, ["soft_bodies.one.mesh.set.edgy=3"]))


# `taichisoft mesh cache`, and where it looks.


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path))
    return tmp_path / "meshes"


def shown(*arguments: str) -> str:
    application = typer.Typer()
    taichisoft_meshing.taichisoft_commands(application)
    result = CliRunner().invoke(application, ["mesh", "cache", *arguments])
    assert result.exit_code == 0, result.output
    return result.output.strip()


def test_cache_folder_follows_the_variable(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cache_folder() == folder
    monkeypatch.setenv("TAICHISOFT_CACHE", "~/elsewhere")
    assert cache_folder() == Path.home() / "elsewhere" / "meshes"
    monkeypatch.delenv("TAICHISOFT_CACHE")
    assert cache_folder() == platformdirs.user_cache_path("taichisoft", appauthor=False) / "meshes"


def test_it_is_shown_and_cleared(folder: Path) -> None:
    """Other files in the folder stay."""
    assert shown() == f"0 meshes, 0.0 MB, in {folder}"
    folder.mkdir()
    for name in ("one.msh", "one.msh.sha256", "two.msh", ".three.msh.17.partial", "notes.txt"):
        (folder / name).write_bytes(bytes(150_000))
    assert shown() == f"2 meshes, 0.3 MB, in {folder}"
    assert shown("--clear") == f"deleted 2 meshes, 0.3 MB, in {folder}"
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]
    assert shown() == f"0 meshes, 0.0 MB, in {folder}"


# Meshing in a process of its own: what crashes there, or does not end, is one line with the name of the file.

KIND = """
import os, time
from taichisoft import Geometry, hookimpl

class Odd(Geometry):
    def __init__(self, tables, path):
        self.does, self.begun = tables["does"], tables.get("begun")
    def mesh(self, size=None):
        if self.does == "crash":
            os.abort()
        if self.begun:
            with open(self.begun + ".partial", "w") as file:
                file.write(str(os.getpid()))
            os.rename(self.begun + ".partial", self.begun)
        time.sleep(600)

@hookimpl
def taichisoft_geometry_kinds():
    return {"odd": Odd}
"""


@pytest.fixture
def odd(tmp_path: Path, taichisoft_plugins: object) -> Path:
    """A plug-in whose kind crashes, or never comes to an end."""
    path = tmp_path / "odd.py"
    path.write_text(KIND)
    plugins.load_plugin(path)
    return tmp_path / "body.toml"


def test_a_crash_is_one_line_with_the_name_of_the_file(odd: Path) -> None:
    with pytest.raises(MeshError, match=r"body\.toml: the process that meshes it ended without a mesh: .*SIGABRT$"):
        make_mesh_apart(MeshJob("odd", {"does": "crash"}, odd, {}))


PARENT = """
import sys
from pathlib import Path
from taichisoft.running.plugins import load_plugin
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_meshing.mesh_job import make_mesh_apart

load_plugin(Path(sys.argv[1]))
make_mesh_apart(MeshJob("odd", {"does": "wait", "begun": sys.argv[2]}, Path("body.toml"), {}))
"""


@pytest.mark.skipif(os.name != "posix", reason="asks for a process by a signal")
def test_who_is_killed_while_a_mesh_is_made_leaves_no_process(odd: Path, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    words = [sys.executable, "-c", PARENT, str(tmp_path / "odd.py"), str(begun)]
    parent = subprocess.Popen(words)
    while not begun.exists():
        assert parent.poll() is None
        time.sleep(0.02)
    meshing = int(begun.read_text())
    parent.kill()
    parent.wait()
    try:
        with pytest.raises(ProcessLookupError):
            for _ in range(500):
                os.kill(meshing, 0)
                time.sleep(0.02)
    finally:
        with suppress(ProcessLookupError):
            os.kill(meshing, signal.SIGKILL)


def test_endless_mesh_reports_and_meets_its_time_limit(
    odd: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(mesh_job, "BETWEEN_LINES", 0.2)
    with caplog.at_level("INFO"), pytest.raises(MeshError, match=r"body\.toml: .* took more than 0\.5 s; take larger"):
        make_mesh_apart(MeshJob("odd", {"does": "wait"}, odd, {}), time_limit=0.5)
    assert "body.toml: 0 s so far" in caplog.text


def test_the_mesh_is_the_one_that_this_process_would_make() -> None:
    from taichisoft.scene import data_folder
    from taichisoft_meshing.geometry_file import read_tables

    file = data_folder() / "fingers" / "tutorial.toml"
    kind, tables = read_tables(file)
    job = MeshJob(kind, tables, file, {"size": 14.0})
    apart, here = make_mesh_apart(job), make_mesh(job)
    np.testing.assert_array_equal(apart.mesh.nodes, here.mesh.nodes)
    np.testing.assert_array_equal(apart.mesh.elements, here.mesh.elements)
    assert apart.remarks == here.remarks


@pytest.mark.parametrize("key", ["largest", "smallest"])
def test_mesh_too_large_is_refused_before_gmsh_starts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: Command, key: str
) -> None:
    monkeypatch.chdir(tmp_path)
    sizes = ("--set", f"mesh.{key}=0.001", "--set", "mesh.smallest=0.001")
    code, _, line = command("mesh", "tutorial", *sizes, "-o", "x.msh")
    assert code == 2 and line.count("\n") == 1
    assert "it would make about" in line and f"{MOST_ELEMENTS:.0e} are the most" in line
    assert not list(tmp_path.iterdir())


def test_the_estimate_is_that_of_regular_tetrahedra() -> None:
    """A regular tetrahedron of edge s has s^3 / (6 sqrt 2); a metre of 0.001 mm has some 1e19."""
    assert element_count(1e9, 1.0, 1.0) == pytest.approx(6 * np.sqrt(2) * 1e9, rel=2e-3)
    assert element_count(1e3, 10.0, 0.001, [100.0]) > 1e8 > element_count(1e3, 10.0, 0.001)
