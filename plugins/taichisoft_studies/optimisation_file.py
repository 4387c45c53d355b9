"""The tables of an optimisation's file: variables, objectives, constraints, and the search."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from taichisoft.errors import nearest
from taichisoft.scenes import KeySets, NotNegative, Positive, Table
from taichisoft_studies.study_file import MOST, Count, Range, Study, Values, check_values

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

    @property
    def direction(self) -> str:
        """Optuna's name of the direction."""
        return "maximize" if self.maximise is not None else "minimize"


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
    sampler: Literal["tpe", "cmaes", "nsga2", "gp"] = "tpe"
    """Tree-structured Parzen estimator, CMA-ES, NSGA-II, or a Gaussian process (needs PyTorch)."""
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
        if self.pruning is not None and is_function(next(iter(self.objectives.values())).text):
            raise ValueError("pruning needs an expression as objective: a function is called when the run has ended")
        return self

    def by_scene(self) -> dict[str, Self]:
        """The study of each run of a trial by the name of its scene, which is empty where there is a single one."""
        own = {name: one.model_dump(exclude_unset=True) for name, one in self.scenes.items()}
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
