"""What `pip install` gives to somebody who never sees the checkout."""

import importlib.util
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

import taichisoft

CHECKOUT = Path(__file__).resolve().parent.parent

FOLDERS = {
    "taichisoft": "taichisoft",
    "taichisoft_benchmarks": "benchmarks/taichisoft_benchmarks",
    "taichisoft_controllers": "controllers/taichisoft_controllers",
    "taichisoft_meshing": "meshing/taichisoft_meshing",
    "taichisoft_plugins": "plugins/taichisoft_plugins",
    "taichisoft/data/fingers": "data/fingers",
    "taichisoft/data/meshes": "data/meshes",
    "taichisoft/data/scenes": "data/scenes",
}
"""Folders of the checkout by the place where they are installed."""


def run(*command: str | Path, folder: Path) -> str:
    """Standard output of a command, with nothing in its surroundings that leads to the checkout."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    # In an isolated build pip fetches hatchling, for which it needs a network.
    isolation = ["--no-isolation"] if importlib.util.find_spec("hatchling") else []
    run(sys.executable, "-m", "build", "--wheel", *isolation, "--outdir", folder, CHECKOUT, folder=folder)
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
    borrowed = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site_packages / "borrowed.pth").write_text("\n".join(borrowed))
    return folder


def test_the_wheel_holds_every_file_of_the_packages_and_of_the_data(wheel: Path) -> None:
    packed = set(zipfile.ZipFile(wheel).namelist())
    for installed, folder in FOLDERS.items():
        files = [path for path in (CHECKOUT / folder).rglob("*") if path.is_file()]
        kept = [path.relative_to(CHECKOUT / folder) for path in files if path.parent.name != "__pycache__"]
        expected = {f"{installed}/{path}" for path in kept}
        assert expected, f"{folder} is empty"
        assert expected <= packed


def test_the_wheel_holds_the_license_and_nothing_that_belongs_to_the_checkout(wheel: Path) -> None:
    packed = zipfile.ZipFile(wheel).namelist()
    metadata = f"taichisoft-{taichisoft.__version__}.dist-info"
    assert f"{metadata}/licenses/LICENSE" in packed
    packages = {folder for folder in FOLDERS if "/" not in folder}
    assert {name.split("/")[0] for name in packed} == {*packages, metadata}


def test_the_installed_command_tells_its_version(environment: Path, tmp_path: Path) -> None:
    assert run(environment / "bin/taichisoft", "--version", folder=tmp_path) == (
        f"taichisoft {taichisoft.__version__}\n"
    )


def test_the_installed_packages_and_data_are_the_ones_of_the_wheel(environment: Path, tmp_path: Path) -> None:
    code = """
from taichisoft.plugins import plugin_registry
from taichisoft.shipped import find_file

for name in ("controllers", "meshing", "outputs"):
    print(plugin_registry().get_plugin(name).__file__)
for name, kind in (("tutorial", "fingers"), ("gripper", "scenes")):
    print(find_file(name, kind, (".toml",)))
"""
    found = run(environment / "bin/python", "-c", code, folder=tmp_path).splitlines()
    assert len(found) == 5
    assert [path for path in found if not Path(path).is_relative_to(environment)] == []
