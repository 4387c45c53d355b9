"""How often a web page moves beside a run, and what it costs the run."""

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.scenes.scene import Scene
from taichisoft_benchmarks.descriptors import WebCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory

if TYPE_CHECKING:
    from taichisoft.building.simulation import Simulation

PATIENCE = 60.0
"""For the viewer to tell what it has seen [s]; usually at once."""


def measure_web(case: WebCase, scene: Scene) -> Measured:
    """Run at the speed of real time without and with a page in turns; a viewer in a process of its own counts.

    The times of steps are compared in the second half of the run, where the viewer has come.
    """
    from taichisoft.building.simulation import Simulation

    simulation = Simulation(scene)
    start = simulation.state
    plain: list[float] = []
    watched: list[float] = []
    updates: list[float] = []
    factors: list[float] = []
    for pair in range(case.pairs):
        for with_page in (False, True) if pair % 2 == 0 else (True, False):
            simulation.restore(start)
            seen: dict[str, float] = {}
            seconds, factor = _run(simulation, scene, case.steps, seen if with_page else None)
            (watched if with_page else plain).extend(seconds[case.steps // 2 :])
            if with_page:
                updates.append(seen[f"/{scene_body(scene)}"])
                factors.append(factor)
    figures = {
        "updates_per_s": float(np.median(updates)),
        "real_time_factor": float(np.median(factors)),
        "step_ms": 1e3 * float(np.median(plain)),
        "watched_step_ms": 1e3 * float(np.median(watched)),
        "step_cost_percent": 100.0 * float(np.median(watched) / np.median(plain) - 1.0),
        "peak_mb": peak_memory(),
    }
    return Measured(figures, {"nodes": simulation.model.node_count})


def scene_body(scene: Scene) -> str:
    """The soft body whose surface the viewer counts the moves of."""
    return next(iter(scene.soft_bodies))


def _run(
    simulation: "Simulation", scene: Scene, steps: int, seen: dict[str, float] | None
) -> tuple[list[float], float]:
    """Wall times of the steps [s], and simulated over wall-clock time; with `seen` there is a page, watched."""
    from taichisoft.building.run_parts import make_controller
    from taichisoft.running.loop import run_session
    from taichisoft.session.session import Session
    from taichisoft_plugins.web.output import WebOutput

    outputs: Any = [] if seen is None else [WebOutput(Path(), "127.0.0.1:0")]
    session = Session(simulation, make_controller(scene), outputs, steps * scene.time.step, speed=1.0)
    seconds: list[float] = []
    viewers: list[subprocess.Popen[str]] = []

    def on_step(report: Any) -> None:
        seconds.append(report.step_time)
        if seen is not None and not viewers:
            command = [sys.executable, "-m", "taichisoft_benchmarks.measures.web_viewer", outputs[0].url]
            viewers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))

    run_session(session, on_step)
    for viewer in viewers:
        answer, _ = viewer.communicate(timeout=PATIENCE)
        assert seen is not None
        seen.update(json.loads(answer))
    return seconds, session.pace.mean_real_time_factor
