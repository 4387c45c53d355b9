"""The file of a calibration: parameters to find, and the measured curves that a run must repeat."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scenes import NotNegative, Number, Positive, Table
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_expressions import Expression
from taichisoft_studies.study_file import Count, Study


class Parameter(Table):
    """A value to be found."""

    start: Number
    """First guess."""
    low: Number
    """Smallest value."""
    high: Number
    """Largest value."""
    log: bool = False
    """Whether it is a magnitude: steps are then relative."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.low < self.start < self.high:
            raise ValueError(f"start ({self.start:g}) must lie between low ({self.low:g}) and high ({self.high:g})")
        if self.log and self.low <= 0.0:
            raise ValueError(f"log needs a positive low; it is {self.low:g}")
        return self


class MeasuredCurve(Table):
    """A measured quantity, and its expression in a run."""

    column: str
    """Column of the data, or an expression of columns ("(a + b) / 2", `columns["Tip-1_z_mm"]`)."""
    quantity: str
    """Expression of what a controller sees ("tip_positions['finger'][2]"), in the same unit."""
    relative: bool = False
    """Whether only changes since the first value count, of the data and of the run."""
    scale: Positive | None = None
    """What a difference is divided by, such as the error of measurement; the data's standard deviation otherwise."""


class Experiment(Table):
    """One measurement, and the run that stands for it."""

    data: str | None = None
    """File with the data (CSV with a header), beside the study; --data names it otherwise."""
    set: tuple[str, ...] = ()
    """Changes of the scene for this experiment."""
    duration: Positive | None = None
    """Simulated time [s]; the study's when it is not given."""
    quasi_static: bool | None = None
    """Whether every step of the run is an equilibrium (`time.dynamics = "static"`), so that neither inertia nor damping
    nor the rate of a ramp enter. When it is not given: yes where nothing here is of time or a velocity, no parameter is
    a damping, and the scene can."""
    over: str = "time"
    """Expression of what the curves are drawn over in the run: time [s], or a pressure that only rises."""
    over_column: str = "time"
    """The same in the data: a column, or an expression of columns."""
    over_error: NotNegative = 0.0
    """Error of measurement of `over_column`, such as that of a pressure: it adds to the scale of each curve, in
    quadrature, what it makes of the curve at its mean slope (effective variance, Orear, Am. J. Phys. 50, 1982)."""
    first: Number | None = None
    """Rows below this value of `over_column` are left out."""
    last: Number | None = None
    """Rows above this value of `over_column` are left out."""
    shift: Number = 0.0
    """What is added to `over_column`, for data whose clock starts at another moment."""
    curves: Annotated[tuple[MeasuredCurve, ...], Field(min_length=1)]
    """The measured quantities."""


class Calibration(Study):
    """A fit of parameters to measured curves by least squares."""

    parameters: Annotated[dict[str, Parameter], Field(min_length=1)]
    """What is to be found, by key."""
    experiments: Annotated[tuple[Experiment, ...], Field(min_length=1)]
    """The measurements, all fitted at once."""
    difference: Annotated[float, Field(strict=True, gt=0.0, le=0.2)] = 0.01
    """Step of the finite differences, as a share of the range between low and high."""
    most_steps: Count = 20
    """Most evaluations of the fit; each takes a run for each experiment, and two more for each parameter."""


@dataclass(frozen=True)
class Measurement:
    """The data of an experiment.

    Attributes:
        over: what the curves are drawn over, shape (row_count,).
        curves: measured quantities, shape (curve_count, row_count), relative ones less their first value.
        scales: what differences are divided by, shape (curve_count,).
        noise: that of the data, from how neighbours differ, shape (curve_count,): at most what scatters about a line.
    """

    over: np.ndarray
    curves: np.ndarray
    scales: np.ndarray
    noise: np.ndarray


def read_measurement(experiment: Experiment, file: Path, key: str) -> Measurement:
    """Read the rows of an experiment; `key` is its place in the study, which begins errors.

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
    slopes = experiment.over_error * spread / over[kept].std()
    scales = [
        math.hypot(curve.scale or float(one), float(slope))
        for curve, one, slope in zip(experiment.curves, spread, slopes, strict=True)
    ]
    if not all(scales):
        raise StudyError(f"{file}: {key}.curves.{scales.index(0.0)} is constant; give it a scale")
    known = [
        math.hypot(curve.scale or 0.0, float(slope)) for curve, slope in zip(experiment.curves, slopes, strict=True)
    ]
    return Measurement(over[kept], values, np.array(scales), np.maximum(known, _noise(over[kept], values)))


def _noise(over: np.ndarray, curves: np.ndarray) -> np.ndarray:
    """Standard deviation of the errors of each curve, by the distance of each row from the line through its neighbours
    (Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 1986); 0 of fewer than three rows."""
    order = np.argsort(over, kind="stable")
    x, y = over[order], curves[:, order]
    span = x[2:] - x[:-2]
    before = np.divide(x[2:] - x[1:-1], span, out=np.full(len(span), 0.5), where=span > 0.0)
    off = before * y[:, :-2] + (1.0 - before) * y[:, 2:] - y[:, 1:-1]
    squares = off**2 / (before**2 + (1.0 - before) ** 2 + 1.0)
    return np.sqrt(squares.sum(axis=1) / max(1, squares.shape[1]))


def _rows(file: Path) -> list[dict[str, object]]:
    """Rows by the names of the columns, separated by commas, or by semicolons or tabs and with decimal commas too."""
    try:
        with file.open(encoding="utf-8-sig", newline="") as opened:
            text = opened.read()
    except (OSError, ValueError) as error:
        raise StudyError(f"{file}: not readable as CSV with a header and numbers: {error}") from error
    header = text.lstrip().partition("\n")[0]
    separator = next((one for one in ";\t" if one in header), ",")
    reader = csv.reader(text.splitlines(), delimiter=separator)
    try:
        lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise StudyError(f"{file}: not readable as CSV with a header and numbers: {error}") from error
    names = lines[0][1] if lines else []
    if len(set(names)) < len(names):
        raise StudyError(
            f"{file}: two columns are called '{max(names, key=names.count)}'; each needs a name of its own"
        )
    rows = []
    for number, cells in lines[1:]:
        if separator != ",":
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            row = dict(zip(names, map(float, cells), strict=True))
        except ValueError:
            row = {}
        if not row or not all(map(math.isfinite, row.values())):
            raise StudyError(
                f"{file}, line {number}: needs {len(names)} finite numbers, one for each column of the header, "
                "separated by commas, or by semicolons where commas are in the numbers"
            )
        rows.append(row)
    if not rows:
        raise StudyError(f"{file}: has no rows of numbers below its header")
    return [{**row, "columns": row} for row in rows]
