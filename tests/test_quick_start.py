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
from rich.progress import Progress

from taichisoft.running import lines_without_terminal, provided, run_command
from taichisoft.running.hooks import KINDS
from taichisoft.running.run_command import progress_bar
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
    with progress_bar(Console(file=screen, force_terminal=True, width=100), session, "a finger"):
        (show,) = launch.SHOWING
        show("factorise")
        assert "preparing factorise" in screen.getvalue(), "before the compilation, while which nothing is drawn"
    assert launch.SHOWING == []


def test_lines_replace_bar_without_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also while a step takes long; 2 of 5 made before, one now: the time left is twice what has passed."""
    monkeypatch.setattr(run_command, "SECONDS_BETWEEN_LINES", 0.01)
    screen = io.StringIO()
    with Progress(console=Console(file=screen), disable=True) as progress, lines_without_terminal(progress):
        task = progress.add_task("runs", total=5, completed=2, begun=2)
        progress.tasks[0].start_time = progress.get_time() - 60.0
        patience = time.monotonic() + PATIENCE
        while "runs: 2 of 5, after 0:01:00\n" not in screen.getvalue() and time.monotonic() < patience:
            time.sleep(0.01)
        progress.advance(task)
        while "runs: 3 of 5, after 0:01:00, 0:02:00 left\n" not in screen.getvalue() and time.monotonic() < patience:
            time.sleep(0.01)
    assert time.monotonic() < patience
    ended = screen.getvalue()
    time.sleep(0.05)
    assert screen.getvalue() == ended
