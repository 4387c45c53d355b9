"""Trials of an optimisation: their runs, objectives and winners."""

import csv
import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichisoft.base import atomic_file
from taichisoft.errors import MeshError
from taichisoft.mechanics import valid_stretch
from taichisoft.scene import scene_from_toml
from taichisoft_meshing.geometry_file import is_geometry, read_tables
from taichisoft_meshing.mesh_job import MeshJob, merge_tables
from taichisoft_meshing.mould_parts import write_mould_apart
from taichisoft_studies.errors import StudyError
from taichisoft_studies.optimiser import (
    AGAIN,
    JOURNAL,
    LOST,
    OWNER,
    PARAMETERS,
    STATUS,
    VIOLATIONS,
    Optimisation,
    best_trials,
    counted,
    is_function,
    nearest_trial,
    suggest,
)
from taichisoft_studies.results_table import result_row
from taichisoft_studies.run_job import BEYOND_LAW, COMPLETED, ERROR, PRUNED, RunJob, is_gone, owner, read_record
from taichisoft_studies.study_file import Expression
from taichisoft_studies.sweep_runs import RUNS, job_for, make_missing
from taichisoft_studies.workers import Workers

# The runs of a trial: one, or one of each scene of the optimisation; to objectives and tables they are one record.

RUNS_OF_TRIAL = "runs"
"""What is noted at a trial: the names of its runs by scene."""


@dataclass(frozen=True)
class TrialRuns:
    """The jobs of a trial, and what has come of them so far.

    Attributes:
        jobs: by the name of the scene, which is empty where there is a single one.
        records: of the runs that have ended, likewise.
    """

    jobs: Mapping[str, RunJob]
    records: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def record(self) -> dict[str, Any]:
        """The record of the trial, when all its runs have ended."""
        return joined({scene: self.records[scene] for scene in self.jobs})

    @property
    def place(self) -> Path | dict[str, Path]:
        """The folder of the run, or of each run by the name of its scene."""
        places = {scene: job.place for scene, job in self.jobs.items()}
        return places.get("", places)


def trial_runs(study: Optimisation, parameters: Mapping[str, Any], folder: Path, **others: Any) -> TrialRuns:
    """The runs of a trial with these values; the arguments as for `sweep_runs.job_for`."""
    by_scene = study.by_scene().items()
    return TrialRuns({scene: job_for(own, parameters, folder, study.seed, **others) for scene, own in by_scene})


def joined(records: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """One record of the records by scene: the metrics by scene, and the status of the run that went worst."""
    if "" in records:
        return dict(records[""])
    ranks = {COMPLETED: 2, BEYOND_LAW: 1}
    scene, worst = min(records.items(), key=lambda item: ranks.get(item[1]["status"], 0))
    return {
        "run": "+".join(record["run"] for record in records.values()),
        "parameters": worst["parameters"],
        "seed": worst["seed"],
        "status": worst["status"],
        "message": f"{scene}: {worst['message']}" if worst["message"] else "",
        "metrics": {scene: record["metrics"] for scene, record in records.items()},
    }


# The objectives and constraints of a run: expressions of its metrics, or functions of a plug-in.

Figure = Callable[[Mapping[str, Any], Any], float]
"""From the record of a trial and its run's folder (of several runs: the folders by scene) to a number."""


def figures(study: Optimisation) -> dict[str, Figure]:
    """The objectives by name."""
    named = study.objectives.items()
    return {name: _figure(objective.text, f"objectives.{name}.{objective.key}") for name, objective in named}


def violations(study: Optimisation) -> dict[str, Figure]:
    """By how much each constraint is missed: not positive where it holds."""
    expressions = {name: Expression(text, f"constraints.{name}") for name, text in study.constraints.items()}

    def of(expression: Expression) -> Figure:
        return lambda record, folder: expression.violation(named_values(record))

    return {name: of(expression) for name, expression in expressions.items()}


def named_values(record: Mapping[str, Any]) -> dict[str, Any]:
    """The names in an expression about a trial: its metrics (of several runs, by scene), and `parameters["KEY"]`."""
    return {**record["metrics"], PARAMETERS: record["parameters"]}


def _figure(text: str, key: str) -> Figure:
    if is_function(text):
        return _function(text, key)
    expression = Expression(text, key)
    return lambda record, folder: expression(named_values(record))


def _function(text: str, key: str) -> Figure:
    """A function of a Python file, called with parameters, metrics and folder of the run (of several: by scene)."""
    file, _, name = text.rpartition(":")
    spec = importlib.util.spec_from_file_location(Path(file).stem, file)
    if spec is None or spec.loader is None or not Path(file).is_file():
        raise StudyError(f"{key} = {text!r}: no such file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        function = getattr(module, name)
    except Exception as error:
        raise StudyError(f"{key} = {text!r}: cannot be loaded: {type(error).__name__}: {error}") from error

    def call(record: Mapping[str, Any], folder: Any) -> float:
        try:
            value = float(function(record["parameters"], record["metrics"], folder))
        except Exception as error:
            raise StudyError(f"{key} = {text!r}: {type(error).__name__}: {error}") from error
        if not math.isfinite(value):
            raise StudyError(f"{key} = {text!r}: gave {value}, no finite number")
        return value

    return call


def claim_trial(trial: Any) -> None:
    """Note that this process makes the trial."""
    trial.set_user_attr(OWNER, owner())


def take_over_abandoned(study: Any) -> int:
    """Put the trials back into the queue whose process on this machine is gone; returns how many there were."""
    from optuna.trial import TrialState

    abandoned = [
        trial for trial in study.get_trials(states=(TrialState.RUNNING,)) if is_gone(trial.user_attrs.get(OWNER, ""))
    ]
    for trial in abandoned:
        study._storage.set_trial_user_attr(trial._trial_id, LOST, True)
        study.tell(trial.number, state=TrialState.FAIL)
        if trial.params:
            study.enqueue_trial(trial.params)
    return len(abandoned)


def take_over_errors(study: Any) -> int:
    """Put the trials back into the queue whose run ended with an error, see `run_job.finished`; returns how many."""
    from optuna.trial import TrialState

    before = study.user_attrs.get(AGAIN, [])
    ended = study.get_trials(deepcopy=False, states=(TrialState.FAIL,))
    failed = [trial for trial in ended if trial.user_attrs.get(STATUS) == ERROR and trial.number not in before]
    study.set_user_attr(AGAIN, [*before, *(trial.number for trial in failed)])
    for trial in failed:
        study.enqueue_trial(trial.params)
    return len(failed)


# The loop of an optimisation: Optuna proposes values, workers make the runs, and Optuna gets the results.

MESSAGE = "message"


def run_trials(
    study: Optimisation,
    folder: Path,
    trials: Any,
    workers: Workers,
    done: Callable[[Any, Mapping[str, Any]], None],
    make: Callable[[Mapping[str, Any]], TrialRuns] | None = None,
) -> None:
    """Make trials until there are `study.trials` of them.

    A trial whose run fails, such as one whose geometry cannot be meshed, is a failed trial, and the others go on.

    Args:
        study: the file.
        folder: folder of the optimisation.
        trials: Optuna's study, see `optimiser.open_study`.
        workers: make the runs, `count` at a time.
        done: called with each trial and the record of its run.
        make: gives the runs of a trial with values; those of the study's scenes without it.
    """
    objectives, limits = figures(study), violations(study)
    running: dict[str, tuple[Any, str, TrialRuns]] = {}
    while True:
        while len(running) < workers.count and len(counted(trials)) < study.trials:
            trial = trials.ask()
            claim_trial(trial)
            values = suggest(trial, study.variables)
            runs = make(values) if make else trial_runs(study, values, folder, pruning=_pruning(study, folder, trial))
            trial.set_user_attr(RUNS_OF_TRIAL, {scene: job.name for scene, job in runs.jobs.items()})
            for scene, job in runs.jobs.items():
                key = f"trial-{trial.number} {scene}".rstrip()
                running[key] = trial, scene, runs
                workers.submit(key, job)
        if not running:
            return
        key, record = workers.next_done()
        trial, scene, runs = running.pop(key)
        runs.records[scene] = record
        if len(runs.records) == len(runs.jobs):
            _tell(study, trials, trial, runs.record, runs.place, objectives, limits)
            done(trial, runs.record)


def trial_rows(study: Optimisation, trials: Any) -> list[dict[str, Any]]:
    """A row of the table for each trial that has ended: values, metrics, objectives, what misses the constraints."""
    rows = []
    for trial in counted(trials):
        folder, runs = Path(trials.user_attrs["folder"]) / RUNS, trial.user_attrs.get(RUNS_OF_TRIAL, {})
        known = {scene: read_record(folder / name) for scene, name in runs.items()}
        records = {scene: record for scene, record in known.items() if record is not None}
        if not trial.state.is_finished() or not runs or len(records) < len(runs):
            continue
        record = joined(records)
        values = dict(zip(study.objectives, trial.values or (), strict=False))
        missed = dict(zip(study.constraints, trial.user_attrs.get(VIOLATIONS, ()), strict=False))
        rows.append(
            {
                **result_row(record, f"{RUNS}/{next(iter(runs.values()))}"),
                "metrics.trial": trial.number,
                **{f"metrics.objectives.{name}": value for name, value in values.items()},
                **{f"metrics.violations.{name}": value for name, value in missed.items()},
            }
        )
    return rows


def accepted(study: Optimisation, record: Mapping[str, Any]) -> bool:
    """Whether the figures of a run count: it completed, or went beyond the law of a body where that is allowed."""
    return record["status"] == COMPLETED or (study.beyond_the_law and record["status"] == BEYOND_LAW)


def _pruning(study: Optimisation, folder: Path, trial: Any) -> dict[str, Any] | None:
    """The settings of `run_job.PruningOutput`."""
    if study.pruning is None:
        return None
    (objective,) = study.objectives.values()
    return {
        **study.pruning.model_dump(),
        "journal": str((folder / JOURNAL).resolve()),
        "trial": trial._trial_id,
        "objective": objective.text,
    }


def _tell(
    study: Optimisation,
    trials: Any,
    trial: Any,
    record: Mapping[str, Any],
    place: Any,
    objectives: Mapping[str, Figure],
    limits: Mapping[str, Figure],
) -> None:
    from optuna.trial import TrialState

    trial.set_user_attr(STATUS, record["status"])
    trial.set_user_attr(MESSAGE, record["message"])
    if accepted(study, record):
        try:
            values = [figure(record, place) for figure in objectives.values()]
            missed = {name: figure(record, place) for name, figure in limits.items()}
        except StudyError as error:
            trial.set_user_attr(MESSAGE, str(error))
            trials.tell(trial, state=TrialState.FAIL)
            if not trials.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
                raise  # it is the expression that is wrong, not this run
            return
        trial.set_user_attr(VIOLATIONS, list(missed.values()))
        for name, value in missed.items():
            trial.set_constraint(name, value)
        trials.tell(trial, values)
    else:
        trials.tell(trial, state=TrialState.PRUNED if record["status"] == PRUNED else TrialState.FAIL)


# The winners of an optimisation: run again on a finer mesh, and drawn as parts that can be made.

WINNERS, STRETCH = "winners.csv", "largest stretch over that of the law"


def _nearest(study: Optimisation, trials: Any) -> str:
    """The trial that misses the constraints by the least, and by how much, in words."""
    trial = nearest_trial(trials)
    if trial is None:
        return "results.csv says why"
    missed = zip(study.constraints.items(), trial.user_attrs[VIOLATIONS], strict=True)
    by = ", ".join(f"{name} ({text}) by {value:.4g}" for (name, text), value in missed if value > 0.0)
    values = value_line(study.objectives, trial.values)
    return f"trial {trial.number} is the nearest: {values}, and it misses {by}"


def make_winners(
    study: Optimisation,
    trials: Any,
    output: Path,
    workers: Workers,
    say: Callable[[str], None],
    made: Callable[[RunJob, Mapping[str, Any]], None] = lambda *_: None,
) -> list[RunJob]:
    """Run the best trials again with the changes of `finer`, recorded, and write `winners.csv`.

    It has their objectives, by how much they miss each constraint (negative where it holds), both on the finer mesh too
    where there is one, and `stretch_over_law`.

    Args:
        study: the file.
        trials: Optuna's study, see `optimiser.open_study`.
        output: folder of the optimisation.
        workers: make the runs.
        say: called with each line about a winner.
        made: called with each run that was made, and its record.

    Returns:
        The run of each winner, of several scenes the first; the best winner first.
    """
    best = best_trials(trials, study.winners)
    if not best:
        raise StudyError(f"{output}: no trial has completed and satisfies all constraints; {_nearest(study, trials)}")
    outputs = tuple(dict.fromkeys((*study.outputs, "recording")))
    again = study.model_copy(update={"set": (*study.set, *study.finer), "outputs": outputs})
    winners = []
    for trial in best:
        record = read_record(output / RUNS / next(iter(trial.user_attrs[RUNS_OF_TRIAL].values())))
        assert record is not None
        winners.append(trial_runs(again, record["parameters"], output))
    unique = {job.name: job for runs in winners for job in runs.jobs.values()}
    records = {record["run"]: record for record in make_missing(list(unique.values()), workers, made)}
    known = {**figures(study), **{f"{name} missed by": figure for name, figure in violations(study).items()}}
    finer = [f"{name} finer" for name in known] if study.finer else []
    rows: list[list[Any]] = [["trial", *study.variables, *known, *finer, STRETCH, "status", "folder"]]
    for trial, runs in zip(best, winners, strict=True):
        runs.records.update({scene: records[job.name] for scene, job in runs.jobs.items()})
        record, first = runs.record, next(iter(runs.jobs.values()))
        coarse: list[Any] = [*trial.values, *trial.user_attrs[VIOLATIONS]]
        say(f"best: trial {trial.number}: {_result_line(study, coarse)}")
        values: list[Any] = [""] * len(finer)
        if not accepted(study, record):
            say(f"  made again: {record['status']}: {record['message']}")
        elif finer:
            values = [figure(record, runs.place) for figure in known.values()]
            say(f"  on the finer mesh: {_result_line(study, values)}")
        over = stretch_over_law(runs)
        if over > 1.0:
            say(f"  stretched to {over:.3g} times that up to which its law holds: beyond it, forces are not realistic")
        for key, value in first.parameters.items():
            say(f"  {key} = {value}")
        folders = " ".join(f"{RUNS}/{job.name}" for job in runs.jobs.values())
        rows.append([trial.number, *first.parameters.values(), *coarse, *values, over, record["status"], folders])
    with atomic_file(output / WINNERS, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)
    return [next(iter(runs.jobs.values())) for runs in winners]


def stretch_over_law(runs: TrialRuns) -> float:
    """Largest stretch of a body in the runs of a trial, over that up to which its law holds [-]; 0 of laws without."""
    shares = [0.0]
    for scene, job in runs.jobs.items():
        bodies = scene_from_toml(job.scene, job.source).soft_bodies
        largest = runs.records[scene]["metrics"].get("largest_stretch", {})
        shares += [stretch / valid_stretch(bodies[name])[0] for name, stretch in largest.items()]
    return max(shares)


def draw_winner(job: RunJob, folder: Path) -> list[str]:
    """Write the mould of every soft body that is meshed from a geometry file, a folder for each.

    Returns:
        A line for each body: the folder of its parts, or the reason why there are none.
    """
    lines = []
    for name, body in scene_from_toml(job.scene, job.source).soft_bodies.items():
        file = Path(body.mesh.file)
        if is_geometry(body.mesh.file):
            kind, tables = read_tables(file)
            try:
                (folder / name).mkdir(parents=True, exist_ok=True)
                changed = merge_tables(tables, body.mesh.request.get("set", {}))
                write_mould_apart(MeshJob(kind, changed, file, {}), folder / name, {})
                lines.append(f"{name}: mould in {folder / name}; `taichisoft mould check` checks it")
            except MeshError as error:
                lines.append(f"{name}: no mould: {error}")
    return lines


def _result_line(study: Optimisation, values: Sequence[float]) -> str:
    """The objectives of a trial, then by how much each constraint holds."""
    count = len(study.objectives)
    margins = zip(study.constraints, values[count:], strict=True)
    held = (f"{name} {'missed' if value > 0.0 else 'holds'} by {abs(value):.4g}" for name, value in margins)
    return "; ".join([value_line(study.objectives, values[:count]), *held])


def value_line(names: Mapping[str, Any], values: Sequence[float]) -> str:
    """The objectives of a trial in one line."""
    return ", ".join(f"{name} {value:.6g}" for name, value in zip(names, values, strict=True))
