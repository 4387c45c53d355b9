"""Many processes compute the same bits, forked or started anew."""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import joblib
import pytest
from conftest import PATIENCE

import taichisoft
from taichisoft.base import run_python

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")


def fall(scene: str, speed: float) -> tuple[bytes, int]:
    """Where a thrown cube is after ten steps, and the number of threads that computed it."""
    from taichisoft.runtime.language import THREADS

    simulation = taichisoft.Simulation(
        taichisoft.load_scene(scene, [f"rigid_bodies.cube.velocity=[{speed}, 0.0, 0.0]"])
    )
    for _ in range(10):
        simulation.step()
    return simulation.state.rigid_position.tobytes(), THREADS


def by_fork_server(tasks: Iterable[tuple[str, float]]) -> list[Any]:
    with multiprocessing.get_context("forkserver").Pool(1) as pool:
        return pool.starmap(fall, tasks)


def by_executor(tasks: Iterable[tuple[str, float]]) -> list[Any]:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as executor:
        return list(executor.map(fall, *zip(*tasks, strict=True)))


def by_joblib(tasks: Iterable[tuple[str, float]]) -> list[Any]:
    return list(joblib.Parallel(n_jobs=2)(joblib.delayed(fall)(*task) for task in tasks))


WAYS: dict[str, Callable[[Iterable[tuple[str, float]]], list[Any]]] = {
    "concurrent.futures, spawn": by_executor,
    "joblib": by_joblib,
}
if "forkserver" in multiprocessing.get_all_start_methods():
    WAYS["multiprocessing, forkserver"] = by_fork_server


@pytest.mark.parametrize("way", WAYS)
def test_started_processes_compute_the_same_bits(way: str, falling_cube: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = [(str(falling_cube), 10.0), (str(falling_cube), 20.0)]
    expected = [fall(*task)[0] for task in tasks]
    monkeypatch.delenv("TAICHISOFT_THREADS", raising=False)
    assert WAYS[way](tasks) == [(position, 1) for position in expected]


@needs_fork
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # Python 3.12 warns of any fork beside threads
def test_forked_process_computes_the_same_bits(falling_cube: Path) -> None:
    expected = fall(str(falling_cube), 10.0)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(fall, (str(falling_cube), 10.0)).get(timeout=PATIENCE) == expected
    assert fall(str(falling_cube), 10.0) == expected  # the process itself goes on


@needs_fork
def test_fork_before_the_first_simulation_works(falling_cube: Path, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import multiprocessing, taichisoft\n"
        "def positions(scene):\n"
        "    simulation = taichisoft.Simulation(scene)\n"
        "    simulation.step()\n"
        "    return simulation.state.rigid_position\n"
        f"scene = taichisoft.load_scene({str(falling_cube)!r})\n"
        "with multiprocessing.get_context('fork').Pool(1) as pool:\n"
        "    forked = pool.apply(positions, (scene,))\n"
        "assert (forked == positions(scene)).all()\n"
    )
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@needs_fork
def test_idle_forked_process_ends(falling_cube: Path, tmp_path: Path) -> None:
    """Python 3.12 warns of any fork beside threads."""
    program = tmp_path / "program.py"
    program.write_text(
        "import os, sys, taichisoft\n"
        f"simulation = taichisoft.Simulation(taichisoft.load_scene({str(falling_cube)!r}))\n"
        "simulation.step()\n"
        "child = os.fork()\n"
        "if child:\n"
        "    assert os.waitpid(child, 0) == (child, 0)\n"
        "sys.exit(0)\n"
    )
    command = [sys.executable, "-W", "ignore:This process:DeprecationWarning", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_child_imports_nothing_from_its_folder(tmp_path: Path) -> None:
    """Users name their scripts "gmsh.py", and folders come from others."""
    (tmp_path / "gmsh.py").write_text("raise SystemExit('taken from the current folder')")
    (tmp_path / "h5py.py").write_text("raise SystemExit('taken from the current folder')")
    assert run_python(["-c", "import gmsh, h5py"], PATIENCE, folder=tmp_path).problem == ""
