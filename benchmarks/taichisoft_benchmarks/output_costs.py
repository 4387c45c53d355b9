"""Costs of outputs: the recording of a run, a video of it, a web page beside it."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taichisoft import Scene
from taichisoft_benchmarks.cases import RecordingCase, RenderingCase, WebCase
from taichisoft_benchmarks.measures import Measured, controlled_step, peak_memory

if TYPE_CHECKING:
    from taichisoft.mechanics import State
    from taichisoft.running import Simulation

SIZE = (1280, 720)
LONG_VIDEO = 20 * 30
"""Number of frames of a run of 20 s at 30 frames per second."""
PATIENCE = 60.0
"""Longest time that the viewer of a page may take to answer [s]; usually it answers at once."""


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
        for with_output in _turns(simulation, start, case.pairs):
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


def measure_rendering(case: RenderingCase, scene: Scene) -> Measured:
    """Record a run and draw all its frames into an MP4, as `taichisoft render --video` does.

    The start of the renderer, up to the first picture, is a separate figure. That of a picture includes its encoding,
    which runs beside the drawing of the next one. The figure of the long video follows from the two.
    """
    from taichisoft.running import Simulation
    from taichisoft_outputs.drawing.style import Style
    from taichisoft_outputs.rendering.video import render_video

    drawn: list[float] = []
    with TemporaryDirectory(prefix="taichisoft-rendering-") as name:
        folder = Path(name)
        simulation = Simulation(scene)
        _recorded_run(simulation, scene, case.steps, folder, case.every)
        started = time.perf_counter()
        render_video(
            folder / "recording.h5",
            folder / "video.mp4",
            Style(size=SIZE),
            1.0 / (case.every * scene.time.step),
            on_picture=lambda *_: drawn.append(time.perf_counter()),
        )
        ended = time.perf_counter()
    between = np.diff(drawn)
    start, end = drawn[0] - started, ended - drawn[-1]
    figures = {
        "frame_ms": 1e3 * float(np.median(between)),
        "start_s": start,
        "video_20s_s": start + float(between.mean()) * (LONG_VIDEO - 1) + end,
    }
    return Measured(figures, {"nodes": simulation.model.node_count, "frames": len(drawn)})


def measure_web(case: WebCase, scene: Scene) -> Measured:
    """Run in real time, alternating without and with a page; a viewer in another process counts updates.

    The times of steps are compared in the second half of the run, when the viewer is connected.
    """
    from taichisoft.running import Simulation

    simulation = Simulation(scene)
    plain: list[float] = []
    watched: list[float] = []
    updates: list[float] = []
    factors: list[float] = []
    for with_page in _turns(simulation, simulation.state, case.pairs):
        seen: dict[str, float] = {}
        seconds, factor = _watched_run(simulation, scene, case.steps, seen if with_page else None)
        (watched if with_page else plain).extend(seconds[case.steps // 2 :])
        if with_page:
            updates.append(seen[f"/{next(iter(scene.soft_bodies))}"])
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


def _turns(simulation: "Simulation", start: "State", pairs: int) -> Iterator[bool]:
    """Whether the next run is with the output, for pairs of runs in changing order; each begins at `start`."""
    for pair in range(pairs):
        for with_output in (False, True) if pair % 2 == 0 else (True, False):
            simulation.restore(start)
            yield with_output


def _recorded_run(
    simulation: "Simulation", scene: Scene, steps: int, folder: Path | None, every: int = 1
) -> tuple[float, float]:
    """Make steps and record them into the folder, if there is one.

    Returns:
        Wall time [s], and the part of it in the output [s].
    """
    from taichisoft_outputs.recording.recording_output import RecordingOutput

    step = controlled_step(simulation, scene)
    output = None if folder is None else RecordingOutput(folder, every=every)
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


def _watched_run(
    simulation: "Simulation", scene: Scene, steps: int, seen: dict[str, float] | None
) -> tuple[list[float], float]:
    """Make steps at the speed of real time, with a page and its viewer if `seen` is given.

    Args:
        simulation: simulation at its start.
        scene: scene with the controller.
        steps: number of steps.
        seen: filled with the updates per second of each surface, by its name on the page.

    Returns:
        Wall time of every step [s], and simulated over wall-clock time [-].
    """
    from taichisoft.running import Session, make_controller, run_session
    from taichisoft_outputs.web.web_output import WebOutput

    outputs: Any = [] if seen is None else [WebOutput(Path(), "127.0.0.1:0")]
    session = Session(simulation, make_controller(scene), outputs, steps * scene.time.step, speed=1.0)
    seconds: list[float] = []
    viewers: list[subprocess.Popen[str]] = []

    def on_step(report: Any) -> None:
        seconds.append(report.step_time)
        if seen is not None and not viewers:
            command = [sys.executable, "-m", "taichisoft_benchmarks.output_costs", outputs[0].url]
            viewers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))

    run_session(session, on_step)
    for viewer in viewers:
        answer, _ = viewer.communicate(timeout=PATIENCE)
        assert seen is not None
        seen.update(json.loads(answer))
    return seconds, session.pace.mean_real_time_factor


HEADER = 16
"""Bytes of a packet before its messages: two lengths."""

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 5.0],
    "fov": 0.5,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


class Viewer:
    """Reads a page in a thread; use it in a `with` statement.

    Attributes:
        moments: when each surface of the scene has moved, on the clock of `time.monotonic` [s], by name ("/finger1").
    """

    def __init__(self, url: str):
        """Connect, as a browser does that has loaded the page."""
        import viser
        from websockets.sync.client import connect

        self.moments: dict[str, list[float]] = {}
        protocol: Any = f"viser-v{viser.__version__}"
        self._socket = connect(
            url.replace("http", "ws"), subprotocols=[protocol], compression=None, max_size=None, proxy=None
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self.send(CAMERA)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._thread.join()

    def send(self, message: dict[str, Any]) -> None:
        """Send the page a message, as its browser part would."""
        import msgspec

        self._socket.send(msgspec.msgpack.encode(message))

    def watch(self) -> None:
        """Return when the page has gone away."""
        self._thread.join()

    def take(self, content: dict[str, Any], packet: bytes) -> None:
        """Take note of the messages in the content of a packet; the arrays that they refer to end the packet."""
        for message in content["messages"]:
            if message["type"] == "SceneNodeUpdateMessage" and "vertices" in message["updates"]:
                self.moments.setdefault(message["name"], []).append(time.monotonic())

    def _read(self) -> None:
        """Read until the page goes away; a packet is two lengths, then packed messages, then arrays."""
        import msgspec
        import zstandard
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                packet = self._socket.recv()
            except ConnectionClosed:
                return
            assert isinstance(packet, bytes)
            end = HEADER + int.from_bytes(packet[HEADER // 2 : HEADER], "little")
            self.take(msgspec.msgpack.decode(zstandard.decompress(packet[HEADER:end])), packet)


def main() -> None:
    """Watch the page, and print how often each surface moved."""
    with Viewer(sys.argv[1]) as viewer:
        viewer.watch()
    rates = {name: (len(at) - 1) / (at[-1] - at[0]) for name, at in viewer.moments.items() if len(at) > 1}
    print(json.dumps(rates))


if __name__ == "__main__":
    main()
