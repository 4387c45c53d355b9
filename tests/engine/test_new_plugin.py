"""`taichisoft plugins new` writes a project under any name that can be one; test_installation.py runs its own tests."""

import csv
import importlib.util
import re
import tomllib
from pathlib import Path

import pytest
from conftest import Command, examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from taichisoft.errors import PluginError
from taichisoft.running import hooks, plugins
from taichisoft.running.plugin_commands import FILES, TEMPLATES, check_name, write_project
from taichisoft.running.plugins import Registry


def test_new_project_is_plugin_at_once(tmp_path: Path, taichisoft_plugins: Registry) -> None:
    folder = write_project("soft-touch", tmp_path)  # which is there, and empty
    plugins.load_plugin(folder / "soft_touch.py")
    controller = hooks.find("controller", "soft-touch")(force=30.0)
    assert (controller.force, controller.rate) == (30.0, 50.0)


def test_controller_of_new_project_closes_gripper(
    tmp_path: Path, taichisoft_plugins: Registry, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    """Until the fingers press with 20 mN and then for some steps more, at the pressure that this took."""
    plugin = write_project("soft-touch", tmp_path / "project") / "soft_touch.py"
    settings = ["--controller", "soft-touch", "--set", "controller.settings.force=20", "--duration", "0.5"]
    scene = ["run", "gripper", "--outputs", "csv", "--output", "out", "--plugin", str(plugin)]
    monkeypatch.chdir(tmp_path)
    _, shown, _ = command(*scene, *settings)
    closed_after = re.search(r"closed after *│ (\S+) s", shown)
    assert closed_after, shown
    with (tmp_path / "out" / "run.csv").open(encoding="utf-8", newline="") as file:
        rows = [{name: float(value or 0.0) for name, value in row.items()} for row in csv.DictReader(file)]
    pressures = [row["pressure finger1.cavity [kPa]"] for row in rows]
    forces = [sum(row[f"normal_force finger{number}|cube [mN]"] for number in (1, 2, 3)) for row in rows]
    closed = round(float(closed_after[1]) / 0.01)
    assert len(rows) == 50
    assert 10 < closed < 45
    assert max(forces[: closed - 1]) < 20.0 <= forces[closed - 1]
    assert len(set(pressures[closed:])) == 1
    assert pressures[-1] == pytest.approx(50.0 * (closed - 1) * 0.01)


def test_written_files_agree(tmp_path: Path) -> None:
    folder = write_project("Soft.Touch", tmp_path / "new" / "folder")
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {"README.md", "pyproject.toml", "soft_touch.py", "tests/test_soft_touch.py"}
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    assert project["project"]["name"] == "Soft.Touch"
    assert project["project"]["entry-points"]["taichisoft"] == {"Soft.Touch": "soft_touch"}
    assert "--controller Soft.Touch" in (folder / "README.md").read_text()


def test_every_template_is_used() -> None:
    assert {path.name for path in TEMPLATES.iterdir()} == set(FILES)


def test_filled_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for folder in (tmp_path, tmp_path / "notes.txt"):
        with pytest.raises(PluginError, match=rf"^{folder}: exists already; choose another name$"):
            write_project("soft-touch", folder)
    with pytest.raises(PluginError, match=r"notes.txt/x/pyproject.toml: cannot be written: Not a directory$"):
        write_project("soft-touch", tmp_path / "notes.txt" / "x")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("", r"^'' cannot be the name of a plug-in: it must begin with a letter, end with a letter or a digit, and"),
        ("-x", "must begin with a letter"),
        ("3d", "must begin with a letter"),
        ("a/b", "have only letters"),
        ("a b", "have only letters"),
        ("touch-", "end with a letter or a digit"),
        ("tïp", "have only letters"),
        ("touch\n", "have only letters"),
        ("class", "Python has a 'class' already$"),
        ("JSON", "Python has a 'json' already$"),
        ("numpy", "Python has a 'numpy' already$"),
        ("taichisoft-meshing", "Python has a 'taichisoft_meshing' already$"),
        ("meshing", r"^a plug-in is called 'meshing' already: taichisoft .*: taichisoft_meshing; choose another name$"),
        ("scripted", r"^a controller is called 'scripted' already; choose another name$"),
    ],
)
def test_wrong_name_is_refused(tmp_path: Path, name: str, problem: str) -> None:
    with pytest.raises(PluginError, match=problem):
        write_project(name, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@examples(50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.from_regex(r"[A-Za-z][A-Za-z0-9._-]{0,20}[A-Za-z0-9]", fullmatch=True))
def test_accepted_names_give_importable_modules(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    try:
        module = check_name(name)
    except PluginError:
        return
    assert module.isidentifier()
    folder = write_project(name, tmp_path_factory.mktemp("project"))
    entry_points = tomllib.loads((folder / "pyproject.toml").read_text())["project"]["entry-points"]["taichisoft"]
    assert entry_points == {name: module}
    spec = importlib.util.spec_from_file_location(module, folder / f"{module}.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    assert list(made.taichisoft_controllers()) == [name]
