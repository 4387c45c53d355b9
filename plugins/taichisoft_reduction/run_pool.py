"""Runs in several processes at a time; what is finished stays in a folder and is not made again."""

import json
import queue
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft import Control, Controller, Model, Observation
from taichisoft.base import Link, Worker, WorkerLost
from taichisoft.errors import BeyondLaw, TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult, Timetable, TrainingRun

# The process that makes runs of the training and the validation, one after the other.


def make_runs(link: Link) -> None:
    """Load Taichi and the plug-ins, say "ready", and make each run whose request and file come as a message.

    The answer to each is the problem that ended the run early, empty where there was none.
    """
    from taichisoft.running import (
        Simulation,  # noqa: F401  # starts Taichi
        load_plugin,
        plugin_registry,
    )

    plugin_registry()
    for plugin in link.receive():
        load_plugin(plugin)
    link.send("ready")
    while True:
        text, path = link.receive()
        link.send(make_run(from_json(text), Path(path)))


def to_json(request: TrainingRun) -> str:
    """A request as text."""
    return json.dumps(asdict(request))


def from_json(text: str) -> TrainingRun:
    """What `to_json` wrote."""
    values = json.loads(text)
    table = values["timetable"]
    return TrainingRun(**{**values, "timetable": None if table is None else Timetable(**table)})


def make_run(request: TrainingRun, path: Path) -> str:
    """Make a run and write its result; the problem that ended it early, or an empty text."""
    from taichisoft.base import atomic_file
    from taichisoft.control import Controller
    from taichisoft.running import Simulation, make_controller, run
    from taichisoft.scene import scene_from_toml
    from taichisoft_reduction.errors import ReductionError
    from taichisoft_reduction.run_frames import RunFrames

    class TimedSimulation(Simulation):
        """Measures the processor time of the steps [s]."""

        seconds = 0.0

        def step(self, *arguments: Any) -> Any:
            started = time.process_time()
            report = super().step(*arguments)
            self.seconds += time.process_time() - started
            return report

    kept, problem = RunFrames(request.bodies, 1, 1), ""
    simulation = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a run that is pressed hard on purpose
        try:
            scene = scene_from_toml(request.scene, request.name)
            controller: Controller
            if request.timetable is not None:
                controller = TimetableController(request.timetable)
            else:
                controller = ScaledController(make_controller(scene), request.factor)
            simulation = TimedSimulation(scene)
            kept = RunFrames(request.bodies, round(request.duration / scene.time.step), request.frames)
            run(simulation, controller, [kept], request.duration)
        except BeyondLaw:
            pass  # the run was completed
        except TaichisoftError as error:
            problem = " ".join(str(error).split())
    speed = simulation.state.step / simulation.seconds if simulation is not None and simulation.seconds else 0.0
    with atomic_file(path, ReductionError) as partial:
        kept.result(request.name, problem, speed).save(partial)
    return problem


# What drives a run of the training: a timetable, or the scene's own controller with other efforts.

DRIVES = tuple(drive.asked for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate))
AXES = ("x", "y", "z")


class TimetableController(Controller):
    """Asks for what a timetable says."""

    def __init__(self, timetable: Timetable):
        """Follow `timetable`."""
        self._timetable = timetable
        self._keys = sorted({channel.partition("/")[0] for channel in timetable.channels})

    def control(self, observation: Observation) -> Control:
        """The values at the end of the step."""
        end = observation.time + observation.control_period
        now = {
            channel: float(np.interp(end, self._timetable.times, values))
            for channel, values in self._timetable.channels.items()
        }
        asked: dict[str, object] = {}
        for key in self._keys:
            own = {name: value for (one, _, name), value in _split(now) if one == key}
            asked[key] = own if key in DRIVES else np.array([own.get(axis, 0.0) for axis in AXES])
        return Control(**asked)  # type: ignore[arg-type]


def _split(values: dict[str, float]) -> list[tuple[tuple[str, str, str], float]]:
    return [(channel.partition("/"), value) for channel, value in values.items()]


class ScaledController(Controller):
    """Another controller, whose pressures, volumes, tensions and pulls are multiplied by a factor."""

    def __init__(self, controller: Controller, factor: float):
        """Scale what `controller` asks for by `factor`."""
        self._controller, self._factor = controller, factor

    def reset(self, model: Model) -> None:
        """See `Controller`."""
        self._controller.reset(model)

    def control(self, observation: Observation) -> Control:
        """See `Controller`."""
        asked = self._controller.control(observation)
        scaled: dict[str, Any] = {
            key: {name: self._factor * value for name, value in getattr(asked, key).items()}
            for key in DRIVES
            if getattr(asked, key)
        }
        return replace(asked, **scaled) if scaled else asked


START_LIMIT = 600.0
"""Time that a process has to load Taichi and the plug-ins [s]."""
RUN_LIMIT = 3600.0
"""Longest time of a run [s]."""
ONE_THREAD = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RunPool:
    """Processes that make runs; leaving a `with` statement ends them."""

    def __init__(self, folder: Path, processes: int, plugins: Sequence[str]):
        """Keep the results in `folder`, and load `plugins`, paths, into each process."""
        self._folder, self._count, self._plugins = folder, processes, tuple(plugins)
        self._workers: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._all: list[Worker] = []

    def __enter__(self) -> "RunPool":
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._all:
            worker.end()

    def finished(self, request: TrainingRun) -> bool:
        """Whether the result of a run is there."""
        return RunResult.load(self._folder / request.file_name) is not None

    def results(self, requests: Sequence[TrainingRun], done: Callable[[str, str], None]) -> list[RunResult]:
        """The results of runs, in the order of the requests, each from its file where that is there.

        Args:
            requests: the runs.
            done: called with the name of each run that ends, and the problem that ended it early, if any.

        Raises:
            ReductionError: a process was lost, or a result cannot be written.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        waiting: queue.SimpleQueue[TrainingRun] = queue.SimpleQueue()
        missing = [request for request in requests if not self.finished(request)]
        for request in sorted(missing, key=lambda one: -one.duration * len(one.bodies)):  # long ones first
            waiting.put(request)
        ended: queue.SimpleQueue[tuple[str, str] | TaichisoftError | WorkerLost] = queue.SimpleQueue()
        threads = [
            threading.Thread(target=self._make, args=(waiting, ended), daemon=True)
            for _ in range(min(self._count, len(missing)))
        ]
        for thread in threads:
            thread.start()
        for _ in missing:
            said = ended.get()
            if isinstance(said, Exception):
                raise ReductionError(f"a process that makes runs failed: {said}") from said
            done(*said)
        return [self._load(request) for request in requests]

    def _make(self, waiting: queue.SimpleQueue, ended: queue.SimpleQueue) -> None:  # type: ignore[type-arg]
        try:
            worker = self._worker()
            while True:
                try:
                    request = waiting.get_nowait()
                except queue.Empty:
                    self._workers.put(worker)
                    return
                path = self._folder / request.file_name
                ended.put((request.name, worker.ask((to_json(request), str(path)), RUN_LIMIT)))
        except (TaichisoftError, WorkerLost) as error:
            ended.put(error)

    def _worker(self) -> Worker:
        """A process that waits for runs."""
        try:
            return self._workers.get_nowait()
        except queue.Empty:
            worker = Worker("taichisoft_reduction.run_pool:make_runs", ONE_THREAD)
            self._all.append(worker)
            worker.ask(self._plugins, START_LIMIT)
            return worker

    def _load(self, request: TrainingRun) -> RunResult:
        result = RunResult.load(self._folder / request.file_name)
        if result is None:
            raise ReductionError(f"{self._folder / request.file_name}: cannot be read; remove it and try again")
        return result
