"""What may import what: every arrow points down the layers, and the engine knows nothing of plug-ins or screens.

Imports for type checking alone count as well: a reader follows them just the same.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ENGINE = ROOT / "taichisoft"
FORBIDDEN = {
    "taichisoft_controllers",
    "taichisoft_gym",
    "taichisoft_meshing",
    "taichisoft_plugins",
    "taichisoft_sofa",
    "taichisoft_studies",
} | {
    "open3d",
    "gmsh",
    "viser",
    "matplotlib",
    "h5py",
}
# From top to bottom: folders and modules of a package; a module may import those of its own layer and of lower ones.
LAYERS = {
    "taichisoft": [
        "__main__",
        "command_line",
        "pytest_fixtures",
        "__init__",
        "running",
        "building",
        "plugin_system",
        "session",
        "simulation",
        "step",
        "solver",
        "control",
        "model",
        "contact",
        "bodies",
        "scenes",
        "meshes",
        "cholesky",
        "state",
        "checksum",
        "atomic_file",
        "child_process",
        "interruption",
        "runtime",
        "cache_folder",
        "terminal_text",
        "input_file",
        "errors",
    ],
    "taichisoft_benchmarks": [
        "__init__",
        "faults",
        "command",
        "page",
        "studies",
        "comparison",
        "plots",
        "targets",
        "runner",
        "results",
        "case_process",
        "measures",
        "peers",
        "scenes",
        "cases",
        "machine",
        "errors",
    ],
    "taichisoft_controllers": [
        "__init__",
        "closed_loop",
        "keyboard",
        "scripted",
        "settings",
        "model_names",
        "drives",
    ],
    "taichisoft_gym": [
        "__init__",
        "vector",
        "carry",
        "grasp",
        "reach",
        "disturbances",
        "sensors",
        "environment",
        "places",
        "page",
        "prepared",
        "task",
        "pressures",
        "randomisation",
        "actuation",
        "channels",
    ],
    "taichisoft_plugins": [
        "__init__",
        "doctor",
        "materials",
        "report",
        "rendering",
        "web",
        "paraview",
        "plots",
        "csv_output",
        "hold_time",
        "metrics",
        "drawing",
        "stress",
        "domain_stress",
        "rubber_stress",
        "recording",
        "goals",
        "run_figures",
        "slipping",
        "base_motion",
        "system_libraries",
    ],
    "taichisoft_sofa": [
        "__init__",
        "command",
        "checking",
        "reader",
        "controller",
        "translation",
        "components",
        "regions",
        "meshes",
        "tree",
    ],
    "taichisoft_studies": [
        "__init__",
        "commands",
        "calibrate",
        "measured_data",
        "calibration_file",
        "winner_parts",
        "optimise",
        "objectives",
        "study_page",
        "analysis",
        "comparison",
        "mesh_summary",
        "mesh_plan",
        "value_texts",
        "sweep",
        "progress",
        "workers",
        "access",
        "worker_start",
        "worker_task",
        "run_child",
        "run_process",
        "make_mesh",
        "make_run",
        "pruning",
        "optimiser",
        "optimisation_file",
        "run_log",
        "run_folder",
        "curves_output",
        "observed",
        "run_job",
        "unfinished",
        "results",
        "expressions",
        "keys",
        "sampling",
        "study_file",
        "extras",
    ],
    "taichisoft_meshing": [
        "__init__",
        "commands",
        "mesh_set",
        "mesh_record",
        "scene_meshes",
        "mesh_cache",
        "mesh_process",
        "mesh_job",
        "fingerprint",
        "tendon_finger",
        "finger",
        "bodies",
        "size_search",
        "geometry_file",
        "curved_sides",
        "quality",
        "gmsh_session",
    ],
}
PACKAGES = [
    ENGINE,
    *(ROOT / folder / f"taichisoft_{folder}" for folder in ("benchmarks", "controllers", "meshing", "plugins")),
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


def test_a_file_of_kernels_has_a_name_of_its_own():
    names = Counter(path.stem for path in ENGINE.rglob("*.py"))
    kernels = [path.stem for path in ENGINE.rglob("*.py") if path.parent.name in ("runtime", "kernels")]
    assert [name for name in kernels if name != "__init__" and names[name] > 1] == []
