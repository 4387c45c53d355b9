"""The documented example of a third party's geometry kind, run as a user would."""

import sys
from pathlib import Path

import numpy as np
import pytest

from taichisoft import read_volume_mesh, unregister_plugin
from taichisoft.command_line import main
from taichisoft.mesh import enclosed_volume
from taichisoft.scene import data_folder

FOLDER = data_folder() / "plugins"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["taichisoft", *arguments])
    try:
        with pytest.raises(SystemExit) as left:
            main()
    finally:
        unregister_plugin("tube")
    return int(left.value.code or 0)


def test_the_example_is_meshed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chords of a 16th turn cut 2.6 % off a circle, so the air has a little less than pi r^2 l."""
    output = tmp_path / "tube.msh"
    arguments = ["mesh", str(FOLDER / "tube.toml"), "--plugin", str(FOLDER / "tube.py"), "-o", str(output)]
    assert run(monkeypatch, *arguments) == 0
    mesh = read_volume_mesh(output)
    assert set(mesh.surface_groups) == {"outer", "cavity", "base"}
    for name, volume in (("outer", np.pi * 10**2 * 60), ("cavity", np.pi * 7**2 * 54)):
        assert 0.97 * volume < enclosed_volume(mesh.nodes, mesh.surface_groups[name]) < volume
    assert (mesh.nodes[mesh.surface_groups["base"], 0] == 0).all()
    assert run(monkeypatch, *arguments, "--preset", "medium") == 0
    assert len(read_volume_mesh(output).nodes) > len(mesh.nodes)


def test_a_wrong_value_is_told_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "tube.toml"
    file.write_text('kind = "tube"\nwall = 12.0\n')
    assert run(monkeypatch, "mesh", str(file), "--plugin", str(FOLDER / "tube.py"), "-o", str(tmp_path / "out")) == 2
    assert f"taichisoft: {file}: wall = 12: leaves no air; must be below 10" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == [file]
