"""The process that makes runs of the training and the validation, one after the other."""

import json
import time
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taichisoft.errors import BeyondLaw, TaichisoftError
from taichisoft.worker import Link
from taichisoft_reduction.run_request import Timetable, TrainingRun


def make_runs(link: Link) -> None:
    """Load Taichi and the plug-ins, say "ready", and make each run whose request and file come as a message.

    The answer to each is the problem that ended the run early, empty where there was none.
    """
    from taichisoft.building import Simulation  # noqa: F401  # starts Taichi
    from taichisoft.plugin_system import load_plugin, plugin_registry

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
    from taichisoft.atomic_file import atomic_file
    from taichisoft.building import Simulation, make_controller
    from taichisoft.control import Controller
    from taichisoft.running import run
    from taichisoft.scenes import scene_from_toml
    from taichisoft_reduction.errors import ReductionError
    from taichisoft_reduction.run_driver import ScaledController, TimetableController
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
