"""Measured curves from CSV files."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichisoft_studies.calibration_file import Experiment
from taichisoft_studies.expressions import Expression
from taichisoft_studies.extras import StudyError


@dataclass(frozen=True)
class Measurement:
    """The data of an experiment.

    Attributes:
        over: what the curves are drawn over, shape (row_count,).
        curves: measured quantities, shape (curve_count, row_count), relative ones less their first value.
        scales: what differences are divided by, shape (curve_count,).
    """

    over: np.ndarray
    curves: np.ndarray
    scales: np.ndarray


def read_measurement(experiment: Experiment, file: Path, key: str) -> Measurement:
    """Read the rows that an experiment wants; `key` is its place in the study, which begins errors.

    Raises:
        StudyError: the file cannot be read, a column is missing, or fewer than two rows are left.
    """
    rows = _rows(file)
    over_of = Expression(experiment.over_column, f"{key}.over_column")
    columns = [Expression(one.column, f"{key}.curves.{index}.column") for index, one in enumerate(experiment.curves)]
    over = np.array([over_of(row) + experiment.shift for row in rows])
    low, high = (-math.inf if experiment.first is None else experiment.first), experiment.last
    kept = (over >= low) & (over <= (math.inf if high is None else high))
    if kept.sum() < 2:
        raise StudyError(f"{file}: {kept.sum()} rows lie between {key}.first and last; two are needed")
    values = np.array([[column(row) for row, keep in zip(rows, kept, strict=True) if keep] for column in columns])
    for index, curve in enumerate(experiment.curves):
        if curve.relative:
            values[index] -= values[index, 0]
    spread = values.std(axis=1)
    scales = [curve.scale or float(one) for curve, one in zip(experiment.curves, spread, strict=True)]
    if not all(scales):
        raise StudyError(f"{file}: {key}.curves.{scales.index(0.0)} is constant; give it a scale")
    return Measurement(over[kept], values, np.array(scales))


def _rows(file: Path) -> list[dict[str, object]]:
    try:
        with file.open(encoding="utf-8-sig", newline="") as opened:
            rows = [{name.strip(): float(cell) for name, cell in row.items()} for row in csv.DictReader(opened)]
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise StudyError(f"{file}: not readable as CSV with a header and numbers: {error}") from error
    return [{**row, "columns": row} for row in rows]
