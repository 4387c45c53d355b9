"""What `pip install` gives to somebody who never sees the checkout."""

import csv
import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import PATIENCE

import taichisoft

CHECKOUT = Path(__file__).resolve().parent.parent

FOLDERS = {
    "taichisoft": "taichisoft",
    "taichisoft_arm": "controllers/taichisoft_arm",
    "taichisoft_controllers": "controllers/taichisoft_controllers",
    "taichisoft_gym": "controllers/taichisoft_gym",
    "taichisoft_meshing": "meshing/taichisoft_meshing",
    "taichisoft_outputs": "plugins/taichisoft_outputs",
    "taichisoft_sofa": "plugins/taichisoft_sofa",
    "taichisoft_reduction": "plugins/taichisoft_reduction",
    "taichisoft_studies": "plugins/taichisoft_studies",
    "taichisoft/running/plugin_template": "taichisoft/running/plugin_template",
    "taichisoft/tiny_gripper": "taichisoft/tiny_gripper",
    "taichisoft/data/arms": "data/arms",
    "taichisoft/data/fingers": "data/fingers",
    "taichisoft/data/meshes": "data/meshes",
    "taichisoft/data/reduced": "data/reduced",
    "taichisoft/data/scenes": "data/scenes",
    "taichisoft/data/studies": "data/studies",
}
"""Folders of the checkout by the place where they are installed."""


def run(*command: str | Path, folder: Path) -> str:
    """Standard output of a command, with nothing in its surroundings that leads to the checkout."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    return build_wheel(CHECKOUT, folder)


def build_wheel(project: Path, folder: Path) -> Path:
    """Build the wheel of a project into a folder."""
    # In an isolated build pip fetches hatchling, for which it needs a network.
    isolation = ["--no-isolation"] if importlib.util.find_spec("hatchling") else []
    run(sys.executable, "-m", "build", "--wheel", *isolation, "--outdir", folder, project, folder=folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with the wheel in it, which borrows the dependencies of this one."""
    folder = tmp_path_factory.mktemp("environment").resolve()
    run(sys.executable, "-m", "venv", "--without-pip", folder, folder=folder)
    run(sys.executable, "-m", "pip", "--python", folder, "install", "--no-deps", wheel, folder=folder)
    # Folders reached through a .pth file have their own .pth files ignored: the editable install of the
    # checkout stays out of reach. This comes after pip, which would take that one for the wheel.
    (site_packages,) = folder.glob("lib/python*/site-packages")
    borrowed = [path for path in sys.path if Path(path).name.endswith("-packages")]
    (site_packages / "borrowed.pth").write_text("\n".join(borrowed))
    return folder


def test_wheel_holds_every_file_of_packages_and_of_data(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    for installed, folder in FOLDERS.items():
        files = [path for path in (CHECKOUT / folder).rglob("*") if path.is_file()]
        kept = [path.relative_to(CHECKOUT / folder) for path in files if path.parent.name != "__pycache__"]
        expected = {f"{installed}/{path}" for path in kept}
        assert expected, f"{folder} is empty"
        assert expected <= packed


def test_wheel_holds_licence_and_packages_alone(wheel: Path) -> None:
    packed = zipfile.ZipFile(wheel).namelist()
    metadata = f"taichisoft-{taichisoft.__version__}.dist-info"
    assert f"{metadata}/licenses/LICENSE" in packed
    packages = {folder for folder in FOLDERS if "/" not in folder}
    assert {name.split("/")[0] for name in packed} == {*packages, metadata}


def test_installed_packages_and_data_are_ones_of_wheel(environment: Path, tmp_path: Path) -> None:
    code = """
from taichisoft.running.plugins import plugin_registry
from taichisoft.scene.shipped import find_file

for name in ("controllers", "meshing", "outputs"):
    print(plugin_registry().get_plugin(name).__file__)
for name, kind in (("tutorial", "fingers"), ("gripper", "scenes")):
    print(find_file(name, kind, (".toml",)))
"""
    found = run(environment / "bin/python", "-c", code, folder=tmp_path).splitlines()
    assert len(found) == 5
    assert [path for path in found if not Path(path).is_relative_to(environment)] == []


@pytest.fixture(scope="module")
def project(environment: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A third party's plug-in: begun with the installed command, built, and installed beside taichisoft."""
    folder = tmp_path_factory.mktemp("third-party")
    run(environment / "bin/taichisoft", "plugins", "new", "soft-touch", folder=folder)
    wheel = build_wheel(folder / "soft-touch", tmp_path_factory.mktemp("third-party-wheel"))
    assert zipfile.ZipFile(wheel).namelist()[0] == "soft_touch.py"
    run(
        sys.executable, "-m", "pip", "--python", environment, "install", "--no-deps", "--no-index", wheel, folder=folder
    )
    return folder / "soft-touch"


def test_third_partys_plugin_is_listed(environment: Path, project: Path, tmp_path: Path) -> None:
    rows = run(environment / "bin/taichisoft", "plugins", folder=tmp_path).partition("soft-touch")[2]
    for shown in ("0.1.0", "distribution", "soft_touch", "controller soft-touch"):
        assert shown in rows


def test_third_partys_controller_drives_run(
    environment: Path, project: Path, falling_cube: Path, tmp_path: Path
) -> None:
    """What it does with the gripper tests/engine/test_new_plugin.py sees in a process that has its kernels."""
    settings = ["--controller", "soft-touch", "--set", "controller.settings.force=20", "--duration", "0.02"]
    scene = ["run", falling_cube, "--outputs", "csv", "--output", "out"]
    shown = run(environment / "bin/taichisoft", *scene, *settings, folder=tmp_path)
    assert re.search(r"closed after *│ never", shown), shown
    with (tmp_path / "out" / "run.csv").open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == 2


def test_installed_command_runs_and_draws_from_empty_folder(
    environment: Path, falling_cube: Path, tmp_path: Path
) -> None:
    """With all packages from the network, and the shipped gripper, it is `.ci/try-packages`."""
    with falling_cube.open("a", encoding="utf-8") as file:
        file.write('[controller]\nname = "scripted"\nsettings = { script = "rest" }\n')
    folder = tmp_path / "empty"
    folder.mkdir()
    run(environment / "bin/taichisoft", "run", falling_cube, "--duration", "0.02", "--image", folder=folder)
    assert {path.name for path in (folder / "out" / "cube").glob("*.png")} == {"before.png", "after.png"}


def test_third_partys_tests_pass_where_plugin_is_installed(environment: Path, project: Path) -> None:
    shown = run(environment / "bin/python", "-m", "pytest", "-p", "no:cacheprovider", folder=project)
    assert "2 passed" in shown


def test_pytest_imports_nothing_for_tests_that_need_nothing(environment: Path, project: Path, tmp_path: Path) -> None:
    (tmp_path / "test_nothing.py").write_text("def test_nothing(): pass")
    heavy = "{'numpy', 'pydantic', 'rich', 'scipy', 'soft_touch', 'taichi', 'typer'}"
    code = f"import sys, pytest; left = pytest.main(['-p', 'no:dash']); print(left, {heavy} & set(sys.modules))"
    shown = run(environment / "bin/python", "-c", code, folder=tmp_path)
    assert shown.splitlines()[-1] == "0 set()"
