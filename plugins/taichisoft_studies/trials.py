"""The loop of an optimisation: Optuna proposes values, workers make the runs, and Optuna gets the results."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from taichisoft_studies.errors import StudyError
from taichisoft_studies.objectives import Figure, figures, violations
from taichisoft_studies.optimisation_file import Optimisation
from taichisoft_studies.optimiser import JOURNAL, STATUS, VIOLATIONS, claim_trial, counted, suggest
from taichisoft_studies.results_table import result_row
from taichisoft_studies.run_folder import BEYOND_LAW, COMPLETED, PRUNED
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.sweep_runs import RUNS, checked_record, job_for
from taichisoft_studies.worker_task import do_run
from taichisoft_studies.workers import Workers

RUN, MESSAGE = "run", "message"


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
    running: dict[str, tuple[Any, RunJob]] = {}
    while True:
        while len(running) < workers.count and len(counted(trials)) < study.trials:
            trial = trials.ask()
            claim_trial(trial)
            job = _job(study, folder, trial)
            key = f"trial-{trial.number}"
            running[key] = trial, job
            trial.set_user_attr(RUN, job.name)
            workers.submit(key, do_run, job.to_json())
        if not running:
            return
        key, answer = workers.next_done()
        trial, job = running.pop(key)
        record = checked_record(job, answer)
        _tell(study, trials, trial, record, job.place, wanted, limits)
        done(trial, record)


def trial_rows(study: Optimisation, trials: Any) -> list[dict[str, Any]]:
    """A row of the table for each trial that has ended: values, metrics, objectives, what misses the constraints."""
    from taichisoft_studies.run_folder import read_record

    rows = []
    for trial in counted(trials):
        record = read_record(Path(trials.user_attrs["folder"]) / RUNS / trial.user_attrs.get(RUN, "-"))
        if record is None or not trial.state.is_finished():
            continue
        values = dict(zip(study.objectives, trial.values or (), strict=False))
        missed = dict(zip(study.constraints, trial.user_attrs.get(VIOLATIONS, ()), strict=False))
        rows.append(
            {
                **result_row(record, f"{RUNS}/{record['run']}"),
                "metrics.trial": trial.number,
                **{f"metrics.objectives.{name}": value for name, value in values.items()},
                **{f"metrics.violations.{name}": value for name, value in missed.items()},
            }
        )
    return rows


def accepted(study: Optimisation, record: Mapping[str, Any]) -> bool:
    """Whether the figures of a run count: it completed, or went beyond the law of a body where that is allowed."""
    return record["status"] == COMPLETED or (study.beyond_the_law and record["status"] == BEYOND_LAW)


def _job(study: Optimisation, folder: Path, trial: Any) -> RunJob:
    settings = None
    if study.pruning is not None:
        (objective,) = study.objectives.values()
        settings = {
            **study.pruning.model_dump(),
            "journal": str((folder / JOURNAL).resolve()),
            "trial": trial._trial_id,
            "objective": objective.text,
        }
    return job_for(study, suggest(trial, study.variables), folder, study.seed, pruning=settings)


def _tell(
    study: Optimisation,
    trials: Any,
    trial: Any,
    record: Mapping[str, Any],
    place: Path,
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
