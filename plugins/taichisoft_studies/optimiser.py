"""Optuna's study in the folder of an optimisation: a journal that several machines may write to at the same time."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self
from uuid import uuid4

import numpy as np
from pydantic import Field, model_validator

from taichisoft.base import extra, require
from taichisoft.errors import nearest
from taichisoft.scene import KeySets, NotNegative, Positive, Table
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import MOST, Count, Range, Study, Values, check_values

# The tables of an optimisation's file: variables, objectives, constraints, and the search.

PARAMETERS = "parameters"
"""The name in expressions that stands for the values of a trial."""


class Objective(Table):
    """A figure to be made large or small: an expression of metrics, or a function "file.py:name" of a plug-in."""

    maximise: str | None = None
    """The figure that shall be large."""
    minimise: str | None = None
    """The figure that shall be small."""
    unit: str = ""
    """Its unit, for plots."""
    alternatives: ClassVar[KeySets] = (("maximise", "minimise"),)

    @property
    def text(self) -> str:
        """What is evaluated."""
        return self.maximise or self.minimise or ""

    def label(self, name: str) -> str:
        """Its name with the unit."""
        return f"{name} [{self.unit}]" if self.unit else name

    @property
    def direction(self) -> str:
        """Optuna's name of the direction."""
        return self.key.replace("ise", "ize")

    @property
    def key(self) -> str:
        """The key that is given."""
        return "maximise" if self.maximise is not None else "minimise"


class Pruning(Table):
    """Runs end early whose objective is worse than the median of the others at the same simulated time."""

    every: Positive
    """Simulated time from one look to the next [s]."""
    warm_up: NotNegative = 0.0
    """Simulated time before the first look [s]."""
    trials: Annotated[int, Field(strict=True, ge=1)] = 5
    """Trials that go to their end before any other is pruned."""


class TrialScene(Table):
    """One of several runs of a trial: what it has of its own; all other keys are the study's."""

    scene: str | None = None
    """Scene file, or the name of a shipped scene."""
    set: tuple[str, ...] = ()
    """Changes of the scene, after those of the study ("rigid_bodies.block.position=[0, 0, 60]")."""
    controller: str | None = None
    """Name of a controller."""
    duration: Positive | None = None
    """Simulated time [s]."""


class Optimisation(Study):
    """A search for the values that make a figure largest or smallest."""

    scenes: dict[str, TrialScene] = Field(default={})
    """Several runs in each trial, such as a free finger and a blocked one, by a name of your own.

    In expressions each name stands for the metrics of its run: `blocked['final_normal_forces_mN']`."""
    variables: dict[str, Values]
    """Values by key: bounds (low, high; log, integer), or a list to choose from."""
    objectives: dict[str, Objective]
    """Objectives by a name of your own; with several, the result is the set of compromises (Pareto front)."""
    constraints: dict[str, str] = Field(default={})
    """Comparisons that the result must satisfy ("rest_volumes_mm3['finger'] <= 40000"), by a name of your own."""
    start: dict[str, Any] = Field(default={})
    """Values of the first trial by key, such as a known design."""
    trials: Annotated[int, Field(strict=True, ge=1, le=MOST)] = 60
    """Number of runs, including the runs before a continuation."""
    sampler: Literal["tpe", "cmaes", "nsga2", "gp", "gradient"] = "tpe"
    """Tree-structured Parzen estimator, CMA-ES, NSGA-II, a Gaussian process (needs PyTorch), or L-BFGS-B along
    gradients of the runs, from `start` or the middle of the bounds."""
    pruning: Pruning | None = None
    beyond_the_law: bool = False
    """Whether runs count that went far beyond what the law of a body holds for; otherwise they are left out."""
    winners: Count = 1
    """Best trials that are run again in the end, recorded."""
    finer: tuple[str, ...] = ()
    """Changes of the scene for these ("soft_bodies.finger.mesh.size=6"): a finer mesh, a shorter time step."""

    @model_validator(mode="after")
    def _check_search(self) -> Self:
        check_values(self.variables, "variables")
        for key, values in self.variables.items():
            if isinstance(values, Range) and values.count is not None:
                raise ValueError(f"variables.{key}.count has no effect here; remove it")
        unknown = next((key for key in self.start if key not in self.variables), None)
        if unknown is not None:
            raise ValueError(
                f"start.{unknown} is not a variable; {nearest(unknown, list(self.variables), 'there are')}"
            )
        for key, value in self.start.items():
            span = self.variables[key]
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if isinstance(span, Range) and not (is_number and span.low <= value <= span.high):
                raise ValueError(f"start.{key} = {value!r}: must be a number from {span.low:g} to {span.high:g}")
        if not self.objectives:
            raise ValueError("objectives has no key; at least one is needed")
        many = len(self.objectives) > 1
        if self.pruning is not None and many:
            raise ValueError("pruning needs a single objective")
        wrong = next((name for name in self.scenes if not name.isidentifier() or name == PARAMETERS), None)
        if wrong is not None:
            raise ValueError(
                f"scenes.{wrong}: expressions need a name of letters and digits that is not '{PARAMETERS}'"
            )
        if self.pruning is not None and self.scenes:
            raise ValueError("pruning watches a single run; remove it, or the table scenes")
        if self.sampler == "cmaes" and (many or self.constraints):
            raise ValueError("sampler = 'cmaes' knows one objective and no constraints; take tpe, nsga2 or gp")
        if self.sampler == "gradient":
            chosen = any(not isinstance(values, Range) or values.integer for values in self.variables.values())
            by_function = is_function(next(iter(self.objectives.values())).text)
            if many or self.constraints or self.pruning or self.scenes or chosen or by_function:
                raise ValueError(
                    "sampler = 'gradient' knows one objective, an expression of one run, and real variables; without "
                    "constraints, pruning, scenes, lists and integers"
                )
        if self.pruning is not None and is_function(next(iter(self.objectives.values())).text):
            raise ValueError("pruning needs an expression as objective: a function is called when the run has ended")
        return self

    def by_scene(self) -> dict[str, Self]:
        """The study of each run of a trial by the name of its scene, which is empty where there is a single one."""
        own = {name: table.model_dump(exclude_unset=True) for name, table in self.scenes.items()}
        return {
            name: self.model_copy(update={**keys, "set": (*self.set, *keys.get("set", ()))})
            for name, keys in own.items()
        } or {"": self}


def is_function(text: str) -> bool:
    """Whether an objective is a function of a file, not an expression."""
    file, separator, name = text.rpartition(":")
    return bool(separator) and file.endswith(".py") and name.isidentifier()


def with_function_paths(tables: dict[str, Any], beside: Any) -> dict[str, Any]:
    """The tables with the files of functions beside the study as absolute paths."""
    objectives = tables.get("objectives")
    if isinstance(objectives, Mapping):
        tables = {**tables, "objectives": {name: _with_path(table, beside) for name, table in objectives.items()}}
    return tables


def _with_path(objective: Any, beside: Any) -> Any:
    if not isinstance(objective, Mapping):
        return objective
    return {
        key: str((beside / text).resolve()) if isinstance(text, str) and is_function(text) else text
        for key, text in objective.items()
    }


JOURNAL = "optuna.journal"
NAME = "optimisation"
SESSION = "session "
VIOLATIONS, OWNER, LOST, STATUS = "violations", "owner", "lost", "status"
"""Names of what is noted at trials."""
AGAIN = "again"
"""Name of what is noted at the study: numbers of the trials that are made again."""


def open_study(study: Optimisation, folder: Path) -> Any:
    """Optuna's study, created if the folder has none."""
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
    if [direction.name.lower() for direction in made.directions] != directions:
        raise StudyError(f"{folder}: holds a study with other objectives; take another folder")
    if study.start and not made.get_trials(deepcopy=False):
        made.enqueue_trial({key: _stored(study.variables[key], value) for key, value in study.start.items()})
    made.sampler = _sampler(study, study.seed + 1000 * _session(made))
    return made


def open_trial(settings: Mapping[str, Any]) -> Any:
    """The trial of a run, in the process that makes the run; `settings` as for `run_job.PruningOutput`."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    pruner = optuna.pruners.MedianPruner(n_startup_trials=settings["trials"])
    study = optuna.load_study(study_name=NAME, storage=_storage(Path(settings["journal"])), pruner=pruner)
    return optuna.trial.Trial(study, settings["trial"])


def suggest(trial: Any, variables: Mapping[str, Values]) -> dict[str, Any]:
    """The values of a trial by key."""
    return {key: _suggested(trial, key, values) for key, values in variables.items()}


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

    signs = [-1.0 if direction == StudyDirection.MAXIMIZE else 1.0 for direction in study.directions]
    feasible = filter(is_feasible, study.trials if len(signs) == 1 else study.best_trials)
    by_cost = sorted(feasible, key=lambda trial: ([*np.multiply(signs, trial.values)], trial.number))
    return by_cost[:count]


def nearest_trial(study: Any) -> Any:
    """Of the trials that have completed, the one that violates its constraints least; None without any.

    Constraints have units of their own: a violation counts in parts of its median among the trials that violate it.
    """
    trials = study.get_trials(deepcopy=False)
    ended = [trial for trial in trials if trial.values is not None and VIOLATIONS in trial.user_attrs]
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
