"""Pictures of a scene, drawn without a display."""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft.scene import Scene
from taichisoft_benchmarks.descriptors import RenderingCase
from taichisoft_benchmarks.measures.measured import Measured

SIZE = (1280, 720)


def measure_rendering(case: RenderingCase, scene: Scene) -> Measured:
    """Draw pictures in one go; when each file was written tells the start of the renderer from the pictures."""
    from taichisoft.simulation import Simulation
    from taichisoft_plugins.recording import RecordingOutput
    from taichisoft_plugins.rendering import render_pictures
    from taichisoft_plugins.style import Style

    with TemporaryDirectory() as name:
        folder = Path(name)
        simulation = Simulation(scene)
        recording = RecordingOutput(folder)
        recording.begin(simulation.model, simulation.state)
        for _ in range(case.pictures):
            report = simulation.step()
            recording.record(simulation.state, report)
        recording.end("completed")
        times = {f"picture{index}": index * scene.time.step for index in range(case.pictures + 1)}
        started = time.time()
        paths = render_pictures(recording.path, times, folder, Style(size=SIZE))
        written = np.array([path.stat().st_mtime for path in paths])
    figures = {"picture_ms": 1e3 * float(np.median(np.diff(written))), "first_picture_s": float(written[0] - started)}
    return Measured(figures, {"nodes": simulation.model.node_count})
