"""The runs of training and validation: as plain data, how they are made, in several processes, and their results."""

import hashlib
import json
import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import taichisoft
from taichisoft import Control, Controller, Model, Observation, Output, State, StepReport
from taichisoft.base import Pool, atomic_file, read_arrays
from taichisoft.errors import BeyondLaw, TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft_outputs.run_figures import Slipping
from taichisoft_reduction.body_shapes import relative_motions
from taichisoft_reduction.errors import ReductionError

DIGITS = 12
"""Digits of the hash in a file's name."""


@dataclass(frozen=True)
class Timetable:
    """What is asked for over time, linear between the times.

    Attributes:
        times: [s], rising, shape (count,).
        channels: values at these times by "KEY/NAME", such as "pressure/finger.cavity" [kPa] or "base_rotation/x"
            [rad], with a key of `taichisoft.Control` and the name of an actuator or of an axis.
    """

    times: tuple[float, ...]
    channels: Mapping[str, tuple[float, ...]]

    @property
    def duration(self) -> float:
        """Time of the last entry [s]."""
        return self.times[-1]


@dataclass(frozen=True)
class TrainingRun:
    """A run to be made.

    Attributes:
        name: short name in files, tables and messages.
        scene: resolved scene as TOML.
        bodies: names of the soft bodies whose displacements are kept.
        duration: simulated time [s].
        timetable: what drives it; None for the scene's own controller.
        factor: factor on all pressures, volumes, tensions and pulls that the scene's own controller asks for.
        instants: number of instants that are kept.
        plugins: paths of the plug-ins that it needs.
        files: digest of the meshes that the scene names.
    """

    name: str
    scene: str
    bodies: tuple[str, ...]
    duration: float
    timetable: Timetable | None = None
    factor: float = 1.0
    instants: int = 24
    plugins: tuple[str, ...] = ()
    files: str = ""

    @property
    def cost(self) -> float:
        """Simulated time, summed over the bodies [s]."""
        return self.duration * len(self.bodies)

    @property
    def file_name(self) -> str:
        """Name of its file, which has a hash of all that decides what comes out."""
        text = json.dumps({**asdict(self), "version": taichisoft.__version__}, sort_keys=True)
        return f"{self.name}-{hashlib.sha256(text.encode()).hexdigest()[:DIGITS]}.npz"


@dataclass(frozen=True)
class RunResult:
    """What came out of a run.

    Attributes:
        name: name of the run.
        problem: why it did not reach its end, in one line; empty where it did.
        time: of each instant [s], shape (instant_count,).
        displacement: relative displacements of the nodes by body [mm], shape (instant_count, node_count, 3).
        figures: values in each instant by name with unit, such as "lift of cube [mm]", shape (instant_count,).
        touched: whether something pressed a node, by body, shape (node_count,).
        drives: by actuator, the key of `taichisoft.Control` that drove it, and its smallest and largest value.
        steps_per_second: of processor time, without the time for what is kept.
    """

    name: str
    problem: str
    time: np.ndarray
    displacement: Mapping[str, np.ndarray]
    figures: Mapping[str, np.ndarray]
    touched: Mapping[str, np.ndarray] = field(default_factory=dict)
    drives: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    steps_per_second: float = 0.0

    def save(self, path: Path) -> None:
        """Write it to a file of numpy's."""
        about = {
            "name": self.name,
            "problem": self.problem,
            "figures": list(self.figures),
            "drives": dict(self.drives),
            "steps_per_second": self.steps_per_second,
        }
        values = np.column_stack([np.zeros((len(self.time), 0)), *self.figures.values()])
        arrays: dict[str, Any] = {f"displacement/{name}": array for name, array in self.displacement.items()}
        arrays |= {f"touched/{name}": array for name, array in self.touched.items()}
        with path.open("wb") as file:
            np.savez(file, about=np.array(json.dumps(about)), time=self.time, figures=values, **arrays)

    @classmethod
    def load(cls, path: Path) -> "RunResult | None":
        """Read what `save` wrote; None where there is nothing, or not all of it."""
        try:
            file = read_arrays(path)
            about = json.loads(str(file["about"]))
            parts = {name.partition("/")[::2]: array for name, array in file.items() if "/" in name}
            return cls(
                name=about["name"],
                problem=about["problem"],
                time=file["time"],
                displacement={body: array for (kind, body), array in parts.items() if kind == "displacement"},
                figures=dict(zip(about["figures"], file["figures"].T, strict=True)),
                touched={body: array for (kind, body), array in parts.items() if kind == "touched"},
                drives={name: (key, low, high) for name, (key, low, high) in about["drives"].items()},
                steps_per_second=about["steps_per_second"],
            )
        except (OSError, ValueError, KeyError):
            return None


# What is kept of a run.


class RunFigures:
    """Figures of a run by which a full and a reduced model are compared."""

    def __init__(self, bodies: Sequence[str], model: Model, state: State):
        """Begin at a state; with the forces on `bodies`."""
        self._bodies, self._model, self._first = bodies, model, state
        self._slipping = Slipping(len(model.soft_bodies), state)
        self._slid = np.zeros((len(model.rigid_bodies), 3))

    def add(self, state: State) -> None:
        """Follow a step; to be called after each."""
        self._slid += self._slipping.add(state)

    def at(self, state: State, report: StepReport) -> dict[str, float]:
        """Values by name with unit after a step, such as "lift of cube [mm]"."""
        seen, model = report.observation.truth, self._model
        figures = {f"bending of {name} [deg]": math.degrees(angle) for name, angle in seen.bending_angles.items()}
        figures |= {f"imbalance of {name} [mm]": distance for name, distance in report.imbalance.items()}
        figures |= {f"volume of {name} [mm^3]": volume for name, volume in seen.volumes.items()}
        forces = dict.fromkeys(self._pairs(), 0.0) | {
            pair: force for pair, force in seen.normal_forces.items() if pair in self._pairs()
        }
        figures |= {f"force of {body} on {other} [mN]": force for (body, other), force in forces.items()}
        motions = state.rigid_position - self._first.rigid_position
        for body, motion, slid in zip(model.rigid_bodies, motions, self._slid, strict=True):
            figures[f"lift of {body.name} [mm]"] = float(motion @ model.scene.up)
            figures[f"slip of {body.name} [mm]"] = float(np.linalg.norm(slid))
        return figures

    def _pairs(self) -> list[tuple[str, str]]:
        """Each kept body with each other body of the scene, in the scene's order."""
        names = self._model.body_names
        order = {name: number for number, name in enumerate(names)}
        pairs = {tuple(sorted((body, other), key=order.__getitem__)) for body in self._bodies for other in names}
        return sorted(((a, b) for a, b in pairs if a != b), key=lambda pair: (order[pair[0]], order[pair[1]]))


class RunInstants(Output):
    """Keeps displacements and figures in some steps, evenly spread over the run."""

    def __init__(self, bodies: Sequence[str], step_count: int, instants: int):
        """Keep the displacements of `bodies` in at most `instants` of `step_count` steps."""
        self._bodies = bodies
        self._every = max(1, math.ceil(step_count / instants))
        self._time: list[float] = []
        self._figures: list[dict[str, float]] = []
        self._displacement: dict[str, list[np.ndarray]] = {name: [] for name in bodies}
        self._touched: dict[str, np.ndarray] = {}
        self._begun = False

    def begin(self, model: Model, state: State) -> None:
        """See `Output`."""
        self._begun = True
        self._model, self._last = model, state
        self._motions = relative_motions(model, self._bodies)
        self._nodes = {body.name: body.nodes for body in model.soft_bodies}
        frames = zip(model.soft_bodies, model.soft_frame.tolist(), strict=True)
        self._frame = {body.name: frame for body, frame in frames}
        self._touched = {name: np.zeros(len(model.rest_position[self._nodes[name]]), bool) for name in self._bodies}
        self._run_figures = RunFigures(self._bodies, model, state)
        self._lowest = state.actuator_target.copy()
        self._highest = state.actuator_target.copy()

    def record(self, state: State, report: StepReport) -> None:
        """See `Output`."""
        self._run_figures.add(state)
        self._lowest = np.minimum(self._lowest, state.actuator_target)
        self._highest = np.maximum(self._highest, state.actuator_target)
        self._last = state
        if state.step % self._every or report.inverted_elements:
            return
        self._time.append(state.time)
        places = self._model.places(state)
        for name, motion in self._motions.items():
            displacement = motion.displacement(state.position[self._nodes[name]], places, self._frame[name])
            self._displacement[name].append(displacement.astype(np.float32))
        self._note_touched(state)
        self._figures.append(self._run_figures.at(state, report))

    def result(self, name: str, problem: str, steps_per_second: float) -> RunResult:
        """What was kept; nothing of a run that never began."""
        if not self._begun:
            return RunResult(name, problem, np.zeros(0), {}, {})
        names = self._figures[0] if self._figures else {}
        return RunResult(
            name=name,
            problem=problem,
            time=np.array(self._time),
            displacement={
                body: np.array(instants, np.float32).reshape(len(instants), len(self._touched[body]), 3)
                for body, instants in self._displacement.items()
            },
            figures={key: np.array([row.get(key, 0.0) for row in self._figures]) for key in names},
            touched=self._touched,
            drives=self._drives(),
            steps_per_second=steps_per_second,
        )

    def _note_touched(self, state: State) -> None:
        pressing = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal) > 0.0
        for number, body in enumerate(self._model.soft_bodies):
            mine = pressing & (state.contact_body_pair == number).any(axis=1)
            if body.name in self._touched and mine.any():
                near = cKDTree(state.position[body.nodes]).query(state.contact_point[mine])[1]
                self._touched[body.name][near] = True

    def _drives(self) -> dict[str, Any]:
        """By actuator, the key that drove it at the end, and the smallest and largest value."""
        drives, actuators = {}, self._model.actuators
        for kind in ACTUATOR_KINDS:
            place = actuators.place(kind)
            for name, number in zip(actuators.names_of(kind), range(place.start, place.stop), strict=True):
                drive = kind.coordinate if self._last.actuator_imposed[number] else kind.effort
                drives[name] = (drive.request, float(self._lowest[number]), float(self._highest[number]))
        return drives


# What drives a run of the training: a timetable, or the scene's own controller with other efforts.

DRIVES = tuple(drive.request for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate))
AXES = ("x", "y", "z")


class TimetableController(Controller):
    """Asks for what a timetable says."""

    def __init__(self, timetable: Timetable):
        """Follow `timetable`."""
        self._times = timetable.times
        self._channels: dict[str, dict[str, tuple[float, ...]]] = {}
        for channel, values in timetable.channels.items():
            key, _, name = channel.partition("/")
            self._channels.setdefault(key, {})[name] = values

    def control(self, observation: Observation) -> Control:
        """The values at the end of the step."""
        end = observation.time + observation.control_period
        request: dict[str, object] = {}
        for key, channels in self._channels.items():
            now = {name: float(np.interp(end, self._times, values)) for name, values in channels.items()}
            request[key] = now if key in DRIVES else np.array([now.get(axis, 0.0) for axis in AXES])
        return Control(**request)  # type: ignore[arg-type]


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
        request = self._controller.control(observation)
        scaled: dict[str, Any] = {
            key: {name: self._factor * value for name, value in getattr(request, key).items()}
            for key in DRIVES
            if getattr(request, key)
        }
        return replace(request, **scaled) if scaled else request


def make_run(request: TrainingRun, path: Path) -> None:
    """Make a run and write its result."""
    from taichisoft.running import Simulation, make_controller, run
    from taichisoft.scene import scene_from_toml

    class TimedSimulation(Simulation):
        """Measures the processor time of the steps [s]."""

        seconds = 0.0

        def step(self, *arguments: Any) -> Any:
            started = time.process_time()
            report = super().step(*arguments)
            self.seconds += time.process_time() - started
            return report

    kept, problem = RunInstants(request.bodies, 1, 1), ""
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
            kept = RunInstants(request.bodies, round(request.duration / scene.time.step), request.instants)
            run(simulation, controller, [kept], request.duration)
        except BeyondLaw:
            pass  # the run was completed
        except TaichisoftError as error:
            problem = " ".join(str(error).split())
    speed = simulation.state.step / simulation.seconds if simulation is not None and simulation.seconds else 0.0
    with atomic_file(path, ReductionError) as partial:
        kept.result(request.name, problem, speed).save(partial)


# Runs in several processes at a time; finished results stay in a folder and are not made again.

PREPARE = "taichisoft_reduction.training_run:prepare"
RUN_LIMIT = 3600.0
"""Longest time of a run [s]."""
ONE_THREAD = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
TRIES = 3
"""How often a run is begun whose process is killed."""
NOW, LATER = 0.0, 1e9
"""Ranks of runs that are waited for, and of runs that fill the processes meanwhile."""


class Progress:
    """What a reduction reports; this one reports nothing."""

    def runs(self, title: str, cost: float) -> Callable[[float], None]:
        """Begin to wait for runs of a total cost; the function returned is called with the cost of each that ends."""
        return lambda cost: None

    def line(self, text: str) -> None:
        """Report a line."""


class TrainingRuns:
    """Processes that make runs; leaving a `with` statement ends them."""

    def __init__(self, folder: Path, processes: int, plugins: Sequence[str], progress: Progress):
        """Keep the results in `folder`, load `plugins`, paths, into each process, and report to `progress`."""
        self._folder, self._plugins, self._progress = folder, tuple(plugins), progress
        self._pool = Pool(PREPARE, processes, ONE_THREAD, TRIES)
        self._pending: set[Path] = set()

    def __enter__(self) -> "TrainingRuns":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.__exit__()

    def start(self, requests: Sequence[TrainingRun], rank: float = LATER) -> None:
        """Have runs made that are not in the folder, long ones first, while none of a lower rank waits."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for request in sorted(requests, key=lambda request: -request.cost):
            path = self._folder / request.file_name
            if path not in self._pending and RunResult.load(path) is None:
                self._pending.add(path)
                self._pool.submit(path, (request, path), self._plugins, RUN_LIMIT, rank - request.cost)

    def results(self, requests: Sequence[TrainingRun], title: str) -> list[RunResult]:
        """The results of runs, in the order of the requests, which are waited for under a title."""
        self.start(requests, NOW)
        paths = [self._folder / request.file_name for request in requests]
        awaited = {path: request.cost for path, request in zip(paths, requests, strict=True) if path in self._pending}
        count = self._progress.runs(title, sum(awaited.values()))
        while awaited:
            path, problem = self._pool.next_done()
            if isinstance(problem, Exception):
                raise ReductionError(f"a process that makes runs failed: {problem}") from problem
            self._pending.remove(path)
            if path in awaited:
                count(awaited.pop(path))
        return [_loaded(path) for path in paths]


def _loaded(path: Path) -> RunResult:
    result = RunResult.load(path)
    if result is None:
        raise ReductionError(f"{path}: cannot be read; remove it and try again")
    return result


def prepare(plugins: Sequence[str]) -> Callable[[tuple[TrainingRun, Path]], None]:
    """What a process does: it loads Taichi and plug-ins, and makes runs."""
    from taichisoft.running import (
        Simulation,  # noqa: F401  # starts Taichi
        load_plugin,
        plugin_registry,
    )

    plugin_registry()
    for plugin in plugins:
        load_plugin(plugin)
    return lambda job: make_run(*job)
