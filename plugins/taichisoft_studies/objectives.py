"""The objectives and constraints of a run: expressions of its metrics, or functions of a plug-in."""

import importlib.util
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from taichisoft_studies.errors import StudyError
from taichisoft_studies.optimisation_file import PARAMETERS, Optimisation, is_function
from taichisoft_studies.study_expressions import Expression

Figure = Callable[[Mapping[str, Any], Any], float]
"""From the record of a trial and its run's folder (of several runs: the folders by scene) to a number."""


def figures(study: Optimisation) -> dict[str, Figure]:
    """The objectives by name.

    Raises:
        StudyError: an expression is not valid, or a function cannot be loaded.
    """
    return {
        name: _figure(one.text, f"objectives.{name}.{'maximise' if one.maximise is not None else 'minimise'}")
        for name, one in study.objectives.items()
    }


def violations(study: Optimisation) -> dict[str, Figure]:
    """By how much each constraint is missed: not positive where it holds.

    Raises:
        StudyError: an expression is not valid.
    """
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
