"""What may import what: the engine knows nothing of the other packages, of files of results or of screens."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ENGINE = Path(__file__).resolve().parents[1] / "taichisoft"
FORBIDDEN = {"taichisoft_controllers", "taichisoft_meshing", "taichisoft_plugins"} | {
    "open3d",
    "gmsh",
    "viser",
    "matplotlib",
    "h5py",
}


def imported_packages(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("path", sorted(ENGINE.rglob("*.py")), ids=lambda path: str(path.relative_to(ENGINE)))
def test_the_engine_imports_no_plugin_and_no_screen(path):
    assert not imported_packages(path) & FORBIDDEN


@pytest.mark.parametrize("path", sorted(ENGINE.rglob("*.py")), ids=lambda path: str(path.relative_to(ENGINE)))
def test_taichi_stays_in_the_kernels(path):
    if path.parent.name != "kernels":
        assert "taichi" not in imported_packages(path)


def test_help_waits_for_no_heavy_package():
    code = (
        "import sys, taichisoft, taichisoft.command_line, taichisoft.plugins as plugins\n"
        "plugins.plugin_registry().hook.taichisoft_commands(application=taichisoft.command_line.application)\n"
        "print(sorted({'taichi', 'open3d', 'gmsh', 'h5py', 'meshio', 'matplotlib', 'trimesh'} & set(sys.modules)))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
