"""`taichisoft mesh cache`, and where it looks."""

from pathlib import Path

import platformdirs
import pytest
import typer
from typer.testing import CliRunner

import taichisoft_meshing
from taichisoft_meshing.mesh_job import cache_folder


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


def test_it_lies_where_the_variable_says_and_in_the_users_cache_otherwise(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
