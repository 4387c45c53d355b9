"""Time per step of a scene: the whole step, its phases, its part in Python, and the share of plug-ins."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.running import hookimpl
from taichisoft_benchmarks.cases import PluginsCase, Simulated
from taichisoft_benchmarks.measures.measured import Measured, controlled_step, peak_memory

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
    parts = ("contact_summary", "observation", "hook", "hook_nobody")
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
        nobody = time.perf_counter() - idle
        times[index] = summarised - started, observed - summarised, notified - stepped, nobody
    figures = window_medians(case, times[:, 1:3].sum(axis=1).tolist())
    first, last = list(case.windows.values())[-1]
    for part, seconds in zip(parts, np.median(times[first:last], axis=0).tolist(), strict=True):
        figures[f"{part}_ms"] = 1e3 * seconds
    figures["peak_mb"] = peak_memory()
    return Measured(figures, {"nodes": simulation.model.node_count, "contacts": report.contact_count})
