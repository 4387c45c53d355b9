"""The loop of an optimisation: Optuna proposes values, workers make the runs, and Optuna gets the results."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from taichisoft_studies.errors import StudyError
from taichisoft_studies.objectives import Figure, figures, violations
from taichisoft_studies.optimisation_file import Optimisation
from taichisoft_studies.optimiser import JOURNAL, STATUS, VIOLATIONS, claim_trial, counted, suggest
from taichisoft_studies.results_table import result_row
from taichisoft_studies.run_folder import BEYOND_LAW, COMPLETED, PRUNED, read_record
from taichisoft_studies.sweep_runs import RUNS, checked_record
from taichisoft_studies.trial_runs import RUNS_OF_TRIAL, TrialRuns, joined, trial_runs
from taichisoft_studies.worker_task import do_run
from taichisoft_studies.workers import Workers

MESSAGE = "message"


def optimise(
    study: Optimisation,
    folder: Path,
    trials: Any,
    workers: Workers,
    done: Callable[[Any, Mapping[str, Any]], None],
) -> None:
    """Make trials until there are `study.trials` of them.

    A trial whose run fails, such as one whose geometry cannot be meshed, is a failed trial, and the others go on.

    Args:
        study: the file.
        folder: folder of the optimisation.
        trials: Optuna's study, see `optimiser.open_study`.
        workers: make the runs, `count` at a time.
        done: called with each trial and the record of its run.

    Raises:
        StudyError, SceneError: a key is not valid, or an expression cannot be computed of the first run that completes.
    """
    wanted, limits = figures(study), violations(study)
    running: dict[str, tuple[Any, str, TrialRuns]] = {}
    while True:
        while len(running) < workers.count and len(counted(trials)) < study.trials:
            trial = trials.ask()
            claim_trial(trial)
            runs = trial_runs(study, suggest(trial, study.variables), folder, pruning=_pruning(study, folder, trial))
            trial.set_user_attr(RUNS_OF_TRIAL, {scene: job.name for scene, job in runs.jobs.items()})
            for scene, job in runs.jobs.items():
                key = f"trial-{trial.number} {scene}".rstrip()
                running[key] = trial, scene, runs
                workers.submit(key, do_run, job.to_json())
        if not running:
            return
        key, answer = workers.next_done()
        trial, scene, runs = running.pop(key)
        runs.records[scene] = checked_record(runs.jobs[scene], answer)
        if len(runs.records) == len(runs.jobs):
            _tell(study, trials, trial, runs.record, runs.place, wanted, limits)
            done(trial, runs.record)


def trial_rows(study: Optimisation, trials: Any) -> list[dict[str, Any]]:
    """A row of the table for each trial that has ended: values, metrics, objectives, what misses the constraints."""
    rows = []
    for trial in counted(trials):
        folder, runs = Path(trials.user_attrs["folder"]) / RUNS, trial.user_attrs.get(RUNS_OF_TRIAL, {})
        found = {scene: read_record(folder / name) for scene, name in runs.items()}
        records = {scene: one for scene, one in found.items() if one is not None}
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
    """The settings of `pruning.PruningOutput`."""
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
    wanted: Mapping[str, Figure],
    limits: Mapping[str, Figure],
) -> None:
    from optuna.trial import TrialState

    trial.set_user_attr(STATUS, record["status"])
    trial.set_user_attr(MESSAGE, record["message"])
    if accepted(study, record):
        try:
            values = [figure(record, place) for figure in wanted.values()]
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
