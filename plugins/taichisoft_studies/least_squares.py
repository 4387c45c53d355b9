"""Calibration: parameters whose runs repeat what was measured, by least squares."""

import csv
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.errors import SceneError
from taichisoft.scene import NotNegative, Number, Positive, Table
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_job import COMPLETED, LOG, RunJob, read_curves, read_record
from taichisoft_studies.study_file import Count, Expression, Study, scene_with
from taichisoft_studies.sweep_runs import fixed_overrides, job_for, make_missing
from taichisoft_studies.workers import Workers

# The file of a calibration: parameters to find, and the measured curves that a run must repeat.


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
    """Read the rows of an experiment; `key` is its place in the study, which begins errors."""
    rows = _rows(file)
    over_of = Expression(experiment.over_column, f"{key}.over_column")
    columns = [
        Expression(curve.column, f"{key}.curves.{index}.column") for index, curve in enumerate(experiment.curves)
    ]
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
        math.hypot(curve.scale or float(deviation), float(slope))
        for curve, deviation, slope in zip(experiment.curves, spread, slopes, strict=True)
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
    separator = next((mark for mark in ";\t" if mark in header), ",")
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


# Calibration: parameters whose runs repeat measured curves, by least squares on the runs of a study.

CONFIDENCE = 0.95
OVER = "over"
AT_BOUND = 1e-4
"""Distance from a bound, as a share of the range, below which a value counts as at it [-]."""
FAR, SMALL = 3.0, 0.01
"""A residual above so many times the noise, and this part of the range of the data, has another cause than noise."""
STATIC = {"time.dynamics": "static", "time.theta": 1.0}
STEP = 1e-4
"""Change of the parameters, as a share of their ranges, at which the fit has converged."""


@dataclass(frozen=True)
class CalibrationFit:
    """The result of a calibration.

    Attributes:
        values: by key.
        intervals: of confidence (95 %), lowest and highest value by key.
        residuals: root of the mean square of (run - data) of each curve of each experiment, in its unit.
        modelled: curves of the run at the data's places, shape (curve_count, row_count), of each experiment.
        evaluations: how often the fit looked at its residuals.
        correlation: of consecutive residuals, from 0 to 1, which widens the intervals.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    residuals: list[list[float]]
    modelled: list[np.ndarray]
    evaluations: int
    correlation: float


def fit_parameters(
    study: Calibration,
    measurements: Sequence[Measurement],
    folder: Path,
    workers: Workers,
    tried: Callable[[Mapping[str, float], float], None],
) -> CalibrationFit:
    """Find the parameters with the least squares of differences, by trust regions within bounds (Branch et al. 1999).

    Derivatives are central finite differences, whose runs are made at the same time. The interval of confidence is
    that of the linearised problem: Student's t times the root of s^2 (J^T J)^-1, where s^2 counts correlated
    residuals as fewer (an autoregressive process of first order).

    Args:
        study: the file.
        measurements: data of its experiments.
        folder: folder of the study.
        workers: make the runs.
        tried: called with the values of each evaluation, and their cost.
    """
    from scipy.optimize import least_squares

    evaluations = 0

    def residuals(points: Sequence[np.ndarray]) -> list[np.ndarray | StudyError]:
        return _residuals(study, measurements, folder, workers, [_values(study, point) for point in points])

    def cost(point: np.ndarray) -> np.ndarray:
        nonlocal evaluations
        (misses,) = residuals([point])
        if isinstance(misses, StudyError):
            if not evaluations:
                raise misses
            return np.full(sum(data.curves.size for data in measurements), np.inf)  # scipy then takes a shorter step
        evaluations += 1
        tried(_values(study, point), float(0.5 * misses @ misses))
        return misses

    def slopes(point: np.ndarray) -> np.ndarray:
        steps = study.difference * np.eye(len(point))
        forward, backward = np.minimum(point + steps, 1.0), np.maximum(point - steps, 0.0)
        both = residuals([*forward, *backward])
        for misses in both:
            if isinstance(misses, StudyError):
                raise misses
        after, before = np.split(np.array(both), 2)
        change: np.ndarray = (after - before) / np.diag(forward - backward)[:, None]
        return change.T

    start = np.array([_share(parameter, parameter.start) for parameter in study.parameters.values()])
    solution = least_squares(
        cost, start, slopes, bounds=(0.0, 1.0), xtol=STEP, ftol=1e-8, gtol=1e-10, max_nfev=study.most_steps
    )
    correlation = _correlation(solution.fun, measurements)
    intervals = _intervals(study, solution.x, solution.jac, solution.fun, correlation)
    differences = [
        parts * own.scales[:, None] for own, parts in zip(measurements, _split(solution.fun, measurements), strict=True)
    ]
    residual = [np.sqrt((difference**2).mean(axis=1)).tolist() for difference in differences]
    modelled = [data.curves + difference for data, difference in zip(measurements, differences, strict=True)]
    return CalibrationFit(_values(study, solution.x), intervals, residual, modelled, evaluations, correlation)


def misfits(study: Calibration, measurements: Sequence[Measurement], fit: CalibrationFit) -> Iterator[str]:
    """A sentence for each value that ends at a bound, and each curve whose residual has another cause than noise."""
    for key, value in fit.values.items():
        parameter = study.parameters[key]
        share = _share(parameter, value)
        for name, bound, left in (("low", parameter.low, share), ("high", parameter.high, 1.0 - share)):
            if left < AT_BOUND:
                yield f"hint: {key} ends at its bound, {name} = {bound:g}: the data ask for more, or say nothing of it"
    for experiment, data, residuals in zip(study.experiments, measurements, fit.residuals, strict=True):
        ranges = np.ptp(data.curves, axis=1)
        for curve, noise, extent, residual in zip(experiment.curves, data.noise, ranges, residuals, strict=True):
            if residual > max(FAR * noise, SMALL * extent):
                yield (
                    f"hint: {curve.column[:40]}: the residual, {residual:.3g}, is far above the noise, {noise:.2g}: "
                    "the scene leaves something out (mesh, law, clamp, geometry), and the values make up for it"
                )


def complaints(study: Calibration, fit: CalibrationFit, folder: Path) -> Iterator[str]:
    """A sentence for each experiment whose run with the fitted values has warned: of an unstable equilibrium first."""
    for index in range(len(study.experiments)):
        job = experiment_job(study, index, fit.values, folder)
        lines = (read_record(job.place) or {}).get("warnings", [])
        if lines:
            first = next((line for line in lines if "equilibrium" in line), lines[0])
            more = f" ({len(lines) - 1} more in its {LOG})" if len(lines) > 1 else ""
            yield f"experiments.{index}: run {job.name}: {first}{more}"


def _residuals(
    study: Calibration,
    measurements: Sequence[Measurement],
    folder: Path,
    workers: Workers,
    points: Sequence[Mapping[str, float]],
) -> list[np.ndarray | StudyError]:
    """(run - data) / scale of all curves, or what went wrong, for several sets of values at once."""
    jobs = [[experiment_job(study, index, values, folder) for index in range(len(measurements))] for values in points]
    unique = {job.name: job for row in jobs for job in row}
    records = {record["run"]: record for record in make_missing(list(unique.values()), workers)}
    misses: list[np.ndarray | StudyError] = []
    for row in jobs:
        try:
            parts = [
                scaled_differences(job, records[job.name], data, study, index)
                for index, (job, data) in enumerate(zip(row, measurements, strict=True))
            ]
            misses.append(np.concatenate(parts))
        except StudyError as error:
            misses.append(error)
    return misses


def statics(study: Calibration, index: int) -> tuple[tuple[str, ...], str]:
    """What makes every step of an experiment an equilibrium, for `set`, and a sentence that says so, or why not."""
    experiment, where = study.experiments[index], f"experiments.{index}"
    texts = [experiment.over, *(curve.quantity for curve in experiment.curves)]
    names = {name for text in texts for name in Expression(text, where).names}
    of_rates = any(part in name for name in names for part in ("time", "velocit", "flow"))
    of_rates |= any(key.rpartition(".")[2].startswith("rayleigh_") for key in study.parameters)
    if experiment.quasi_static is False or (experiment.quasi_static is None and of_rates):
        return (), ""
    own = fixed_overrides(study.model_copy(update={"set": (*study.set, *experiment.set)}))
    own |= {key: parameter.start for key, parameter in study.parameters.items()}
    scene_with(study.scene, own, study.controller)
    try:
        scene = scene_with(study.scene, {**STATIC, **own}, study.controller)
    except SceneError as error:
        if experiment.quasi_static:
            raise
        return (), f"{where}: a motion, since no step can be an equilibrium: {error}; ramp slowly"
    if scene.time.dynamics != "static":  # the study says otherwise
        return (), ""
    changes = tuple(f"{key}={value}" for key, value in STATIC.items())
    return changes, f"{where}: every step is an equilibrium; quasi_static = false brings inertia and damping"


def experiment_job(study: Calibration, index: int, values: Mapping[str, float], folder: Path) -> RunJob:
    """The run that stands for an experiment, with values of the parameters."""
    experiment = study.experiments[index]
    changed = study.model_copy(
        update={
            "set": (*statics(study, index)[0], *study.set, *experiment.set),
            "duration": experiment.duration or study.duration,
        }
    )
    watch = {OVER: experiment.over, **{str(n): curve.quantity for n, curve in enumerate(experiment.curves)}}
    return job_for(changed, values, folder, study.seed, watch=watch)


def scaled_differences(
    job: RunJob, record: Mapping[str, Any], data: Measurement, study: Calibration, index: int
) -> np.ndarray:
    """(run - data) / scale of the curves of an experiment, one after the other.

    Args:
        job: as `experiment_job` makes it.
        record: what its run left.
        data: the measurement.
        study: the file.
        index: of the experiment.
    """
    if record["status"] != COMPLETED:
        values = ", ".join(f"{key} = {value:g}" for key, value in job.parameters.items())
        raise StudyError(f"experiments.{index}: the run with {values}: {record['status']}: {record['message']}")
    columns = read_curves(job.place)
    over = columns[OVER]
    if len(over) < 2 or not (np.diff(over) > 0.0).all():
        raise StudyError(f"experiments.{index}.over = '{study.experiments[index].over}': must rise from step to step")
    # Steps end at their time: the first one is as near to the start of the data as the run comes.
    slack = over[1] - over[0]
    if data.over[0] < over[0] - 1.001 * slack or data.over[-1] > over[-1] + 1e-9 * abs(over[-1]):
        raise StudyError(
            f"experiments.{index}: the data lie from {data.over[0]:g} to {data.over[-1]:g}, and the run from "
            f"{over[0]:g} to {over[-1]:g}; change duration, first, last or shift"
        )
    parts = []
    for number, curve in enumerate(study.experiments[index].curves):
        modelled = np.interp(data.over, over, columns[str(number)])
        modelled -= modelled[0] if curve.relative else 0.0
        parts.append((modelled - data.curves[number]) / data.scales[number])
    return np.concatenate(parts)


def _split(residuals: np.ndarray, measurements: Sequence[Measurement]) -> list[np.ndarray]:
    """The residuals of each experiment, shape (curve_count, row_count)."""
    ends = np.cumsum([data.curves.size for data in measurements])
    parts = np.split(residuals, ends[:-1])
    return [part.reshape(data.curves.shape) for part, data in zip(parts, measurements, strict=True)]


def _share(parameter: Parameter, value: float) -> float:
    """Where a value lies between its bounds, from 0 to 1."""
    if parameter.log:
        return float(np.log(value / parameter.low) / np.log(parameter.high / parameter.low))
    return (value - parameter.low) / (parameter.high - parameter.low)


def _value(parameter: Parameter, share: float) -> float:
    if parameter.log:
        return float(parameter.low * (parameter.high / parameter.low) ** share)
    return float(parameter.low + share * (parameter.high - parameter.low))


def _values(study: Calibration, point: np.ndarray) -> dict[str, float]:
    """The values at a point of the unit cube, by key."""
    pairs = zip(study.parameters.items(), point, strict=True)
    return {key: float(f"{_value(parameter, float(share)):.12g}") for (key, parameter), share in pairs}


def _correlation(residuals: np.ndarray, measurements: Sequence[Measurement]) -> float:
    """Correlation of residuals that follow each other in a curve; 0 where it would be negative."""
    curves = [curve for part in _split(residuals, measurements) for curve in part]
    square = sum(float(curve @ curve) for curve in curves)
    product = sum(float(curve[1:] @ curve[:-1]) for curve in curves)
    return max(0.0, product / square) if square > 0.0 else 0.0


def _intervals(
    study: Calibration, point: np.ndarray, slopes: np.ndarray, residuals: np.ndarray, correlation: float
) -> dict[str, tuple[float, float]]:
    """Lowest and highest value by key; infinite widths, as wide as the bounds, where the data say nothing."""
    from scipy.stats import t

    freedom = max(1, len(residuals) - len(point))
    variance = (
        float(residuals @ residuals) / freedom * (1.0 + correlation) / max(1.0 - correlation, 1.0 / len(residuals))
    )
    covariance = variance * np.linalg.pinv(slopes.T @ slopes)
    width = t.ppf(0.5 + 0.5 * CONFIDENCE, freedom) * np.sqrt(np.diag(covariance))
    return {
        key: (_value(parameter, float(share - half)), _value(parameter, float(share + half)))
        for (key, parameter), share, half in zip(study.parameters.items(), point, width, strict=True)
    }
