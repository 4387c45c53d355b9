"""Expressions in a study's file: numbers computed from the names of a run, a row or a step."""

import ast
import math
from collections.abc import Mapping
from typing import Any

from taichisoft.expressions import CANNOT_BE_COMPUTED, ExpressionError, evaluate, read_expression
from taichisoft_studies.errors import StudyError


class Expression:
    """An expression that has been read, and can be evaluated many times.

    Attributes:
        text: as it was written.
    """

    def __init__(self, text: str, key: str):
        """Read it; `key` is its place in the study, which begins every error.

        Raises:
            StudyError: it is none, or has a part that expressions do not have.
        """
        self.text, self._where = text, f"{key} = {text!r}"
        try:
            self._tree = read_expression(text)
        except ExpressionError as error:
            raise StudyError(f"{self._where}: {error}") from error

    @property
    def names(self) -> set[str]:
        """The names in it."""
        return {part.id for part in ast.walk(self._tree) if isinstance(part, ast.Name)}

    def __call__(self, names: Mapping[str, Any]) -> float:
        """Its value, with these values of names.

        Raises:
            StudyError: a name or entry is missing, or the value is not a finite number.
        """
        number = self._number(self._tree, names)
        if not math.isfinite(number):
            raise StudyError(f"{self._where}: is {number:g}, not a finite number")
        return number

    def violation(self, names: Mapping[str, Any]) -> float:
        """By how much a comparison of two values is missed: not positive where it holds.

        Raises:
            StudyError: the expression is not a comparison of two values by <=, <, >= or >; or as of a call.
        """
        match self._tree:
            case ast.Compare(left, [ast.Lt() | ast.LtE()], [right]):
                low, high = left, right
            case ast.Compare(left, [ast.Gt() | ast.GtE()], [right]):
                low, high = right, left
            case _:
                raise StudyError(f"{self._where}: must compare two values by <= or >=")
        below, above = self._number(low, names), self._number(high, names)
        if not (math.isfinite(below) and math.isfinite(above)):
            raise StudyError(f"{self._where}: compares {below:g} with {above:g}; both must be finite numbers")
        return below - above

    def _number(self, part: ast.expr, names: Mapping[str, Any]) -> float:
        try:
            return float(evaluate(part, names))
        except (ExpressionError, *CANNOT_BE_COMPUTED) as error:
            raise StudyError(f"{self._where}: {error}") from error
