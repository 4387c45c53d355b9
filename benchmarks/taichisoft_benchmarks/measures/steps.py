"""Time per step of a scene."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.scenes.scene import Scene
from taichisoft_benchmarks.descriptors import Simulated
from taichisoft_benchmarks.measures.measured import Measured, peak_memory

if TYPE_CHECKING:
    from taichisoft.building.simulation import Simulation

PROFILED_STEPS = 30


def measure_steps(case: Simulated, scene: Scene) -> Measured:
    """Make the case's steps; what the first one takes with the preparation is told apart from the rest."""
    started = time.perf_counter()
    from taichisoft.building.run_parts import make_controller
    from taichisoft.building.simulation import Simulation

    simulation = Simulation(scene)
    controller = make_controller(scene)
    controller.reset(simulation.model)
    reports = [simulation.step(controller.control(simulation.observe()))]
    prepared = time.perf_counter() - started
    for _ in range(case.steps - 1):
        reports.append(simulation.step(controller.control(simulation.observe())))
    measured = Measured({**window_medians(case, [report.step_time for report in reports]), "prepare_s": prepared})
    measured.figures["peak_mb"] = peak_memory()
    moved = np.linalg.norm(simulation.state.position - simulation.model.rest_position, axis=1).max(initial=0.0)
    measured.facts = {
        "nodes": simulation.model.node_count,
        "displacement_mm": round(float(moved), 4),
        "unconverged": sum(not report.converged for report in reports),
    }
    if len(simulation.state.rigid_position):
        measured.facts["object_mm"] = simulation.state.rigid_position[0].round(5).tolist()
    for metric, (first, last) in case.windows.items():
        some = reports[first:last]
        name = metric.removesuffix("_ms")
        measured.facts[f"{name}_contacts"] = round(float(np.mean([report.contact_count for report in some])))
        measured.facts[f"{name}_sweeps"] = round(float(np.mean([report.iterations for report in some])))
    if case.steps >= PROFILED_STEPS:
        measured.phases["end"] = _phases(simulation, controller)
    return measured


def window_medians(case: Simulated, seconds: Sequence[float]) -> dict[str, float]:
    """Median time of the steps of each window [ms], of the time of every step [s]."""
    return {
        metric: 1e3 * float(np.median(seconds[first:last]))
        for metric, (first, last) in case.windows.items()
        if last <= len(seconds)
    }


def _phases(simulation: "Simulation", controller: Any) -> dict[str, float]:
    """Median time of each phase [ms] in more steps of the case, and of the part of a step in Python.

    They are steps of their own, because measuring phases takes time too.
    """
    from taichisoft.running.profile import TOTAL, profiled

    with profiled(simulation) as profile:
        for _ in range(PROFILED_STEPS):
            simulation.step(controller.control(simulation.observe()))
    medians = profile.medians()
    return {**{phase: times[0] for phase, times in medians.items()}, "of it in Python": medians[TOTAL][1]}
