"""`taichisoft mesh`."""

from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

import taichisoft_meshing
from taichisoft.errors import MeshError
from taichisoft.mesh_files import read_volume_mesh
from taichisoft.plugins import plugin_registry


@pytest.fixture
def application() -> typer.Typer:
    """The command line with this plug-in's sub-commands only."""
    application = typer.Typer()
    application.callback()(lambda: None)
    taichisoft_meshing.taichisoft_commands(application)
    return application


def fail(application: typer.Typer, *arguments: str) -> str:
    """The message of the error that reaches the main program, which prints it."""
    result = CliRunner().invoke(application, ["mesh", *arguments])
    assert isinstance(result.exception, MeshError), result.output
    assert "\n" not in str(result.exception)
    return str(result.exception)


def test_the_plug_in_is_installed_and_adds_the_command() -> None:
    application = typer.Typer()
    plugin_registry().hook.taichisoft_commands(application=application)
    assert "mesh" in [command.name for command in application.registered_commands]


def test_a_shipped_finger_is_meshed_and_reported(application: typer.Typer, tmp_path: Path) -> None:
    output = tmp_path / "finger.msh"
    result = CliRunner().invoke(application, ["mesh", "tutorial", "-o", str(output), "--size", "14"])
    assert result.exit_code == 0, result.output
    mesh = read_volume_mesh(output)
    report = {
        cells[1].strip(): cells[2].strip() for line in result.output.splitlines() if len(cells := line.split("│")) > 3
    }
    assert report["nodes"] == str(len(mesh.nodes))
    assert report["tetrahedra"] == str(len(mesh.elements))
    assert report["silicone"] == "51162.5"
    assert report["cavity"] == "8887.5"
    assert 0 < float(report["radius ratio, smallest"]) < float(report["radius ratio, median"]) < 1
    assert 10 < float(report["longest edge"]) < 30
    assert set(mesh.surface_groups) == {"outer", "base", "cavity"}
    assert list(tmp_path.iterdir()) == [output]


def test_what_cannot_be_meshed_leaves_the_old_file_alone(application: typer.Typer, tmp_path: Path) -> None:
    output = tmp_path / "finger.msh"
    output.write_text("the mesh of yesterday")
    finger = tmp_path / "finger.toml"
    finger.write_text("[slots]\ndepth = 25.0\n")
    message = fail(application, str(finger), "-o", str(output))
    assert message.startswith(f"{finger}: slots.depth = 25: must be at most 19.4")
    assert "none of the shipped fingers: tutorial" in fail(application, "thumb", "-o", str(output))
    assert "--size 0: must be a positive, finite number of millimetres" in fail(
        application, "tutorial", "-o", str(output), "--size", "0"
    )
    assert output.read_text() == "the mesh of yesterday"


def test_an_output_that_cannot_be_written_is_refused(application: typer.Typer, tmp_path: Path) -> None:
    assert "is not a kind of volume mesh file" in fail(application, "tutorial", "-o", str(tmp_path / "finger.stl"))
    (tmp_path / "file").touch()
    below_a_file = tmp_path / "file" / "finger.msh"
    assert f"--output {below_a_file}: its folder cannot be made" in fail(
        application, "tutorial", "-o", str(below_a_file)
    )


def test_the_folder_of_the_output_is_made(application: typer.Typer, tmp_path: Path) -> None:
    output = tmp_path / "new" / "folder" / "finger.msh"
    result = CliRunner().invoke(application, ["mesh", "tutorial", "-o", str(output), "--size", "14"])
    assert result.exit_code == 0, result.output
    assert len(read_volume_mesh(output).elements) > 100
