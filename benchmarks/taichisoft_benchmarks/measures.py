"""The measurement of each kind of case but those of outputs; each runs in its own process (runner.py)."""

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from queue import Queue
from threading import Barrier
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sparse

from taichisoft import Scene
from taichisoft.running import hookimpl
from taichisoft.runtime import available_cores
from taichisoft.scene import find_file
from taichisoft_benchmarks import machine
from taichisoft_benchmarks.case_scenes import FINGER, Meshes, scene_of
from taichisoft_benchmarks.cases import (
    FactorisationCase,
    MeshingCase,
    PeerCase,
    PluginsCase,
    Simulated,
    StartCase,
    ThroughputCase,
)
from taichisoft_benchmarks.errors import BenchmarkError, PeerMissing
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


class Listener:
    """A plug-in that is called after every step and does nothing."""

    @hookimpl
    def taichisoft_step_done(self, session: Any, report: Any) -> None:
        """Do nothing."""


def measure_plugins(case: PluginsCase, scene: Scene) -> Measured:
    """Median times around the steps of each window; a step in between leaves the caches as cold as in a run.

    The figures by part are of the last window. The summary of the contacts is counted apart: the report of a step
    needs it in any case, and the observation reuses it.
    """
    from taichisoft.control import summarise_contacts
    from taichisoft.running import Simulation, make_controller, notify, register_plugin, unregister_plugin

    simulation = Simulation(scene)
    controller = make_controller(scene)
    controller.reset(simulation.model)
    parts = ("contact_summary", "observation", "hook", "hook_unused")
    times = np.zeros((case.steps, len(parts)))
    for index in range(case.steps):
        started = time.perf_counter()
        summarise_contacts(simulation.model, simulation.state)
        summarised = time.perf_counter()
        observation = simulation.observe()
        observed = time.perf_counter()
        report = simulation.step(controller.control(observation))
        name = register_plugin(Listener())
        stepped = time.perf_counter()
        notify("taichisoft_step_done", session=None, report=report)
        notified = time.perf_counter()
        unregister_plugin(name)
        idle = time.perf_counter()
        notify("taichisoft_step_done", session=None, report=report)
        unused = time.perf_counter() - idle
        times[index] = summarised - started, observed - summarised, notified - stepped, unused
    figures = window_medians(case, times[:, 1:3].sum(axis=1).tolist())
    first, last = list(case.windows.values())[-1]
    for part, seconds in zip(parts, np.median(times[first:last], axis=0).tolist(), strict=True):
        figures[f"{part}_ms"] = 1e3 * seconds
    figures["peak_mb"] = peak_memory()
    return Measured(figures, {"nodes": simulation.model.node_count, "contacts": report.contact_count})


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


PATIENCE = 300.0
"""Longest time that one process waits for the others to be ready [s]: the first may have kernels to compile."""


def measure_throughput(case: ThroughputCase, scene: Scene) -> Measured:
    """Make as many runs at once as there are cores, ours and then MuJoCo's; the clock runs from when all are ready.

    A run begins at the scene's start, and its first step is made before: the cost of a start is in the cases of
    kind "start". MuJoCo does a part of the job, see `MujocoPeer.does_not`.
    """
    cores = available_cores()
    figures = {"ours_per_s": _steps_per_second(prepare_ours, scene, case.steps, cores)}
    facts: dict[str, Any] = {"processes": cores, "steps": case.steps}
    try:
        figures["mujoco_per_s"] = _steps_per_second(prepare_mujoco, scene, case.steps, cores)
        figures["over_mujoco"] = figures["ours_per_s"] / figures["mujoco_per_s"]
    except PeerMissing as missing:
        facts["mujoco_skipped"] = str(missing)
    return Measured(figures, facts)


def prepare_ours(scene: Scene) -> Callable[[], Any]:
    from taichisoft.running import Simulation

    return controlled_step(Simulation(scene), scene)


def prepare_mujoco(scene: Scene) -> Callable[[], Any]:
    return controlled_peer_step(scene, *set_up_peer(scene, "mujoco"))


Prepare = Callable[[Scene], Callable[[], Any]]


def _steps_per_second(prepare: Prepare, scene: Scene, steps: int, processes: int) -> float:
    """Steps of all processes over the time of the slowest."""
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(processes), context.Queue()
    children = [context.Process(target=_run, args=(prepare, scene, steps, barrier, answers)) for _ in range(processes)]
    for child in children:
        child.start()
    answered = [answers.get() for _ in children]
    for child in children:
        child.join()
    failures = [answer for answer in answered if isinstance(answer, Exception)]
    if failures:
        # The processes that waited for a failed one fail with it: its error comes first.
        raise next((failure for failure in failures if isinstance(failure, PeerMissing)), failures[0])
    return processes * steps / max(answered)


def _run(prepare: Prepare, scene: Scene, steps: int, barrier: Barrier, answers: "Queue[float | Exception]") -> None:
    """Answer with the seconds of the steps, or with the error."""
    try:
        step = prepare(scene)
        step()
        barrier.wait(PATIENCE)
        started = time.perf_counter()
        for _ in range(steps):
            step()
        answers.put(time.perf_counter() - started)
    except PeerMissing as missing:
        barrier.abort()
        answers.put(missing)
    except Exception as error:
        barrier.abort()
        answers.put(BenchmarkError(f"a process of several at once failed: {type(error).__name__}: {error}"))
