"""Pictures of a scene, drawn without a display."""

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.scene import Scene
from taichisoft_benchmarks.descriptors import RenderingCase
from taichisoft_benchmarks.measures.measured import Measured

SIZE = (1280, 720)


def measure_rendering(case: RenderingCase, scene: Scene) -> Measured:
    """Draw one picture and then many; the start of the renderer is what the first one costs beyond a later one."""
    from taichisoft.simulation import Simulation
    from taichisoft_plugins.recording import RecordingOutput
    from taichisoft_plugins.rendering import render_pictures

    with TemporaryDirectory() as name:
        folder = Path(name)
        simulation = Simulation(scene)
        recording = RecordingOutput(folder)
        recording.begin(simulation.model, simulation.state)
        for _ in range(case.pictures):
            report = simulation.step()
            recording.record(simulation.state, report)
        recording.end("completed")
        step = scene.time.step
        one = _seconds(lambda: render_pictures(recording.path, {"first": 0.0}, folder, SIZE))
        times = {f"picture{index}": index * step for index in range(case.pictures + 1)}
        many = _seconds(lambda: render_pictures(recording.path, times, folder, SIZE))
    per_picture = (many - one) / case.pictures
    return Measured(
        {"picture_ms": 1e3 * per_picture, "renderer_start_s": one - per_picture}, {"nodes": simulation.model.node_count}
    )


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
