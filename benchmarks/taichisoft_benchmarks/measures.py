"""The measurement of each kind of case; each runs in its own process (runner.py)."""

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sparse

from taichisoft import Scene
from taichisoft.scene import find_file
from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_scenes import FINGER, Meshes, scene_of
from taichisoft_benchmarks.cases import (
    FactorisationCase,
    MeshingCase,
    PeerCase,
    RecordingCase,
    Simulated,
    StartCase,
)
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.peers import controlled_peer_step, prepare_cholmod, prepare_superlu, set_up_peer

if TYPE_CHECKING:
    from taichisoft.running import Simulation
    from taichisoft.step import StepReport


@dataclass
class Measured:
    """Figures and facts of one repetition.

    Attributes:
        figures: values by metric; the end of a metric's name is its unit (_ms, _s, _mb).
        facts: properties of the case, such as its number of nodes.
        phases: time of each phase of the step at the end of the case [ms].
        does_not: parts of the job that another program leaves out; empty for taichisoft itself.
    """

    figures: dict[str, float] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    phases: dict[str, float] = field(default_factory=dict)
    does_not: str = ""


def peak_memory() -> float:
    """Largest memory of this process so far [MB]; 0 if the system does not report it."""
    if sys.platform == "win32":
        return 0.0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(used) / (2**20 if sys.platform == "darwin" else 2**10)


def controlled_step(simulation: "Simulation", scene: Scene) -> "Callable[[], StepReport]":
    """A function that makes one step, driven by a new controller of the scene."""
    from taichisoft.running import make_controller

    controller = make_controller(scene)
    controller.reset(simulation.model)
    return lambda: simulation.step(controller.control(simulation.observe()))


IMPORT = """import time; started = time.perf_counter()
from taichisoft.running import Simulation, make_model; print(time.perf_counter() - started)"""


def measure_start(case: StartCase, meshes: Meshes) -> Measured:
    """Import, in a fresh process, then model and first step; a cold case has an empty folder for compiled kernels."""
    from taichisoft.running import Simulation, make_model

    child = subprocess.run([sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True)
    started = time.perf_counter()
    model = make_model(scene_of(case, meshes))
    made = time.perf_counter()
    Simulation(model).step()
    figures = {"import_s": float(child.stdout), "model_s": made - started, "first_step_s": time.perf_counter() - made}
    return Measured(
        {**figures, "total_s": sum(figures.values()), "peak_mb": peak_memory()}, {"nodes": model.node_count}
    )


def measure_meshing(case: MeshingCase) -> Measured:
    """One mesh of the tutorial's finger; loading gmsh is not counted."""
    import gmsh  # noqa: F401

    from taichisoft_meshing.geometry_file import read_geometry
    from taichisoft_meshing.mesh_job import requested_mesh
    from taichisoft_meshing.wall_quality import radius_ratios

    file = find_file(FINGER, "fingers", ())
    started = time.perf_counter()
    mesh = requested_mesh(read_geometry(file), file, preset=case.preset)
    seconds = time.perf_counter() - started
    worst = radius_ratios(mesh.nodes, mesh.elements).min()
    return Measured(
        {"mesh_s": seconds, "peak_mb": peak_memory()},
        {"nodes": len(mesh.nodes), "elements": len(mesh.elements), "worst_radius_ratio": round(float(worst), 3)},
    )


PROFILED_STEPS = 30
"""Largest number of steps, after the steps of the case, in which phases are measured."""


def measure_steps(case: Simulated, scene: Scene) -> Measured:
    """Make the case's steps, then some more to measure the phases, which takes time too.

    The first step and its preparation are a figure of their own. `python_ms` is the part of a step outside kernels, in
    the steps with phases.
    """
    started = time.perf_counter()
    from taichisoft.running import TOTAL, Simulation, profiled

    simulation = Simulation(scene)
    step = controlled_step(simulation, scene)
    reports = [step()]
    prepared = time.perf_counter() - started
    reports += [step() for _ in range(case.steps - 1)]
    figures = {**window_medians(case, [report.step_time for report in reports]), "prepare_s": prepared}
    figures["peak_mb"] = peak_memory()
    moved = np.linalg.norm(simulation.state.position - simulation.model.rest_position, axis=1).max(initial=0.0)
    facts: dict[str, Any] = {
        "nodes": simulation.model.node_count,
        "displacement_mm": round(float(moved), 4),
        "unconverged": sum(not report.converged for report in reports),
    }
    if len(simulation.state.rigid_position):
        facts["object_mm"] = simulation.state.rigid_position[0].round(5).tolist()
    for metric, (first, last) in case.windows.items():
        name, some = metric.removesuffix("_ms"), reports[first:last]
        facts[f"{name}_contacts"] = round(float(np.mean([report.contact_count for report in some])))
        facts[f"{name}_sweeps"] = round(float(np.mean([report.iterations for report in some])))
    with profiled(simulation) as profile:
        for _ in range(min(PROFILED_STEPS, 1 + case.steps // 4)):
            step()
    medians = profile.medians()
    figures["python_ms"] = medians[TOTAL][1]
    return Measured(figures, facts, {phase: times[0] for phase, times in medians.items()})


def window_medians(case: Simulated, seconds: Sequence[float]) -> dict[str, float]:
    """Median time of the steps of each window [ms], from the time of every step [s]; later windows are left out."""
    return {
        metric: 1e3 * float(np.median(seconds[first:last]))
        for metric, (first, last) in case.windows.items()
        if last <= len(seconds)
    }


def measure_peer(case: PeerCase, scene: Scene) -> Measured:
    """Make the case's steps in another program, under the pressures of the scene's script."""
    started = time.perf_counter()
    model, peer = set_up_peer(scene, case.peer)
    prepared = time.perf_counter() - started
    step = controlled_peer_step(scene, model, peer)
    seconds = [step() for _ in range(min(case.steps, case.peer_steps or case.steps))]
    figures = {**window_medians(case, seconds), "prepare_s": prepared, "peak_mb": peak_memory()}
    moved = np.linalg.norm(peer.positions() - model.rest_position, axis=1).max()
    facts = {"nodes": model.node_count, "displacement_mm": round(float(moved), 4), **peer.facts()}
    return Measured(figures, facts, does_not=peer.does_not)


WARM_UP = 3
DENSE_MFLOP = 2.0 * machine.DENSE_SIZE**3 / 1e6


def measure_factorisation(case: FactorisationCase, scene: Scene) -> Measured:
    """Median times to factorise the matrix of the first step."""
    from taichisoft.mechanics import ElasticSystem
    from taichisoft.running import make_model

    model = make_model(scene)
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    system.position[:] = model.rest_position
    system.assemble()
    solver, symbolic = system.solver, system.solver.symbolic
    matrix = system_matrix(symbolic.block_pairs, solver.blocks, model.node_count)
    contestants: dict[str, Callable[[], Any]] = {
        "factorise": partial(solver.factorise, np.zeros((model.node_count, 3)))
    }
    facts: dict[str, Any] = {
        "nodes": model.node_count,
        "unknowns": matrix.shape[0],
        "factor_entries": int(symbolic.factor_entries),
    }
    for name, prepare in (("cholmod", prepare_cholmod), ("superlu", prepare_superlu)):
        try:
            contestants[name] = prepare(matrix)
        except PeerMissing as missing:
            facts[f"{name}_skipped"] = str(missing)
    facts["mflop"] = round(arithmetic(contestants["superlu"]().L), 2)
    times = _in_turns(contestants, case.rounds)
    # Speed of a dense product on the case's threads, an upper bound for any factorisation.
    facts["dense_gflops"] = round(DENSE_MFLOP / machine.measure()["dense_ms"], 1)
    measured = Measured({f"{name}_ms": median for name, median in times.items()}, facts)
    for name in ("cholmod", "superlu"):
        if name in times:
            measured.figures[f"ratio_to_{name}"] = times["factorise"] / times[name]
    measured.figures["peak_mb"] = peak_memory()
    return measured


def system_matrix(block_pairs: np.ndarray, blocks: np.ndarray, node_count: int) -> sparse.csc_matrix:
    """The whole symmetric matrix from the stored 3x3 blocks of one half.

    Args:
        block_pairs: nodes of each block's row and column, shape (block_count, 2).
        blocks: blocks on and below the diagonal, shape (block_count, 3, 3).
        node_count: number of nodes; the matrix has three rows for each.
    """
    axes = np.arange(3)
    rows = np.broadcast_to(3 * block_pairs[:, 0, None, None] + axes[:, None], blocks.shape)
    columns = np.broadcast_to(3 * block_pairs[:, 1, None, None] + axes[None, :], blocks.shape)
    size = (3 * node_count, 3 * node_count)
    half = sparse.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), size)
    off_diagonal = np.repeat(block_pairs[:, 0] != block_pairs[:, 1], 9)
    other = sparse.coo_matrix((half.data[off_diagonal], (half.col[off_diagonal], half.row[off_diagonal])), size)
    return (half + other).tocsc()


def arithmetic(factor: sparse.csc_matrix) -> float:
    """Number of multiplications and additions of a Cholesky factorisation with this factor's pattern [millions]."""
    in_column = np.diff(factor.indptr).astype(float)
    return float((in_column**2).sum() / 1e6)


def _in_turns(contestants: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Median time of each contestant [ms]; they alternate so that other work on the machine slows all of them alike."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(WARM_UP + rounds):
        for name, factorise in contestants.items():
            factorise()  # untimed: the caches hold another contestant's numbers
            started = time.perf_counter()
            factorise()
            times[name].append(1e3 * (time.perf_counter() - started))
    return {name: float(np.median(measured[WARM_UP:])) for name, measured in times.items()}


def measure_recording(case: RecordingCase, scene: Scene) -> Measured:
    """Wall time of the same steps without and with the recording, alternating in one process.

    The order within a pair changes, so that a machine that gets slower or faster favours neither; the median of the
    pairs is taken. The time with the output includes the writing of its last frames. `output_ms` is the time within the
    output: it leaves out the effect on the caches of the steps, and scatters far less on a busy machine.
    """
    from taichisoft.running import Simulation

    simulation = Simulation(scene)
    start = simulation.state
    _recorded_run(simulation, scene, case.steps, None)  # compiles, and fills caches
    plain: list[float] = []
    recorded: list[float] = []
    within: list[float] = []
    with TemporaryDirectory(prefix="taichisoft-recording-") as name:
        folder = Path(name)
        for number in range(2 * case.pairs):
            with_output = number % 4 in (1, 2)
            simulation.restore(start)
            seconds, in_output = _recorded_run(simulation, scene, case.steps, folder if with_output else None)
            (recorded if with_output else plain).append(seconds)
            if with_output:
                within.append(in_output)
        size = (folder / "recording.h5").stat().st_size
    cost = np.median(np.array(recorded) - np.array(plain))
    figures = {
        "step_ms": 1e3 * float(np.median(plain)) / case.steps,
        "cost_ms": 1e3 * float(cost) / case.steps,
        "output_ms": 1e3 * float(np.median(within)) / case.steps,
        "cost_percent": 100.0 * float(cost / np.median(plain)),
        "kb_per_step": size / 1e3 / case.steps,
        "peak_mb": peak_memory(),
    }
    return Measured(figures, {"nodes": simulation.model.node_count})


def _recorded_run(simulation: "Simulation", scene: Scene, steps: int, folder: Path | None) -> tuple[float, float]:
    """Make steps and record them into the folder, if there is one.

    Returns:
        Wall time [s], and the part of it in the output [s].
    """
    from taichisoft_outputs.recording.recording_output import RecordingOutput

    step = controlled_step(simulation, scene)
    output = None if folder is None else RecordingOutput(folder)
    if output is not None:
        output.begin(simulation.model, simulation.state)
    in_output = 0.0
    started = time.perf_counter()
    for _ in range(steps):
        report = step()
        if output is not None:
            stepped = time.perf_counter()
            output.record(simulation.state, report)
            in_output += time.perf_counter() - stepped
    stepped = time.perf_counter()
    if output is not None:
        output.end("completed")
        in_output += time.perf_counter() - stepped
    return time.perf_counter() - started, in_output
