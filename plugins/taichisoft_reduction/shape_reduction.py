"""The whole way from a scene to reduced models of its soft bodies: training, fit, refinement, validation."""

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft import Model, Scene, make_model
from taichisoft.base import Link, Worker, WorkerLost
from taichisoft.errors import TaichisoftError
from taichisoft.scene import scene_from_toml, scene_to_toml
from taichisoft_reduction.body_shapes import BodyShape, RelativeMotion, body_shapes, shape_key
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.shape_fit import displacements_of
from taichisoft_reduction.training_plan import Ranges, TrainingPlan, actuator_ranges
from taichisoft_reduction.training_run import NOW, ONE_THREAD, Progress, RunResult, TrainingRun, TrainingRuns
from taichisoft_reduction.validation import (
    Comparison,
    as_tables,
    compare,
    draw_report,
    error_per_imbalance,
    largest_imbalance,
    verdict,
    worst,
    write_report,
)

if TYPE_CHECKING:
    from taichisoft.mechanics import SoftBody

# Displacements from recordings that a user gives for the training.

MOST_INSTANTS = 200
"""Instants that are taken of a recording."""


def recorded_runs(paths: Sequence[Path], shapes: Sequence[BodyShape], scene: Scene) -> list[RunResult]:
    """The runs in recordings; the bodies of another scene count as well where they have the same mesh and material."""
    from taichisoft_outputs.recording.reader import read_recording

    keys = {shape_key(scene.soft_bodies[shape.name]): shape.name for shape in shapes}
    results = []
    for path in paths:
        with read_recording(path) as recording:
            instants = np.unique(np.linspace(0, recording.instant_count - 1, MOST_INSTANTS).astype(int))
            displacement: dict[str, list[np.ndarray]] = {}
            for body in recording.soft_bodies:
                settings = recording.scene.soft_bodies[body.name]
                name = keys.get(shape_key(settings))
                if name is None:
                    continue
                carrier = recording.frames.names.index(settings.follows)
                motion = RelativeMotion(body.mesh_nodes, settings.rotation, settings.translation)
                for instant in instants:
                    places = recording.frames.places(recording.row("frame_pose", instant))
                    position = recording.row("position", instant)[body.nodes]
                    displacement.setdefault(name, []).append(motion.displacement(position, places, carrier))
            if not displacement:
                names = ", ".join(shape.name for shape in shapes)
                raise ReductionError(
                    f"--runs {path}: no soft body has the mesh and material of {names}; record this scene"
                )
            arrays = {name: np.array(rows) for name, rows in displacement.items()}
            results.append(RunResult(str(path), "", np.zeros(0), arrays, {}))
    return results


# A fit in a process of its own, whose linear algebra has one thread: its sums and choices are always the same.

LONGEST = 7200.0
"""Longest time of a choice of domains [s]."""


class FitProcess:
    """A `ShapeFit` elsewhere; leaving a `with` statement ends its process.

    Attributes:
        mode_count: number of modes that are used.
        domain_count: number of all domains.
        chosen_count: number of the chosen ones, after `choose`.
    """

    def __init__(
        self,
        body: "SoftBody",
        shape: BodyShape,
        displacements: Sequence[np.ndarray],
        tolerance: float,
        modes: int | None,
        lag: float,
    ):
        """Find the modes; arguments and errors are those of `ShapeFit`."""
        self._worker = Worker("taichisoft_reduction.shape_reduction:serve_fit", ONE_THREAD)
        try:
            self._ask((body, shape, list(displacements), tolerance, modes, lag))
        except BaseException:
            self._worker.end()
            raise

    def __enter__(self) -> "FitProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self._worker.end()

    def use_modes(self, count: int) -> None:
        """See `ShapeFit.use_modes`."""
        self._ask(("use_modes", (count,), {}))

    def choose(self, part: float = 1.0) -> None:
        """See `ShapeFit.choose`."""
        self._ask(("choose", (part,), {}))

    def write(self, path: Path, **validated: Any) -> None:
        """See `ShapeFit.write`."""
        self._ask(("write", (path,), validated))

    def _ask(self, message: Any) -> None:
        try:
            self.mode_count, self.domain_count, self.chosen_count = self._worker.ask(message, LONGEST)
        except (TaichisoftError, WorkerLost) as error:
            raise ReductionError(str(error)) from error


def serve_fit(link: Link) -> None:
    """Make a fit of the arguments that come first, and call its methods with those of the messages after them."""
    from taichisoft_reduction.shape_fit import ShapeFit

    fit = ShapeFit(*link.receive())
    while True:
        link.send((fit.mode_count, fit.domain_count, 0 if fit.cubature is None else len(fit.cubature.domain)))
        method, arguments, named = link.receive()
        getattr(fit, method)(*arguments, **named)


RUNS = "runs"
"""Folder of the runs of training and validation, which a later try need not make again."""
ATTEMPTS = 3
"""How often domains are chosen until the motions of the training are followed within the tolerance."""
FAILED = 1.0
"""Error that a file says where a run of the validation failed: as large as the displacements."""
FOLLOWED = ("ramp", "wave", "press-0", "press-1", "turned-0.6")
"""Runs of the training, of a body alone, that modes have to follow with all domains and with the chosen ones: where
silicone hardly changes its volume, modes that hold its displacements to the tolerance may lock."""
STRICTER, LEAST = 0.9, 0.5
"""Factors on the error allowed to the domains from one try to the next, the largest and the smallest."""
WORTH = 0.75
"""Factor to which more domains have to reduce the error of the motion; otherwise it comes from elsewhere."""


@dataclass(frozen=True)
class Wishes:
    """What the user asks for.

    Attributes:
        tolerance: largest error of a position over the largest displacement [-].
        modes: number of modes of each body; None: as many as the tolerance needs.
        recordings: recordings of the user's own runs.
        own_training: whether runs are made for the training.
        ranges: smallest and largest value by "body.actuator", instead of what the scene's own run says.
        full_range: whether actuators go to the limits of the scene.
        processes: runs at a time.
        plugins: paths of plug-ins that the scene needs.
    """

    tolerance: float = 0.005
    modes: int | None = None
    recordings: Sequence[Path] = ()
    own_training: bool = True
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    full_range: bool = False
    processes: int = 1
    plugins: Sequence[str] = ()


@dataclass(frozen=True)
class Reduction:
    """What came out.

    Attributes:
        files: the file of each shape, by its name.
        comparisons: runs of the validation.
        verdict: "within the tolerance" or "above the tolerance".
        error: largest error of a position over the largest displacement [-].
    """

    files: Mapping[str, Path]
    comparisons: Sequence[Comparison]
    verdict: str
    error: float


def reduce_scene(scene: Scene, folder: Path, wishes: Wishes, progress: Progress) -> Reduction:
    """Make the reduced models of a scene's anchored soft bodies, and validate them."""
    started = time.perf_counter()
    model = make_model(scene)
    shapes = _shapes(scene)
    _check_ranges(model, wishes.ranges)
    recordings = recorded_runs(wishes.recordings, shapes, scene)
    plan = TrainingPlan(scene, model, shapes, wishes.plugins)
    with ExitStack() as processes, TrainingRuns(folder / RUNS, wishes.processes, wishes.plugins, progress) as pool:
        own_runs = plan.own_runs()
        pool.start(own_runs, NOW)
        pool.start(plan.grasps(wishes.own_training))
        own = pool.results(own_runs, "own run")
        ranges = {
            shape.name: actuator_ranges(model, shape, own[0] if own else None, wishes.ranges, wishes.full_range)
            for shape in shapes
        }
        _say_ranges(ranges, progress)
        training, trained, validation = _train(plan, pool, own, ranges, wishes, progress)
        far = plan.beyond(ranges)
        pool.start([*validation, *far])
        fits, tried = {}, {}
        for shape in shapes:
            body = next(candidate for candidate in model.soft_bodies if candidate.name == shape.name)
            snapshots = displacements_of(shape, [*recordings, *(trained if wishes.own_training else [])])
            lag = scene.time.step + body.settings.rayleigh_stiffness
            fit = FitProcess(body, shape, snapshots, wishes.tolerance, wishes.modes, lag)
            fits[shape.name] = processes.enter_context(fit)
            known = list(zip(training, trained, strict=True))
            tried[shape.name] = _refine(fits[shape.name], shape, folder, pool, known, wishes, progress)
        full = pool.results(validation, "validation of the full model")
        files = {name: folder / f"{name}.npz" for name in fits}
        reduced = _reduced_runs(pool, validation, shapes, files, "validation of the reduced model")
        comparisons = [compare(whole, other) for whole, other in zip(full, reduced, strict=True)]
        beyond = pool.results(far, "beyond the training")
        erring = _reduced_runs(pool, far, shapes, files, "the reduced model beyond its training")
        about = {
            "scene": scene.title,
            "bodies": {shape.name: _about(fits[shape.name], shape, files[shape.name]) for shape in shapes},
            "seconds": time.perf_counter() - started,
        }
        tables = as_tables(comparisons, wishes.tolerance, about)
        pairs = [
            pair
            for pair in zip([*full, *beyond], [*reduced, *erring], strict=True)
            if not any(result.problem for result in pair)
        ]
        for shape in shapes:
            fits[shape.name].write(
                files[shape.name],
                report=json.dumps(tables),
                error=min(worst(comparisons), FAILED),
                imbalance=max(largest_imbalance(result, shape.bodies) for result in reduced),
                error_per_imbalance=error_per_imbalance([*pairs, *tried[shape.name]], shape.bodies),
                # Recordings do not say where bodies were pressed, nor how they were driven.
                pressed=None if recordings else _pressed(shape, [*own, *trained]),
                drives="{}" if recordings else json.dumps(_drives(shape, [*own, *trained])),
            )
    write_report(folder, comparisons, tables)
    draw_report(folder, full, reduced)
    return Reduction(files, comparisons, verdict(comparisons, wishes.tolerance), worst(comparisons))


def _pressed(shape: BodyShape, results: Sequence[RunResult]) -> np.ndarray | None:
    """Whether something pressed a node in any of some runs, shape (node_count,)."""
    good = [result.touched for result in results if not result.problem]
    touched = [nodes[name] for nodes in good for name in shape.bodies if name in nodes]
    return np.any(touched, axis=0) if touched else None


def _drives(shape: BodyShape, results: Sequence[RunResult]) -> dict[str, tuple[str, float, float]]:
    """By actuator, without the body's name, the key that drove it in some runs, and its smallest and largest value."""
    drives: dict[str, tuple[str, float, float]] = {}
    for result in results:
        for name, (key, low, high) in {} if result.problem else result.drives.items():
            body, _, actuator = name.partition(".")
            if body in shape.bodies and low < high:
                before = drives.get(actuator, (key, low, high))
                if before[0] == key:
                    drives[actuator] = key, min(low, before[1]), max(high, before[2])
    return drives


def _shapes(scene: Scene) -> list[BodyShape]:
    shapes = body_shapes(scene)
    if not shapes:
        bodies = ", ".join(scene.soft_bodies) or "none"
        raise ReductionError(
            f"no soft body of the scene has anchors (soft bodies: {bodies}); modes move a body relative to its anchors"
        )
    for shape in shapes:
        settings = scene.soft_bodies[shape.name]
        if settings.corotation != "polar":
            key = f'soft_bodies.{shape.name}.corotation = "{settings.corotation}"'
            raise ReductionError(f'{key}: must be "polar" to be reduced')
        if settings.membranes or settings.fibres or settings.springs:
            raise ReductionError(
                f"soft_bodies.{shape.name}: a body with membranes, fibres or springs cannot be reduced"
            )
        for name in shape.bodies:
            frame, anchors = scene.soft_bodies[name].follows, scene.soft_bodies[name].anchors
            if any(anchor.follows not in (None, frame) for anchor in anchors):
                raise ReductionError(
                    f"soft_bodies.{name}: its anchors follow other frames than the body ('{frame}'), and modes follow "
                    "that alone; remove their `follows`"
                )
        if getattr(settings, "reduced", None):
            raise ReductionError(f"soft_bodies.{shape.name}.reduced: the scene is reduced already; remove the key")
    return shapes


def _check_ranges(model: Model, ranges: Mapping[str, tuple[float, float]]) -> None:
    for name in ranges:
        if name not in model.actuators.names:
            known = ", ".join(model.actuators.names) or "none"
            raise ReductionError(f"--range {name}: the scene has no such actuator; it has: {known}")


def _say_ranges(ranges: Mapping[str, Ranges], progress: Progress) -> None:
    for shape in ranges.values():
        for name, (key, low, high) in shape.items():
            progress.line(f"{name}: trained from {low:g} to {high:g} ({key})")


def _train(
    plan: TrainingPlan,
    pool: TrainingRuns,
    own: Sequence[RunResult],
    ranges: Mapping[str, Ranges],
    wishes: Wishes,
    progress: Progress,
) -> tuple[list[TrainingRun], list[RunResult], list[TrainingRun]]:
    """Requests and results of the training, and requests of the validation."""
    first = plan.first_runs(ranges)
    ramps = pool.results(first, "ramps")
    driven = [shape.name for shape in plan.shapes if ranges[shape.name]]
    by_shape = dict(zip(driven, ramps, strict=True))
    training = plan.training(ranges, by_shape, own) if wishes.own_training else first
    validation = plan.validation(ranges, by_shape, own)
    results = pool.results(training, "training")
    for result in results:
        if result.problem:
            progress.line(f"{result.name}: left out of the training: {result.problem}")
    return training, results, validation


def _refine(
    fit: FitProcess,
    shape: BodyShape,
    folder: Path,
    pool: TrainingRuns,
    training: Sequence[tuple[TrainingRun, RunResult]],
    wishes: Wishes,
    progress: Progress,
) -> list[tuple[RunResult, RunResult]]:
    """Add modes, then choose domains again, where motions of the training are not followed within the tolerance.

    Returns:
        Runs of the training beside those of the model that was chosen last.
    """
    known = {
        request.name.removeprefix(f"{shape.name}-"): (request, result)
        for request, result in training
        if not result.problem
    }
    path = folder / f"{shape.name}.npz"

    def tried(title: str) -> tuple[list[tuple[RunResult, RunResult]], float]:
        fit.write(path)
        runs = [known[name] for name in FOLLOWED if name in known]
        again = _reduced_runs(pool, [request for request, _ in runs], [shape], {shape.name: path}, title)
        pairs = [(full, repeated) for (_, full), repeated in zip(runs, again, strict=True)]
        error = worst([compare(*pair) for pair in pairs]) if pairs else 0.0
        progress.line(f"{title}; error of the training {100.0 * error:.2g} %")
        return pairs, error

    def is_followed() -> bool:
        title = f"{shape.name}: {fit.mode_count} modes with all {fit.domain_count} domains"
        return tried(title)[1] <= wishes.tolerance

    if wishes.modes is None:
        find_mode_count(fit, is_followed)
    pairs: list[tuple[RunResult, RunResult]] = []
    part, before, count = 1.0, math.inf, 0
    for _ in range(ATTEMPTS):
        fit.choose(part)
        if fit.chosen_count == count:  # all that matter are chosen
            break
        count = fit.chosen_count
        pairs, error = tried(f"{shape.name}: {fit.mode_count} modes, {count} of {fit.domain_count} domains")
        if error <= wishes.tolerance or error > WORTH * before:
            break
        part, before = part * min(STRICTER, max(LEAST, STRICTER * wishes.tolerance / error)), error
    return pairs


def find_mode_count(fit: FitProcess, is_followed: Callable[[], bool]) -> None:
    """Use half as many modes again until the motions are followed, then half of those that came last if these do."""
    too_few = 0
    for _ in range(ATTEMPTS - 1):
        if is_followed():
            break
        too_few = fit.mode_count
        fit.use_modes(too_few + too_few // 2 + 1)
    else:
        if not is_followed():
            return
    enough = fit.mode_count
    if 0 < too_few < enough - 1:
        fit.use_modes((too_few + enough) // 2)
        if not is_followed():
            fit.use_modes(enough)


def _reduced_runs(
    pool: TrainingRuns,
    requests: Sequence[TrainingRun],
    shapes: Sequence[BodyShape],
    files: Mapping[str, Path],
    title: str,
) -> list[RunResult]:
    """The results of runs with reduced bodies."""
    reduced = [_with_modes(request, shapes, files) for request in requests]
    return pool.results(reduced, title)


def _with_modes(request: TrainingRun, shapes: Sequence[BodyShape], files: Mapping[str, Path]) -> TrainingRun:
    scene = scene_from_toml(request.scene, request.name)
    bodies = dict(scene.soft_bodies)
    digest = hashlib.sha256(request.files.encode())
    for shape in shapes:
        digest.update(files[shape.name].read_bytes())
        for name in set(shape.bodies) & set(bodies):
            bodies[name] = bodies[name].model_copy(update={"reduced": str(files[shape.name].resolve())})
    text = scene_to_toml(scene.model_copy(update={"soft_bodies": bodies}))
    return replace(request, name=f"{request.name}-reduced", scene=text, files=digest.hexdigest())


def _about(fit: FitProcess, shape: BodyShape, path: Path) -> dict[str, Any]:
    return {
        "bodies": list(shape.bodies),
        "file": path.name,
        "modes": fit.mode_count,
        "domains": fit.chosen_count,
        "all_domains": fit.domain_count,
    }
