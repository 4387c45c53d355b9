"""The curves of a run: expressions of what a controller sees, evaluated after every step."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.control import Observation
from taichisoft.input_file import read_arrays
from taichisoft.session import Output
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_expressions import Expression

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step import StepReport


def observed_values(observation: Observation) -> dict[str, Any]:
    """The observation's attributes by name; `normal_forces["finger|cube"]` is that of a pair."""
    values = {one.name: getattr(observation, one.name) for one in fields(observation) if one.name != "state"}
    return {name: _named_pairs(value) for name, value in values.items()}


def _named_pairs(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {"|".join(key) if isinstance(key, tuple) else key: one for key, one in value.items()}
    return value


CURVES = "curves.npz"


class CurvesOutput(Output):
    """Evaluates expressions after every step, and writes their values at the end."""

    def __init__(self, folder: Path, expressions: Mapping[str, str]):
        """Prepare; `expressions` are texts by the name of the curve.

        Raises:
            StudyError: one is not valid.
        """
        self._folder = folder
        self._expressions = {name: Expression(text, name) for name, text in expressions.items()}
        self._rows: list[list[float]] = []

    def begin(self, model: "Model", state: "State") -> None:
        """Forget an earlier run."""
        self._rows = []

    def record(self, state: "State", report: "StepReport") -> None:
        """Note the values after a step.

        Raises:
            StudyError: an expression names what a run does not have.
        """
        names = observed_values(report.observation.truth)
        self._rows.append([expression(names) for expression in self._expressions.values()])

    def end(self, outcome: str) -> None:
        """Write curves.npz: a column for each expression, shape (step_count,)."""
        columns = dict(zip(self._expressions, np.array(self._rows, dtype=float).T, strict=False))
        path = self._folder / CURVES
        with atomic_file(path, StudyError) as partial, partial.open("wb") as file:
            np.savez(file, **columns)


def read_curves(folder: Path) -> dict[str, np.ndarray]:
    """The columns that a run noted.

    Raises:
        StudyError: the run has none.
    """
    path = folder / CURVES
    try:
        return read_arrays(path)
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: not readable: {error}") from error
