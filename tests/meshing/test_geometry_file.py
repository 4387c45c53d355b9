"""Geometry files: their kind chooses the plug-in that meshes them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command

from taichisoft import Geometry, VolumeMesh, hookimpl, read_volume_mesh
from taichisoft.errors import MeshError, PluginError
from taichisoft.running import plugins
from taichisoft_meshing.geometry_file import mesh_geometry, read_geometry


class Wedge(Geometry):
    """A third party's kind: one tetrahedron of an edge length."""

    def __init__(self, tables: Mapping[str, Any], file: Path):
        unknown = set(tables) - {"edge"}
        if unknown:
            raise MeshError(f"{file}: {unknown.pop()}: unknown key; valid keys: edge")
        self.edge = tables["edge"]
        self.file = file

    def mesh(self, size: float | None = None) -> VolumeMesh:
        if self.edge < 0:
            raise MeshError(f"{self.file}: edge = {self.edge}: must be positive")
        corners = (size or self.edge) * np.vstack([np.zeros(3), np.eye(3)])
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        return VolumeMesh("wedge", corners, np.array([[0, 1, 2, 3]]), {"outer": faces})


class Kinds:
    @hookimpl
    def taichisoft_geometry_kinds(self) -> Mapping[str, Any]:
        return {"wedge": Wedge, "nothing": lambda tables, file: file}


@pytest.fixture(autouse=True)
def kinds() -> Iterator[None]:
    plugins.register_plugin(Kinds())
    yield
    plugins.unregister_plugin("Kinds")


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_the_kind_chooses_who_meshes_a_file(tmp_path: Path, command: Command) -> None:
    file, mesh = write(tmp_path / "wedge.toml", 'kind = "wedge"\nedge = 3.0'), tmp_path / "wedge.msh"
    code, shown, _ = command("mesh", file, "-o", mesh)
    assert code == 0 and "closed, faces outward" in shown
    assert read_volume_mesh(mesh).nodes.max() == 3.0
    assert command("mesh", file, "-o", mesh, "--size", "2")[0] == 0
    assert read_volume_mesh(mesh).nodes.max() == 2.0


def test_a_finger_is_the_kind_of_a_file_that_names_none(tmp_path: Path) -> None:
    named = read_geometry(write(tmp_path / "named.toml", 'kind = "pneunet_finger"\nbody.width = 21.0'))
    default = read_geometry(write(tmp_path / "default.toml", "body.width = 21.0"))
    meshes = [mesh_geometry(geometry, 14.0, tmp_path) for geometry in (named, default)]
    assert np.array_equal(meshes[0].nodes, meshes[1].nodes)
    assert np.ptp(meshes[0].nodes[:, 2]) == pytest.approx(21.0)


@pytest.mark.parametrize(
    ("text", "error", "problem"),
    [
        ('kind = "wegde"', MeshError, r"^{file}: kind = 'wegde': unknown; did you mean 'wedge'\?$"),
        ("kind = [3]", MeshError, r"^{file}: kind = \[3\]: unknown; there are: nothing, pneunet_finger, .*wedge$"),
        ('kind = "wedge"\nsides = 3', MeshError, r"^{file}: sides: unknown key; valid keys: edge$"),
        (
            'kind = "wedge"',
            PluginError,
            r"^{file}: geometry kind 'wedge' failed: KeyError: 'edge' \(test_geometry_file",
        ),
        ('kind = "wedge"\nedge = -1', MeshError, r"^{file}: edge = -1: must be positive$"),
        (
            'kind = "wedge"\nedge = "1"',
            PluginError,
            r"^{file}: Wedge failed in mesh\(\): TypeError: .*test_geometry_fil",
        ),
        ('kind = "wedge"\nedge = 0.0', MeshError, r"wedge: element 0 .*has no volume"),
        (
            'kind = "nothing"',
            PluginError,
            r"^{file}: geometry kind 'nothing' gave PosixPath\(.*; must be a taichisoft.Geometry$",
        ),
        ("body.width = -1.0", MeshError, r"^{file}: body.width = -1.0: input should be greater than 0$"),
    ],
)
def test_what_is_wrong_is_said_with_the_file(tmp_path: Path, text: str, error: type[Exception], problem: str) -> None:
    file = write(tmp_path / "body.toml", text)
    with pytest.raises(error, match=problem.format(file=file)):
        mesh_geometry(read_geometry(file), None, file)


def test_what_a_kind_gives_must_be_a_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Wedge, "mesh", lambda self, size: None)
    file = write(tmp_path / "body.toml", 'kind = "wedge"\nedge = 1.0')
    with pytest.raises(PluginError, match=r"^.*body.toml: Wedge.mesh\(\) gave None; must be a VolumeMesh$"):
        mesh_geometry(read_geometry(file), None, file)
