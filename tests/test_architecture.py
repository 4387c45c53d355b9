"""What may import what: every arrow points down the layers, and the engine knows nothing of plug-ins or screens.

Imports for type checking alone count as well: a reader follows them just the same.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ENGINE = ROOT / "taichisoft"
LAYERS = {
    name: rooms.split()
    for name, rooms in {
        "taichisoft": (
            "__main__ command_line pytest_fixtures __init__ running step control contact mechanics scene mesh runtime "
            "base errors"
        ),
        "taichisoft_outputs": (
            "__init__ doctor_command doctor_checks materials_command tension_test material_files measured_table "
            "recording_commands report rendering web paraview plots csv_output metrics drawing stress recording "
            "run_figures html_template system_libraries"
        ),
        "taichisoft_sofa": "__init__ sofa_commands scene_reader controller translation loading components tree",
    }.items()
}
"""From top to bottom: rooms and modules; each may import those of its own layer and of lower ones. Of packages that are
flat, the modules alone must not lead back to themselves."""
PACKAGES = [
    ENGINE,
    *(ROOT / folder / f"taichisoft_{folder}" for folder in ("benchmarks", "controllers", "meshing")),
    *(ROOT / "controllers" / f"taichisoft_{name}" for name in ("arm", "gym")),
    *(ROOT / "plugins" / f"taichisoft_{name}" for name in ("outputs", "reduction", "sofa", "studies")),
]
BESIDE = [ROOT / folder for folder in ("benchmarks", "controllers", "meshing", "plugins", "examples")]
"""Packages that import the engine's public modules: `taichisoft.mesh`, not `taichisoft.mesh.mesh_files`."""
FORBIDDEN = {path.name for path in PACKAGES[2:]} | {"open3d", "gmsh", "viser", "matplotlib", "h5py"}
"""What the engine must not import."""


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def files(*folders: Path) -> list[Path]:
    return [path for folder in folders for path in sorted(folder.rglob("*.py"))]


def imported_names(path: Path) -> Iterator[str]:
    """Everything that a file imports, wherever in it, as dotted names."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def arrows(package: Path) -> dict[str, set[str]]:
    """The modules of the package that each of its modules imports, all by their dotted names."""
    modules = {".".join(path.relative_to(package.parent).with_suffix("").parts): path for path in files(package)}
    targets: dict[str, set[str]] = {name: set() for name in modules}
    for name, path in modules.items():
        for imported in imported_names(path):
            for candidate in (imported, imported.rpartition(".")[0], f"{imported}.__init__"):
                if candidate in modules and candidate != name:
                    targets[name].add(candidate)
                    break
    return targets


def upward(package: Path, layers: list[str]) -> list[str]:
    """The imports of a package that point up its layers."""
    depth = {name: layers.index(name.split(".")[1]) for name in arrows(package)}
    return [
        f"{module} imports {imported}"
        for module, targets in arrows(package).items()
        for imported in sorted(targets)
        if depth[module] > depth[imported]
    ]


@pytest.mark.parametrize("name", LAYERS)
def test_every_import_points_down_the_layers(name):
    (package,) = (path for path in PACKAGES if path.name == name)
    assert not upward(package, LAYERS[name])


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_no_module_leads_back_to_itself(package):
    """Modules that import nothing more are taken away until none is left; what cannot be taken stands in a circle."""
    waiting = arrows(package)
    while free := {name for name, targets in waiting.items() if not targets}:
        waiting = {name: targets - free for name, targets in waiting.items() if name not in free}
    assert not waiting


def test_arrow_that_points_up_is_seen(tmp_path):
    package = tmp_path / "taichisoft"
    for module, text in {
        "step/contacts": "def f():\n    from taichisoft.running.loop import run",
        "running/loop": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import taichisoft.step.contacts",
    }.items():
        (package / module).parent.mkdir(parents=True, exist_ok=True)
        (package / f"{module}.py").write_text(text)
    assert upward(package, ["running", "step"]) == ["taichisoft.step.contacts imports taichisoft.running.loop"]
    assert arrows(package)["taichisoft.running.loop"] == {"taichisoft.step.contacts"}


def test_engine_imports_neither_plugins_nor_screens():
    imported = {path: {name.split(".")[0] for name in imported_names(path)} for path in files(ENGINE)}
    assert {path: names & FORBIDDEN for path, names in imported.items() if names & FORBIDDEN} == {}
    users_of_taichi = [path for path, names in imported.items() if "taichi" in names]
    assert {path.parent.name for path in users_of_taichi} <= {"runtime", "kernels"}


# Names of Taichi's that are not in its documentation, and modules of it.
PRIVATE_NAMES = {
    *("get_runtime", "prog", "_primal", "compiled_kernels", "ensure_compiled", "compile_kernel", "get_device_caps"),
    *("launch_kernel", "make_launch_context", "set_arg_int", "set_arg_float", "set_arg_external_array_with_shape"),
}


def private_parts(path: Path) -> set[str]:
    """What a file uses of Taichi's private interface."""
    imported = {name for name in imported_names(path) if name.startswith(("taichi.lang", "taichi._"))}
    attributes = [node for node in nodes(path) if isinstance(node, ast.Attribute)]
    of_taichi = {
        node.attr for node in attributes if isinstance(node.value, ast.Name) and node.value.id in ("ti", "taichi")
    }
    hidden = {name for name in of_taichi if name == "lang" or name.startswith("_")}
    return imported | hidden | ({node.attr for node in attributes} & PRIVATE_NAMES)


def test_private_interface_of_taichi_is_used_in_one_file():
    users = {path for path in files(*PACKAGES, *(ROOT / name for name in ("tests", "docs", "examples")))}
    assert {path for path in users if private_parts(path)} == {ENGINE / "runtime/compiler.py"}


# Files that hold the same thing in every package.
COMMON_FILES = ("__init__.py", "__main__.py", "errors.py")


def test_classes_and_files_have_names_of_their_own():
    """`Cable` is either what a user writes or what is simulated, whichever package it stands in."""
    paths = files(*PACKAGES)
    classes = Counter(node.name for path in paths for node in nodes(path) if isinstance(node, ast.ClassDef))
    names = Counter(path.name for path in paths if path.name not in COMMON_FILES)
    assert min(len(classes), len(names)) > 200
    assert [name for name, count in (classes + names).items() if count > 1] == []


SMALL_TOPICS = {
    "taichisoft_controllers.terminal_mode": "a program that restores the terminal of a killed process",
    "taichisoft_sofa.controller.sofa_controller": "the controller that a run is given",
    "taichisoft_studies.run_comparison": "`study compare`, beside the command that reads its options",
}
"""Modules below 150 lines with one importer, and why they do not live in it."""


def test_small_modules_live_in_their_only_importer():
    """But for kernels, modules that give public names, and light modules of commands, which `__init__` imports."""
    importers: dict[str, set[str]] = {}
    lengths = {}
    paths = files(*PACKAGES)
    for path in paths:
        package = next(folder for folder in PACKAGES if path.is_relative_to(folder))
        name = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        lengths[name] = path.read_text(encoding="utf-8").count("\n")
        for imported in imported_names(path):
            for candidate in {imported, imported.rpartition(".")[0]}:
                importers.setdefault(candidate, set()).add(path.stem)
    public = "".join(stub.read_text(encoding="utf-8") for stub in ENGINE.glob("*/__init__.pyi"))
    small = [
        name
        for name, length in lengths.items()
        if length < 150 and len(importers.get(name, ())) == 1 and importers[name] != {"__init__"}
        if ".kernels." not in name and f"from .{name.rpartition('.')[2]} import" not in public
    ]
    assert sorted(small) == sorted(SMALL_TOPICS)


def test_packages_beside_engine_import_its_public_modules():
    inner = {}
    for path in files(*BESIDE):
        modules = [node.module or "" for node in nodes(path) if isinstance(node, ast.ImportFrom) and node.level == 0]
        modules += [alias.name for node in nodes(path) if isinstance(node, ast.Import) for alias in node.names]
        inner[path] = [name for name in modules if name.startswith("taichisoft.") and name.count(".") > 1]
    assert len(inner) > 150
    assert {path: names for path, names in inner.items() if names} == {}


@pytest.mark.parametrize("stub", sorted(ENGINE.glob("*/__init__.pyi")), ids=lambda stub: stub.parent.name)
def test_public_names_are_there_and_used(stub: Path) -> None:
    """A name with the name of a module would be the module as soon as that is imported."""
    package = import_module(f"taichisoft.{stub.parent.name}")
    names = {alias.name for node in nodes(stub) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert names == set(package.__all__)
    assert all(getattr(package, name) is not None for name in names)
    assert not names & {path.stem for path in stub.parent.iterdir()}
    texts = [path.read_text(encoding="utf-8") for folder in [*BESIDE, ROOT / "docs"] for path in folder.rglob("*.*y")]
    everything = "".join(texts)
    assert [name for name in sorted(names) if not re.search(rf"\b{name}\b", everything)] == []
