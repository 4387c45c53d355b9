"""The documented example of a third party's geometry kind, run as a user would."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

from taichisoft import read_volume_mesh
from taichisoft.mesh import enclosed_volume
from taichisoft.running import plugins
from taichisoft.scene import data_folder

FOLDER = data_folder() / "plugins"


@pytest.fixture(autouse=True)
def separate_plugins() -> Iterator[None]:
    with plugins.separate_registry():
        yield


def test_the_example_is_meshed(tmp_path: Path, command: Command) -> None:
    """Chords of a 16th turn cut 2.6 % off a circle, so the air has a little less than pi r^2 l."""
    output = tmp_path / "tube.msh"
    arguments = ["mesh", FOLDER / "tube.toml", "--plugin", FOLDER / "tube.py", "-o", output]
    assert command(*arguments)[0] == 0
    mesh = read_volume_mesh(output)
    assert set(mesh.surface_groups) == {"outer", "cavity", "base"}
    for name, volume in (("outer", np.pi * 10**2 * 60), ("cavity", np.pi * 7**2 * 54)):
        assert 0.97 * volume < enclosed_volume(mesh.nodes, mesh.surface_groups[name]) < volume
    assert (mesh.nodes[mesh.surface_groups["base"], 0] == 0).all()
    plugins.unregister_plugin("tube")
    assert command(*arguments, "--preset", "medium")[0] == 0
    assert len(read_volume_mesh(output).nodes) > len(mesh.nodes)


def test_a_wrong_value_is_told_with_the_file(tmp_path: Path, command: Command) -> None:
    file = tmp_path / "tube.toml"
    file.write_text('kind = "tube"\nwall = 12.0\n')
    code, _, errors = command("mesh", file, "--plugin", FOLDER / "tube.py", "-o", tmp_path / "out")
    assert code == 2 and f"taichisoft: {file}: wall = 12: leaves no air; must be below 10" in errors
    assert list(tmp_path.iterdir()) == [file]
