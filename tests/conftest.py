"""What tests share: meshes in files, plug-ins, reference data beside the project, figures for docs/validation.md.

There is no second conftest.py: tests import from this one by its name.
"""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from blocks import make_block
from hypothesis import settings

from taichisoft import hookimpl, write_volume_mesh
from taichisoft.base.text import warn_caller_once
from taichisoft.running import plugins
from taichisoft.running.hookspecs import PROJECT

SHARED = Path(__file__).resolve().parents[1].parent / "shared"

PATIENCE = 1200.0
"""What a test waits for may take so long [s] on a busy machine; usually it is there at once."""

THOROUGH = 5000
settings.register_profile("usual", settings(), deadline=None)  # no property depends on speed
settings.register_profile("thorough", settings(), deadline=None, max_examples=THOROUGH)
settings.load_profile("usual")


def examples(count: int, **others: Any) -> settings:
    """Try `count` examples instead of 100; `pytest --hypothesis-profile=thorough` tries its 5000 here, too."""
    return settings(max_examples=THOROUGH if settings().max_examples == THOROUGH else count, **others)


@pytest.fixture(autouse=True)
def _wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are cut to the terminal: no test depends on how wide that is, nor on the length of the paths in them."""
    monkeypatch.setenv("COLUMNS", "1000")


@pytest.fixture(autouse=True)
def _warned_afresh() -> None:
    """What is warned of once in a process is warned of in each test that shows it."""
    warn_caller_once.cache_clear()


Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Command:
    """Runs `taichisoft` with some arguments in this process; returns its exit code, output and errors."""

    def run(*arguments: object) -> tuple[int, str, str]:
        from taichisoft.command_line import main

        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["taichisoft", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0), *capfd.readouterr()

    return run


@pytest.fixture
def block(tmp_path: Path) -> Callable[..., str]:
    """Writes a mesh of `make_block` and returns its file."""

    def write(cells: tuple[int, int, int], size: tuple[float, float, float], hollow: bool = False) -> str:
        path = tmp_path / f"block-{'x'.join(map(str, cells))}-{'x'.join(map(str, size))}{'-hollow' * hollow}.msh"
        write_volume_mesh(make_block(cells, size, hollow), path)
        return str(path)

    return write


@pytest.fixture
def falling_cube(tmp_path: Path) -> Path:
    """A scene of one rigid cube: a process that runs it needs few kernels and starts fast."""
    path = tmp_path / "cube.toml"
    path.write_text("[rigid_bodies.cube]\nbox = [10.0, 10.0, 10.0]\nmass = 0.001\n")
    return path


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


@pytest.fixture
def sofa() -> Iterator[None]:
    """The plug-in that reads SOFA's scenes, also where the installed distribution is older than it."""
    with plugins.separate_registry() as registry:
        if "sofa" not in registry.origins:
            plugins.register_plugin(import_module("taichisoft_sofa"), "sofa")
        yield


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
