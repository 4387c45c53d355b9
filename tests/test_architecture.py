"""What may import what: every arrow points down the layers, and the engine knows nothing of plug-ins or screens.

Imports for type checking alone count as well: a reader follows them just the same.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ENGINE = ROOT / "taichisoft"
FORBIDDEN = {
    "taichisoft_arm",
    "taichisoft_controllers",
    "taichisoft_gym",
    "taichisoft_meshing",
    "taichisoft_outputs",
    "taichisoft_reduction",
    "taichisoft_sofa",
    "taichisoft_studies",
} | {
    "open3d",
    "gmsh",
    "viser",
    "matplotlib",
    "h5py",
}
LAYERS = {
    "taichisoft": [
        "__main__",
        "command_line",
        "pytest_fixtures",
        "__init__",
        "running",
        "step",
        "control",
        "contact",
        "mechanics",
        "scene",
        "mesh",
        "runtime",
        "base",
        "errors",
    ],
    "taichisoft_outputs": [
        "__init__",
        "doctor_command",
        "doctor_checks",
        "materials_command",
        "tension_test",
        "material_files",
        "recording_commands",
        "report",
        "rendering",
        "web",
        "paraview",
        "plots",
        "csv_output",
        "metrics",
        "drawing",
        "stress",
        "recording",
        "run_figures",
        "html_template",
        "system_libraries",
    ],
    "taichisoft_sofa": [
        "__init__",
        "sofa_commands",
        "checking",
        "scene_reader",
        "controller",
        "translation",
        "components",
        "tree",
    ],
}
"""From top to bottom: rooms and modules; each may import those of its own layer and of lower ones. Of packages that are
flat, the modules alone must not lead back to themselves."""
PACKAGES = [
    ENGINE,
    *(ROOT / folder / f"taichisoft_{folder}" for folder in ("benchmarks", "controllers", "meshing")),
    ROOT / "plugins/taichisoft_outputs",
    ROOT / "plugins/taichisoft_reduction",
    ROOT / "controllers/taichisoft_arm",
    ROOT / "controllers/taichisoft_gym",
    ROOT / "plugins/taichisoft_sofa",
    ROOT / "plugins/taichisoft_studies",
]


def modules(package: Path) -> dict[str, Path]:
    """The modules of a package by their dotted names."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts)] = path
    return found


def imported_names(path: Path) -> Iterator[str]:
    """Everything that a file imports, wherever in it, as dotted names."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def arrows(package: Path) -> dict[str, set[str]]:
    """The modules of the package that each of its modules imports."""
    known = modules(package)
    found: dict[str, set[str]] = {}
    for name, path in known.items():
        found[name] = set()
        for imported in imported_names(path):
            for candidate in (imported, imported.rpartition(".")[0], f"{imported}.__init__"):
                if candidate in known and candidate != name:
                    found[name].add(candidate)
                    break
    return found


def layer(module: str, layers: list[str]) -> int:
    """How far down a module stands, from 0."""
    return layers.index(module.split(".")[1])


def upward(package: Path, layers: list[str]) -> list[str]:
    """The imports of a package that point up its layers."""
    return [
        f"{module} imports {imported}"
        for module, targets in arrows(package).items()
        for imported in sorted(targets)
        if layer(module, layers) > layer(imported, layers)
    ]


@pytest.mark.parametrize("name", LAYERS)
def test_every_import_points_down_the_layers(name):
    (package,) = (path for path in PACKAGES if path.name == name)
    assert not upward(package, LAYERS[name])


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_no_module_leads_back_to_itself(package):
    """Modules that import nothing more are taken away until none is left; what cannot be taken stands in a circle."""
    waiting = {name: set(targets) for name, targets in arrows(package).items()}
    while free := {name for name, targets in waiting.items() if not targets}:
        waiting = {name: targets - free for name, targets in waiting.items() if name not in free}
    assert not waiting


def test_an_arrow_that_points_up_is_seen(tmp_path):
    package = tmp_path / "taichisoft"
    for module, text in {
        "step/contacts": "def f():\n    from taichisoft.running.loop import run",
        "running/loop": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import taichisoft.step.contacts",
    }.items():
        (package / module).parent.mkdir(parents=True, exist_ok=True)
        (package / f"{module}.py").write_text(text)
    assert upward(package, ["running", "step"]) == ["taichisoft.step.contacts imports taichisoft.running.loop"]
    assert arrows(package)["taichisoft.running.loop"] == {"taichisoft.step.contacts"}


@pytest.mark.parametrize("path", sorted(ENGINE.rglob("*.py")), ids=lambda path: str(path.relative_to(ENGINE)))
def test_the_engine_imports_no_plugin_and_no_screen(path):
    assert not {name.split(".")[0] for name in imported_names(path)} & FORBIDDEN


@pytest.mark.parametrize("path", sorted(ENGINE.rglob("*.py")), ids=lambda path: str(path.relative_to(ENGINE)))
def test_taichi_stays_in_the_runtime_and_the_kernels(path):
    if path.parent.name not in ("runtime", "kernels"):
        assert "taichi" not in {name.split(".")[0] for name in imported_names(path)}


# Names of Taichi's that are not in its documentation, and modules of it.
PRIVATE_NAMES = {
    *("get_runtime", "prog", "_primal", "compiled_kernels", "ensure_compiled", "compile_kernel", "get_device_caps"),
    *("launch_kernel", "make_launch_context", "set_arg_int", "set_arg_float", "set_arg_external_array_with_shape"),
}


def private_parts(path: Path) -> set[str]:
    """What a file uses of Taichi's private interface."""
    imported = {name for name in imported_names(path) if name.startswith(("taichi.lang", "taichi._"))}
    nodes = [one for one in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(one, ast.Attribute)]
    of_taichi = {node.attr for node in nodes if isinstance(node.value, ast.Name) and node.value.id in ("ti", "taichi")}
    hidden = {name for name in of_taichi if name == "lang" or name.startswith("_")}
    return imported | hidden | ({node.attr for node in nodes} & PRIVATE_NAMES)


def test_taichis_private_interface_is_used_in_one_file():
    folders = [*PACKAGES, ROOT / "tests", ROOT / "docs", ROOT / "examples"]
    users = {path for folder in folders for path in folder.rglob("*.py") if private_parts(path)}
    assert users == {ENGINE / "runtime/compiler.py"}


def test_a_class_has_a_name_of_its_own():
    """`Cable` is either what a user writes or what is simulated, whichever package it stands in."""
    files = [path for package in PACKAGES for path in package.rglob("*.py")]
    names = Counter(
        node.name
        for path in files
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    )
    assert len(names) > 300
    assert [name for name, count in names.items() if count > 1] == []


# Files that hold the same thing in every package.
COMMON_FILES = ("__init__.py", "__main__.py", "errors.py")


def test_a_file_has_a_name_of_its_own():
    names = Counter(path.name for package in PACKAGES for path in package.rglob("*.py"))
    assert len(names) > 300
    assert [name for name, count in names.items() if count > 1 and name not in COMMON_FILES] == []


BESIDE = [ROOT / folder for folder in ("benchmarks", "controllers", "meshing", "plugins", "examples")]
"""Packages that import the engine's public modules: `taichisoft.mesh`, not `taichisoft.mesh.mesh_files`."""


def inner_imports(path: Path) -> list[str]:
    """Imports of modules inside a package of the engine."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) and node.level == 0 else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        found += [name for name in names if name.startswith("taichisoft.") and name.count(".") > 1]
    return found


def test_packages_beside_the_engine_import_its_public_modules_alone() -> None:
    files = [path for folder in BESIDE for path in sorted(folder.rglob("*.py"))]
    assert len(files) > 200
    assert {str(path.relative_to(ROOT)): inner for path in files if (inner := inner_imports(path))} == {}


@pytest.mark.parametrize("stub", sorted(ENGINE.glob("*/__init__.pyi")), ids=lambda stub: stub.parent.name)
def test_public_names_are_there_and_used(stub: Path) -> None:
    """A name with the name of a module would be the module as soon as that is imported."""
    package = import_module(f"taichisoft.{stub.parent.name}")
    names = {
        alias.name
        for node in ast.walk(ast.parse(stub.read_text()))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert names == set(package.__all__)
    assert all(getattr(package, name) is not None for name in names)
    assert not names & {path.stem for path in stub.parent.iterdir()}
    everything = "".join(
        path.read_text(encoding="utf-8") for folder in [*BESIDE, ROOT / "docs"] for path in folder.rglob("*.*y")
    )
    assert [name for name in sorted(names) if not re.search(rf"\b{name}\b", everything)] == []
