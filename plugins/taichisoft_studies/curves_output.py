"""What a study notes of every step of a run: the values of expressions, for comparison with measured curves."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.session.output import Output
from taichisoft_studies.expressions import Expression
from taichisoft_studies.extras import StudyError
from taichisoft_studies.observed import observed_values

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport

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
        names = observed_values(report.observation)
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
        with np.load(path) as columns:
            return {name: columns[name] for name in columns.files}
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: not readable: {error}") from error
