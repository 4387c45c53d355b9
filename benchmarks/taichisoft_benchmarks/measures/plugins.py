"""What plug-ins add to a step: the observation for the controller, and a call of a hook."""

import time
from typing import Any

import numpy as np

from taichisoft.plugin_system.hookspecs import hookimpl
from taichisoft.scenes.scene import Scene
from taichisoft_benchmarks.descriptors import PluginsCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory
from taichisoft_benchmarks.measures.steps import window_medians


class Listener:
    """A plug-in that is called after every step and does nothing."""

    @hookimpl
    def taichisoft_step_done(self, session: Any, report: Any) -> None:
        """Called, and done."""


def measure_plugins(case: PluginsCase, scene: Scene) -> Measured:
    """Median times around the steps of each window; a step in between leaves the caches as cold as in a run.

    The figures by part are those of the last window. The summary of the contacts stands apart: the report of a step
    needs it in any case, and the observation takes it over.
    """
    from taichisoft.building.run_parts import make_controller
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.contact_summary import summarise_contacts
    from taichisoft.plugin_system.hooks import notify
    from taichisoft.plugin_system.plugins import register_plugin, unregister_plugin

    simulation = Simulation(scene)
    controller = make_controller(scene)
    controller.reset(simulation.model)
    times = np.zeros((case.steps, 4))  # of each step: the contacts' summary, the rest of the observation, hooks
    contacts = 0
    for index in range(case.steps):
        started = time.perf_counter()
        summarise_contacts(simulation.model, simulation.state)
        summarised = time.perf_counter()
        observation = simulation.observe()
        observed = time.perf_counter()
        report = simulation.step(controller.control(observation))
        contacts = report.contact_count
        name = register_plugin(Listener())
        stepped = time.perf_counter()
        notify("taichisoft_step_done", session=None, report=report)
        notified = time.perf_counter()
        unregister_plugin(name)
        idle = time.perf_counter()
        notify("taichisoft_step_done", session=None, report=report)
        nobody = time.perf_counter() - idle
        times[index] = summarised - started, observed - summarised, notified - stepped, nobody
    measured = Measured(window_medians(case, times[:, 1:3].sum(axis=1).tolist()))
    first, last = list(case.windows.values())[-1]
    parts = 1e3 * np.median(times[first:last], axis=0)
    for part, value in zip(("contact_summary", "observation", "hook", "hook_nobody"), parts.tolist(), strict=True):
        measured.figures[f"{part}_ms"] = value
    measured.figures["peak_mb"] = peak_memory()
    measured.facts = {"nodes": simulation.model.node_count, "contacts": contacts}
    return measured
