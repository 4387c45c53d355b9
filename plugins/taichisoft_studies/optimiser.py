"""Optuna's study in the folder of an optimisation: a journal that several machines may write to at the same time."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from taichisoft.optional_packages import extra, require
from taichisoft_studies.errors import StudyError
from taichisoft_studies.optimisation_file import Optimisation
from taichisoft_studies.run_folder import ERROR
from taichisoft_studies.study_file import Range, Values
from taichisoft_studies.unfinished import is_gone, owner

JOURNAL = "optuna.journal"
NAME = "optimisation"
SESSION = "session "
VIOLATIONS, OWNER, LOST, STATUS = "violations", "owner", "lost", "status"
"""Names of what is noted at trials."""
AGAIN = "again"
"""Name of what is noted at the study: numbers of the trials that are made again."""


def open_study(study: Optimisation, folder: Path) -> Any:
    """Optuna's study, created if the folder has none.

    Raises:
        StudyError: Optuna or what a sampler needs is not installed, or the folder has a study with other objectives.
    """
    require("taichisoft study optimise", "optuna", install=extra("studies"))
    if study.sampler == "cmaes":
        require("sampler = 'cmaes'", "cmaes", install=extra("studies"))
    if study.sampler == "gp":
        require("sampler = 'gp'", "torch", install="pip install torch")  # too large for the extra
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    warnings.filterwarnings("ignore", category=optuna.exceptions.ExperimentalWarning)
    directions: list[Any] = [objective.direction for objective in study.objectives.values()]
    made = optuna.create_study(
        study_name=NAME, storage=_storage(folder / JOURNAL), directions=directions, load_if_exists=True
    )
    if [one.name.lower() for one in made.directions] != directions:
        raise StudyError(f"{folder}: holds a study with other objectives; take another folder")
    if study.start and not made.get_trials(deepcopy=False):
        made.enqueue_trial({key: _stored(study.variables[key], value) for key, value in study.start.items()})
    made.sampler = _sampler(study, study.seed + 1000 * _session(made))
    return made


def open_trial(settings: Mapping[str, Any]) -> Any:
    """The trial of a run, in the process that makes the run; `settings` as for `pruning.PruningOutput`."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    pruner = optuna.pruners.MedianPruner(n_startup_trials=settings["trials"])
    study = optuna.load_study(study_name=NAME, storage=_storage(Path(settings["journal"])), pruner=pruner)
    return optuna.trial.Trial(study, settings["trial"])


def suggest(trial: Any, variables: Mapping[str, Values]) -> dict[str, Any]:
    """The values of a trial by key."""
    return {key: _suggested(trial, key, values) for key, values in variables.items()}


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
    """Put the trials back into the queue whose run ended with an error, see `run_folder.finished`; returns how many."""
    from optuna.trial import TrialState

    before = study.user_attrs.get(AGAIN, [])
    ended = study.get_trials(deepcopy=False, states=(TrialState.FAIL,))
    failed = [one for one in ended if one.user_attrs.get(STATUS) == ERROR and one.number not in before]
    study.set_user_attr(AGAIN, [*before, *(trial.number for trial in failed)])
    for trial in failed:
        study.enqueue_trial(trial.params)
    return len(failed)


def counted(study: Any) -> list[Any]:
    """The trials that have ended or are being made, without lost trials and trials that are made again."""
    from optuna.trial import TrialState

    again = study.user_attrs.get(AGAIN, [])
    return [
        trial
        for trial in study.get_trials(deepcopy=False)
        if trial.state != TrialState.WAITING and not trial.user_attrs.get(LOST) and trial.number not in again
    ]


def is_feasible(trial: Any) -> bool:
    """Whether a trial has completed and satisfies all constraints."""
    return trial.values is not None and all(value <= 0.0 for value in trial.user_attrs.get(VIOLATIONS, ()))


def best_trials(study: Any, count: int) -> list[Any]:
    """The best trials that satisfy all constraints: of one objective in order, of several the Pareto front."""
    from optuna.study import StudyDirection

    signs = [-1.0 if one == StudyDirection.MAXIMIZE else 1.0 for one in study.directions]
    found = filter(is_feasible, study.trials if len(signs) == 1 else study.best_trials)
    by_cost = sorted(found, key=lambda trial: ([*np.multiply(signs, trial.values)], trial.number))
    return by_cost[:count]


def nearest_trial(study: Any) -> Any:
    """Of the trials that have completed, the one that violates its constraints least; None without any.

    Constraints have units of their own: a violation counts in parts of its median among the trials that violate it.
    """
    ended = [one for one in study.get_trials(deepcopy=False) if one.values is not None and VIOLATIONS in one.user_attrs]
    if not ended:
        return None
    missed = np.maximum([trial.user_attrs[VIOLATIONS] for trial in ended], 0.0).reshape(len(ended), -1)
    typical = np.array([np.median(column[column > 0.0]) if (column > 0.0).any() else 1.0 for column in missed.T])
    return ended[int(np.argmin((missed / typical).sum(axis=1)))]


def _session(made: Any) -> int:
    """Number of this session, from 0: each draws other random numbers, also where two begin at the same moment.

    A session notes a name of its own; the journal keeps the order of what is written to it for all of them.
    """
    name = f"{SESSION}{uuid4().hex}"
    made.set_user_attr(name, True)
    return [key for key in made.user_attrs if key.startswith(SESSION)].index(name)


def _storage(path: Path) -> Any:
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    path.parent.mkdir(parents=True, exist_ok=True)
    return JournalStorage(JournalFileBackend(str(path), lock_obj=JournalFileOpenLock(str(path))))


def _sampler(study: Optimisation, seed: int) -> Any:
    from optuna import samplers

    match study.sampler:
        case "cmaes":
            return samplers.CmaEsSampler(seed=seed)
        case "nsga2":
            return samplers.NSGAIISampler(seed=seed)
        case "gp":
            return samplers.GPSampler(seed=seed)
    return samplers.TPESampler(seed=seed, constant_liar=True)


def _suggested(trial: Any, key: str, values: Values) -> Any:
    if not isinstance(values, Range):
        texts = [_stored(values, value) for value in values]
        return values[texts.index(trial.suggest_categorical(key, texts))]
    if values.integer:
        return trial.suggest_int(key, int(values.low), int(values.high), log=values.log)
    return float(f"{trial.suggest_float(key, values.low, values.high, log=values.log):.10g}")


def _stored(values: Values, value: Any) -> Any:
    """A value as Optuna keeps it: choices as text, since Optuna stores no lists."""
    return value if isinstance(values, Range) else repr(value)
