"""Commands that list something answer at once: they import little, and what plug-ins provide only when it is used."""

import io
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import PATIENCE
from rich.console import Console

from taichisoft.running import progress_bar, provided, run_command
from taichisoft.running.hooks import KINDS
from taichisoft.running.run_command import session_bar
from taichisoft.runtime import launch

SLOW = {"gmsh", "h5py", "matplotlib", "meshio", "numpy", "open3d", "scipy", "taichi", "trimesh", "viser"}
CODE = """
import contextlib, io, sys
from taichisoft.command_line import main

sys.argv = ["taichisoft", *sys.argv[1:]]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main()
print(*sys.modules)
"""


def imported_by(arguments: list[str], folder: Path) -> set[str]:
    command = [sys.executable, "-c", CODE, *arguments]
    done = subprocess.run(
        command, cwd=folder, env=dict(os.environ), capture_output=True, text=True, check=True, timeout=PATIENCE
    )
    return set(done.stdout.split())


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["plugins"], ["materials"]])
def test_command_that_lists_something_imports_nothing_slow(arguments: list[str], tmp_path: Path) -> None:
    modules = imported_by(arguments, tmp_path)
    assert "typer" in modules and modules & SLOW == set()
    assert "pydantic" not in modules or arguments != ["--help"]


@pytest.mark.parametrize("kind", KINDS)
def test_what_the_shipped_plugins_provide_can_be_imported(kind: str) -> None:
    found = provided(kind)
    for name in found:
        assert kind in ("run option", "material") or callable(found[name]), name


def test_bar_names_kernel_that_step_waits_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")  # a dumb terminal has no bar
    screen = io.StringIO()
    session: Any = SimpleNamespace(step_count=2)
    with session_bar(Console(file=screen, force_terminal=True, width=100), session, "a finger"):
        (show,) = launch.SHOWING
        show("factorise")
        assert "preparing factorise" in screen.getvalue(), "before the compilation, while which nothing is drawn"
    assert launch.SHOWING == []


def shown(screen: io.StringIO, text: str) -> bool:
    patience = time.monotonic() + PATIENCE
    while text not in screen.getvalue() and time.monotonic() < patience:
        time.sleep(0.01)
    return text in screen.getvalue()


def test_lines_replace_bar_without_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also while a step takes long; 2 of 5 made before, one now: the time left is twice what has passed."""
    monkeypatch.setattr(run_command, "SECONDS_BETWEEN_LINES", 0.01)
    screen, clock = io.StringIO(), [0.0]
    with progress_bar(Console(file=screen, width=200, get_time=lambda: clock[0]), "all", 5, "runs", begun=2) as count:
        clock[0] = 60.0
        assert shown(screen, "all: 2 of 5 runs, after 0:01:00\n")
        count("third: missed")
        assert shown(screen, "third: missed\nall: 3 of 5 runs, after 0:01:00, 0:02:00 left\n")
        count(completed=4, state="nearly")
        assert shown(screen, "all: 4 of 5 runs, nearly, after 0:01:00, 0:00:30 left\n")
    ended = screen.getvalue()
    time.sleep(0.05)
    assert screen.getvalue() == ended


@pytest.mark.parametrize(
    ("total", "unit", "text"),
    [(8.0, "%", "25 %, after 0:00:03, 0:00:09 left"), (None, "pictures", "2 pictures, after 0:00:03")],
)
def test_bar_tells_shares_and_open_counts(monkeypatch: pytest.MonkeyPatch, total: Any, unit: str, text: str) -> None:
    """A title is no markup."""
    monkeypatch.setenv("TERM", "xterm")
    screen, clock = io.StringIO(), [0.0]
    console = Console(file=screen, force_terminal=True, width=100, color_system=None, get_time=lambda: clock[0])
    with progress_bar(console, "[red]gif", total, unit) as count:
        clock[0] = 3.0
        count(state="beginning", refresh=True)
        assert "beginning, after 0:00:03" in screen.getvalue()
        assert "0 pictures" not in screen.getvalue()
        count(advance=2.0, state="", refresh=True)
    assert "[red]gif" in screen.getvalue() and text in screen.getvalue()
