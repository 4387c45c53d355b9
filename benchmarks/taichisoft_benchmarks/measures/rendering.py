"""A video of a scene, drawn without a display."""

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft.scenes.scene import Scene
from taichisoft_benchmarks.descriptors import RenderingCase
from taichisoft_benchmarks.measures.measured import Measured

SIZE = (1280, 720)
LONG_VIDEO = 20 * 30
"""Frames of a run of 20 s at 30 frames per second."""


def measure_rendering(case: RenderingCase, scene: Scene) -> Measured:
    """Record a run and draw all its frames into an MP4, as `taichisoft render --video` does.

    The start of the renderer, up to the first frame, is told apart. A frame has its encoding in it, which goes on
    beside the drawing of the next one. The figure of the long video is what these figures give for its frames.
    """
    from taichisoft_plugins.drawing.style import Style
    from taichisoft_plugins.rendering.video import render_video

    drawn: list[float] = []
    with TemporaryDirectory(prefix="taichisoft-rendering-") as name:
        folder = Path(name)
        nodes = _record(case, scene, folder)
        fps = 1.0 / (case.steps // case.frames * scene.time.step)
        started = time.perf_counter()
        render_video(
            folder / "recording.h5",
            folder / "video.mp4",
            Style(size=SIZE),
            fps,
            on_frame=lambda *_: drawn.append(time.perf_counter()),
        )
        ended = time.perf_counter()
    between = np.diff(drawn)
    start, end = drawn[0] - started, ended - drawn[-1]
    figures = {
        "frame_ms": 1e3 * float(np.median(between)),
        "start_s": start,
        "video_20s_s": start + float(between.mean()) * (LONG_VIDEO - 1) + end,
    }
    return Measured(figures, {"nodes": nodes, "frames": len(drawn)})


def _record(case: RenderingCase, scene: Scene, folder: Path) -> int:
    """Let the scene's controller drive; returns the number of nodes."""
    from taichisoft.building.run_parts import make_controller
    from taichisoft.building.simulation import Simulation
    from taichisoft_plugins.recording.output import RecordingOutput

    simulation = Simulation(scene)
    controller = make_controller(scene)
    controller.reset(simulation.model)
    recording = RecordingOutput(folder, every=case.steps // case.frames)
    recording.begin(simulation.model, simulation.state)
    for _ in range(case.steps):
        report = simulation.step(controller.control(simulation.observe()))
        recording.record(simulation.state, report)
    recording.end("completed")
    return int(simulation.model.node_count)
