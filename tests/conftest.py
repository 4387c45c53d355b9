"""What tests share: meshes made in code, plug-ins, reference data beside the project, figures for docs/validation.md.

There is no second conftest.py: tests import from this one by its name.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from itertools import permutations
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.volume_mesh import VolumeMesh, boundary_triangles
from taichisoft.plugin_system import plugins
from taichisoft.plugin_system.hookspecs import PROJECT, hookimpl

SHARED = Path(__file__).resolve().parents[1].parent / "shared"

THOROUGH = 5000
settings.register_profile("usual", settings(), deadline=None)  # no property depends on speed
settings.register_profile("thorough", settings(), deadline=None, max_examples=THOROUGH)
settings.load_profile("usual")


def examples(count: int, **others: Any) -> settings:
    """Try `count` examples instead of 100; `pytest --hypothesis-profile=thorough` tries its 5000 here, too."""
    return settings(max_examples=THOROUGH if settings().max_examples == THOROUGH else count, **others)


def make_block(cells: tuple[int, int, int], size: tuple[float, float, float], hollow: bool = False) -> VolumeMesh:
    """A box about the origin of `cells` boxes, each cut into six tetrahedra; `hollow` leaves out the inner boxes.

    The walls of the hollow are the surface group "cavity", facing from the air into the material.
    """
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    if hollow:
        corner = corner[((corner == 0) | (corner == np.array(cells) - 1)).any(axis=1)]
    paths = []  # of each tetrahedron along three edges from the lowest to the highest corner of a box
    for order in permutations(range(3)):
        steps = np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        even = np.linalg.det(np.eye(3)[list(order)]) > 0
        paths.append(steps if even else steps[[0, 2, 1, 3]])
    elements = ((corner[:, None, None, :] + np.array(paths)) @ strides).reshape(-1, 4)
    used, elements = np.unique(elements, return_inverse=True)
    elements = elements.reshape(-1, 4)
    nodes = (grid[used] / cells - 0.5) * size
    groups = {}
    if hollow:
        walls = boundary_triangles(elements)
        inner = (np.abs(nodes[walls]) < 0.5 * np.array(size) * (1 - 1e-9)).all(axis=(1, 2))
        groups["cavity"] = walls[inner][:, ::-1]
    return VolumeMesh("block", nodes, elements, groups).check()


@pytest.fixture
def block(tmp_path: Path) -> Callable[..., str]:
    """Writes a mesh of `make_block` and returns its file."""

    def write(cells: tuple[int, int, int], size: tuple[float, float, float], hollow: bool = False) -> str:
        path = tmp_path / f"block-{'x'.join(map(str, cells))}-{'x'.join(map(str, size))}{'-hollow' * hollow}.msh"
        write_volume_mesh(make_block(cells, size, hollow), path)
        return str(path)

    return write


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Makes a plug-in of the functions given, under a name, beside those installed before it in the test.

    No other plug-in is there, the built-in ones included; those that are loaded in the test are gone after it.
    """
    found: list[EntryPoint] = []

    def add(name: str, module: str | None = None, **functions: Any) -> None:
        made = ModuleType(module or f"plugin_{name}")
        for hook, function in functions.items():
            setattr(made, hook, hookimpl(function))
        monkeypatch.setitem(sys.modules, made.__name__, made)
        found.append(EntryPoint(name, made.__name__, PROJECT))
        plugins._loaded = None

    monkeypatch.setattr(plugins, "entry_points", lambda group: found)
    with plugins.separate_registry():
        yield add


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of SOFA's reference runs and the tutorial's meshes."""
    if not (SHARED / "reference").is_dir():
        pytest.skip("needs ../shared/reference, which is not part of the project")
    return SHARED


class Figures:
    """Checks a measured figure against its bound and keeps it for `pytest --figures`."""

    def __init__(self, keep: Callable[[str, object], None]):
        self._keep = keep

    def at_most(self, what: str, value: float, bound: float) -> None:
        """Assert value <= bound; NaN fails."""
        self._keep("figure", f"{what} | {value:.3g} | <= {bound:.3g}")
        assert value <= bound, f"{what}: {value:.6g} exceeds {bound:.6g}"

    def close(self, what: str, ours: float, reference: float, tolerance: float) -> None:
        """Assert |ours - reference| <= tolerance; NaN fails."""
        difference = abs(ours - reference)
        self._keep("figure", f"{what} | {ours:.6g} | {reference:.6g} | {difference:.2g} | <= {tolerance:.2g}")
        assert difference <= tolerance, f"{what}: {ours:.9g} against {reference:.9g} differs by more than {tolerance:g}"


@pytest.fixture
def figures(record_property: Callable[[str, object], None]) -> Figures:
    """Where a test puts what it measured."""
    return Figures(record_property)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--figures", action="store_true", help="print what the validation tests measured")


def pytest_configure() -> None:
    # A script starts its background jobs with SIGINT ignored, nohup does with SIGHUP, and what tests start would
    # inherit it. A signal with a handler begins as usual in a child.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)
    if workers := os.environ.get("PYTEST_XDIST_WORKER_COUNT"):  # they share the cores
        os.environ.setdefault("TAICHISOFT_THREADS", str(max(1, (os.cpu_count() or 1) // int(workers))))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if config.getoption("--figures"):
        terminalreporter.section("measured figures")
        for report in terminalreporter.getreports("passed") + terminalreporter.getreports("failed"):
            for name, figure in report.user_properties:
                if name == "figure":
                    terminalreporter.write_line(f"{report.nodeid.rpartition('::')[2]} | {figure}")
