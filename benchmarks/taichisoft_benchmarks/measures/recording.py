"""What the output "recording" adds to a run."""

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.scenes.scene import Scene
from taichisoft_benchmarks.descriptors import RecordingCase
from taichisoft_benchmarks.measures.measured import Measured, peak_memory

if TYPE_CHECKING:
    from taichisoft.building.simulation import Simulation


def measure_recording(case: RecordingCase, scene: Scene) -> Measured:
    """Make the same steps without and with the output in turns, in one process; wall time, as a user waits for it.

    The order within a pair changes, so that a machine that gets slower or faster favours neither; the median of the
    pairs is taken. The time with the output has the writing of its last frames in it. `output_ms` is what passes within
    the output: it leaves out what it does to the caches of the steps, and scatters far less on a busy machine.
    """
    from taichisoft.building.simulation import Simulation

    simulation = Simulation(scene)
    start = simulation.state
    _run(simulation, scene, case.steps, None)  # compiles, and fills caches
    plain: list[float] = []
    recorded: list[float] = []
    within: list[float] = []
    with TemporaryDirectory(prefix="taichisoft-recording-") as name:
        for pair in range(case.pairs):
            folders = [None, Path(name)] if pair % 2 == 0 else [Path(name), None]
            for folder in folders:
                simulation.restore(start)
                seconds, in_output = _run(simulation, scene, case.steps, folder)
                (plain if folder is None else recorded).append(seconds)
                if folder is not None:
                    within.append(in_output)
        size = (Path(name) / "recording.h5").stat().st_size
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


def _run(simulation: "Simulation", scene: Scene, steps: int, folder: Path | None) -> tuple[float, float]:
    """Wall time of the steps, and of it in the output [s]; they are recorded into the folder, if there is one."""
    from taichisoft.building.run_parts import make_controller
    from taichisoft_plugins.recording.output import RecordingOutput

    controller = make_controller(scene)
    controller.reset(simulation.model)
    output = None if folder is None else RecordingOutput(folder)
    if output is not None:
        output.begin(simulation.model, simulation.state)
    in_output = 0.0
    started = time.perf_counter()
    for _ in range(steps):
        report = simulation.step(controller.control(simulation.observe()))
        if output is not None:
            stepped = time.perf_counter()
            output.record(simulation.state, report)
            in_output += time.perf_counter() - stepped
    stepped = time.perf_counter()
    if output is not None:
        output.end("completed")
        in_output += time.perf_counter() - stepped
    return time.perf_counter() - started, in_output
