"""Meshes for scenes: made once for the same inputs, whatever happens to the cache."""

import logging
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichisoft import Geometry, VolumeMesh, hookimpl, load_scene, write_volume_mesh
from taichisoft.base import SUFFIX
from taichisoft.errors import MeshError, SceneError
from taichisoft.running import plugins
from taichisoft.running.simulation import load_meshes
from taichisoft.scene import data_folder, scene_from_dict, scene_to_toml
from taichisoft_meshing import gmsh_session, mesh_job
from taichisoft_meshing.mesh_job import cache_folder, merge_tables, mesh_for_scene


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
def test_whatever_a_mesh_is_made_from_another_one_is_made_when_it_changes(
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


def test_a_kept_mesh_of_which_one_number_was_changed_is_made_anew(file: Path) -> None:
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


def test_a_geometry_beside_the_scene_needs_none_and_a_shipped_mesh_wins_over_a_geometry(file: Path) -> None:
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


def test_two_processes_that_make_the_same_mesh_at_a_time_both_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
