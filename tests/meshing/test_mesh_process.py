"""Meshing in a process of its own: what crashes there, or does not end, is one line with the name of the file."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from test_odd_input import told

from taichisoft.errors import MeshError
from taichisoft.running import plugins
from taichisoft_meshing import mesh_job
from taichisoft_meshing.body_tables import MOST_ELEMENTS, element_count
from taichisoft_meshing.mesh_job import MeshJob, make_mesh, make_mesh_apart

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


def test_a_mesh_that_does_not_end_has_a_limit_and_says_that_it_goes_on(
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
def test_a_mesh_that_cannot_fit_is_refused_with_an_estimate_before_gmsh_starts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, key: str
) -> None:
    monkeypatch.chdir(tmp_path)
    line = told(
        monkeypatch,
        capsys,
        "mesh",
        "tutorial",
        "--set",
        f"mesh.{key}=0.001",
        "--set",
        "mesh.smallest=0.001",
        "-o",
        "x.msh",
    )
    assert "it would make about" in line and f"{MOST_ELEMENTS:.0e} are the most" in line
    assert not list(tmp_path.iterdir())


def test_the_estimate_is_that_of_regular_tetrahedra() -> None:
    """A regular tetrahedron of edge s has s^3 / (6 sqrt 2); a metre of 0.001 mm has some 1e19."""
    assert element_count(1e9, 1.0, 1.0) == pytest.approx(6 * np.sqrt(2) * 1e9, rel=2e-3)
    assert element_count(1e3, 10.0, 0.001, [100.0]) > 1e8 > element_count(1e3, 10.0, 0.001)
