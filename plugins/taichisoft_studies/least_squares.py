"""Calibration: parameters whose runs repeat what was measured, by least squares."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft import Scene
from taichisoft.errors import SceneError
from taichisoft.runtime import RUBBER_LAWS
from taichisoft.scene import NotNegative, Number, Positive, Table
from taichisoft_outputs.material_files import MaterialError
from taichisoft_outputs.measured_table import MeasuredRow, MeasuredTable, read_measured_table
from taichisoft_outputs.tension_test import (
    half_widths,
    joined,
    nominal_stress,
    read_specimens,
    residual_correlation,
    shear_stress,
)
from taichisoft_studies.curve_differences import OVER, Compared, CurveDifferences
from taichisoft_studies.errors import StudyError
from taichisoft_studies.gradient_search import descend, factors, rate_of, share_of, value_at
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
    """Name or number of a column of the data, or an expression of columns ("(a + b) / 2", `columns["Tip-1_z_mm"]`)."""
    quantity: str
    """Expression of what a controller sees ("tip_positions['finger'][2]"), in the same unit."""
    relative: bool = False
    """Whether only changes since the first value count, of the data and of the run."""
    scale: Positive | None = None
    """What a difference is divided by, such as the error of measurement; the data's standard deviation otherwise."""


class Experiment(Table):
    """One measurement, and the run that stands for it, or the law of a body where a specimen was pulled or sheared."""

    data: str | None = None
    """File with the data (CSV with a header), beside the study; --data names it otherwise."""
    scene: str | None = None
    """Scene file, or the name of a shipped scene; the study's when it is not given."""
    set: tuple[str, ...] = ()
    """Changes of the scene for this experiment."""
    test: Literal["tension", "shear"] | None = None
    """Instead of curves: what was done to a specimen of the material of `body`; of shear, "strain" is the angle's
    tangent, and "extension" is over the height."""
    body: str | None = None
    """The soft body of `test`; the scene's first when it is not given."""
    columns: dict[str, str] = Field(default={})
    """Columns of `test`, name or number with a unit, by quantity: strain, stretch, stress, extension, force."""
    area: Positive | None = None
    """Cross-section of the specimen at rest [mm^2], where there is a force."""
    length: Positive | None = None
    """Length of the specimen at rest [mm], where there is an extension."""
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
    curves: tuple[MeasuredCurve, ...] = ()
    """The measured quantities."""

    no_effect_beside: ClassVar = {"test": ("duration", "quasi_static", "over", "over_column")}
    own_keys: ClassVar = {"test": ("body", "columns", "area", "length")}

    @model_validator(mode="after")
    def _check_kind(self) -> Self:
        if (self.test is None) != bool(self.curves):
            raise ValueError("needs either curves of a run, or a test of a specimen (tension, shear)")
        return self

    @property
    def labels(self) -> tuple[str, ...]:
        """What the curves are called."""
        return tuple(curve.column[:40] for curve in self.curves) or (f"stress of {self.test} [kPa]",)

    @property
    def over_label(self) -> str:
        """What they are drawn over."""
        return {"tension": "stretch [-]", "shear": "shear [-]"}.get(self.test or "", self.over_column)


class Calibration(Study):
    """A fit of parameters to measured curves by least squares."""

    parameters: Annotated[dict[str, Parameter], Field(min_length=1)]
    """What is to be found, by key."""
    experiments: Annotated[tuple[Experiment, ...], Field(min_length=1)]
    """The measurements, all fitted at once."""
    difference: Annotated[float, Field(strict=True, gt=0.0, le=0.2)] = 0.01
    """Step of the finite differences, as a share of the range between low and high."""
    method: Literal["differences", "gradient"] = "differences"
    """How the fit goes down: by derivatives of each curve from differences of runs, or first by the gradient of each
    run (L-BFGS-B), which costs the same for any number of parameters."""
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
    if experiment.test is not None:
        try:
            test = joined(read_specimens(file, experiment.columns, experiment.area, experiment.length))
        except MaterialError as error:
            raise StudyError(f"{key}: {error}") from error
        over, values = test.stretch - (experiment.test == "shear"), test.stress[None]
    else:
        table = read_measured_table(file, StudyError)
        over = _column(table, experiment.over_column, f"{key}.over_column")
        columns = enumerate(experiment.curves)
        values = np.array([_column(table, one.column, f"{key}.curves.{n}.column") for n, one in columns])
    over = over + experiment.shift
    low, high = (-math.inf if experiment.first is None else experiment.first), experiment.last
    kept = (over >= low) & (over <= (math.inf if high is None else high))
    if kept.sum() < 2:
        raise StudyError(f"{file}: {kept.sum()} rows lie between {key}.first and last; two are needed")
    over, values = over[kept], values[:, kept]
    for index, curve in enumerate(experiment.curves):
        if curve.relative:
            values[index] -= values[index, 0]
    spread = values.std(axis=1)
    known = np.array([curve.scale or 0.0 for curve in experiment.curves] or [0.0])
    slopes = experiment.over_error * spread / over.std()
    scales = np.hypot(np.where(known > 0.0, known, spread), slopes)
    if not scales.all():
        raise StudyError(f"{file}: {key}.curves.{scales.tolist().index(0.0)} is constant; give it a scale")
    return Measurement(over, values, scales, np.maximum(np.hypot(known, slopes), _noise(over, values)))


def _column(table: MeasuredTable, text: str, key: str) -> np.ndarray:
    """The numbers of a column by its name or number, or of an expression of columns."""
    place, rows = table.place(text), range(len(table.rows))
    if place is not None:
        return np.array([table.number(row, place) for row in rows])
    expression = Expression(text, key)
    named = (MeasuredRow(table, row) for row in rows)
    names = [name for name in expression.names if table.place(name) is not None]
    return np.array([expression({"columns": row, **{name: row[name] for name in names}}) for row in named])


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


# Calibration: parameters whose runs repeat measured curves, by least squares on the runs of a study.

AT_BOUND = 1e-4
"""Distance from a bound, as a share of the range, below which a value counts as at it [-]."""
FAR, SMALL = 3.0, 0.01
"""A residual above so many times the noise, and this part of the range of the data, has another cause than noise."""
INCOMPRESSIBLE = 0.45
"""Poisson's ratio from which the stress of incompressible rubber is taken: Young's modulus differs by 3 %."""
STATIC = {"time.dynamics": "static", "time.theta": 1.0}
DESCENT = 1e-3
"""Part of the first squares by which a step along gradients must lower them; differences do the rest."""
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
    made: Callable[[RunJob, Mapping[str, Any]], None] = lambda *_: None,
) -> CalibrationFit:
    """Find the parameters with the least squares of differences, by trust regions within bounds (Branch et al. 1999).

    Derivatives are central finite differences, whose runs are made at the same time. `half_widths` has the intervals.
    With `method = "gradient"` they begin where gradients have led.

    Args:
        study: the file.
        measurements: data of its experiments.
        folder: folder of the study.
        workers: make the runs.
        tried: called with the values of each evaluation, and their cost.
        made: called with each run that was made, and its record; an earlier fit in the folder has made others.
    """
    from scipy.optimize import least_squares

    evaluations = 0

    def evaluated(values: Mapping[str, float], cost: float) -> None:
        nonlocal evaluations
        evaluations += 1
        tried(values, cost)

    def residuals(points: Sequence[np.ndarray]) -> list[np.ndarray | StudyError]:
        values = [_values(study, point) for point in points]
        return _residuals(study, measurements, folder, workers, values, made)

    def cost(point: np.ndarray) -> np.ndarray:
        (misses,) = residuals([point])
        if isinstance(misses, StudyError):
            if not evaluations:
                raise misses
            return np.full(sum(data.curves.size for data in measurements), np.inf)  # scipy then takes a shorter step
        evaluated(_values(study, point), float(0.5 * misses @ misses))
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

    start = np.array([share_of(parameter, parameter.start) for parameter in study.parameters.values()])
    if study.method == "gradient":
        start = _descended(study, measurements, folder, workers, start, evaluated, made)
    solution = least_squares(
        cost, start, slopes, bounds=(0.0, 1.0), xtol=STEP, ftol=1e-8, gtol=1e-10, max_nfev=study.most_steps
    )
    correlation = residual_correlation([curve for part in _split(solution.fun, measurements) for curve in part])
    intervals = _intervals(study, solution.x, solution.jac, solution.fun, correlation)
    differences = [
        parts * own.scales[:, None] for own, parts in zip(measurements, _split(solution.fun, measurements), strict=True)
    ]
    residual = [np.sqrt((difference**2).mean(axis=1)).tolist() for difference in differences]
    modelled = [data.curves + difference for data, difference in zip(measurements, differences, strict=True)]
    return CalibrationFit(_values(study, solution.x), intervals, residual, modelled, evaluations, correlation)


def _descended(
    study: Calibration,
    measurements: Sequence[Measurement],
    folder: Path,
    workers: Workers,
    start: np.ndarray,
    tried: Callable[[Mapping[str, float], float], None],
    made: Callable[[RunJob, Mapping[str, Any]], None],
) -> np.ndarray:
    """The point of the unit cube with the least squares to which gradients of the runs lead from a start."""
    requests = gradient_requests(study, measurements)

    def value_and_slope(point: np.ndarray) -> tuple[float, np.ndarray] | None:
        values = _values(study, point)
        (misses,) = _residuals(study, measurements, folder, workers, [values], made, requests)
        if isinstance(misses, StudyError):
            if (point == start).all():
                raise misses
            return None
        value, slope = float(0.5 * misses @ misses), np.zeros(len(point))
        for index, request in requests.items():
            record = read_record(experiment_job(study, index, values, folder, request).place)
            assert record is not None
            slope += [record["metrics"]["gradient"][key] for key in values]
        tried(values, value)
        rates = [rate_of(parameter, values[key]) for key, parameter in study.parameters.items()]
        return value, slope * rates + _slopes_by_law(study, measurements, point)

    return descend(value_and_slope, start, study.most_steps, DESCENT)


def gradient_requests(study: Calibration, measurements: Sequence[Measurement]) -> dict[int, dict[str, Any]]:
    """What the runs of the experiments derive, by number of the experiment: half their squares, by the parameters."""
    requests = {}
    start = {key: parameter.start for key, parameter in study.parameters.items()}
    for index, data in enumerate(measurements):
        if study.experiments[index].test is not None:
            continue
        if statics(study, index)[0]:
            raise StudyError(
                f"experiments.{index}: every step is an equilibrium, which has no gradient; take quasi_static = false, "
                'or method = "differences"'
            )
        own = _of_experiment(study, index)

        def scene_of(values: Mapping[str, Any], own: Calibration = own) -> Scene:
            return scene_with(own.scene, {**fixed_overrides(own), **values}, own.controller)

        by_key = {key: factors(scene_of, start, key) for key in start}
        requests[index] = {"factors": by_key, "moves": {}, "squares": compared(study, index, data)._asdict()}
    return requests


def _slopes_by_law(study: Calibration, measurements: Sequence[Measurement], point: np.ndarray) -> np.ndarray:
    """Derivatives of half the squares of all specimens by a point of the unit cube, by differences of the law."""

    def value(at: np.ndarray) -> float:
        misses = [
            _differences_by_law(study, index, _values(study, at), data)
            for index, data in enumerate(measurements)
            if study.experiments[index].test is not None
        ]
        return sum(float(0.5 * one @ one) for one in misses)

    return np.array([value(point + step) - value(point - step) for step in STEP * np.eye(len(point))]) / (2.0 * STEP)


def misfits(study: Calibration, measurements: Sequence[Measurement], fit: CalibrationFit) -> Iterator[str]:
    """A sentence for each value that ends at a bound, and each curve whose residual has another cause than noise."""
    for key, value in fit.values.items():
        parameter = study.parameters[key]
        share = share_of(parameter, value)
        for name, bound, left in (("low", parameter.low, share), ("high", parameter.high, 1.0 - share)):
            if left < AT_BOUND:
                yield f"hint: {key} ends at its bound, {name} = {bound:g}: the data ask for more, or say nothing of it"
    for experiment, data, residuals in zip(study.experiments, measurements, fit.residuals, strict=True):
        ranges = np.ptp(data.curves, axis=1)
        for label, noise, extent, residual in zip(experiment.labels, data.noise, ranges, residuals, strict=True):
            if residual > max(FAR * noise, SMALL * extent):
                yield (
                    f"hint: {label}: the residual, {residual:.3g}, is far above the noise, {noise:.2g}: "
                    "the scene leaves something out (mesh, law, clamp, geometry), and the values make up for it"
                )


def complaints(study: Calibration, fit: CalibrationFit, folder: Path) -> Iterator[str]:
    """A sentence for each experiment whose run with the fitted values has warned: of an unstable equilibrium first."""
    for index, experiment in enumerate(study.experiments):
        if experiment.test is not None:
            continue
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
    made: Callable[[RunJob, Mapping[str, Any]], None],
    requests: Mapping[int, Mapping[str, Any]] = MappingProxyType({}),
) -> list[np.ndarray | StudyError]:
    """(run - data) / scale of all curves, or what went wrong, for several sets of values at once."""
    jobs = [
        {
            index: experiment_job(study, index, values, folder, requests.get(index))
            for index, experiment in enumerate(study.experiments)
            if experiment.test is None
        }
        for values in points
    ]
    unique = {job.name: job for row in jobs for job in row.values()}
    records = {record["run"]: record for record in make_missing(list(unique.values()), workers, made)}
    misses: list[np.ndarray | StudyError] = []
    for row, values in zip(jobs, points, strict=True):
        try:
            parts = [
                scaled_differences(row[index], records[row[index].name], data, study, index)
                if index in row
                else _differences_by_law(study, index, values, data)
                for index, data in enumerate(measurements)
            ]
            misses.append(np.concatenate(parts))
        except StudyError as error:
            misses.append(error)
    return misses


def _differences_by_law(study: Calibration, index: int, values: Mapping[str, float], data: Measurement) -> np.ndarray:
    """(stress of the law - data) / scale of a specimen that was pulled or sheared."""
    own, where = _of_experiment(study, index), f"experiments.{index}.body"
    bodies = scene_with(own.scene, {**fixed_overrides(own), **values}, own.controller).soft_bodies
    name = study.experiments[index].body or next(iter(bodies), "")
    if name not in bodies:
        raise StudyError(f"{where} = {name!r}: is no soft body; there are: {', '.join(bodies)}")
    law, coefficients, ratio = bodies[name].law, bodies[name].coefficients, bodies[name].poisson_ratio
    if law != "hooke" and ratio < INCOMPRESSIBLE:
        raise StudyError(
            f"{where}: law '{law}' with poisson_ratio = {ratio:g}: the test of a specimen needs {INCOMPRESSIBLE:g} or "
            "more, or law 'hooke'"
        )
    is_tension = study.experiments[index].test == "tension"
    if coefficients is None:
        shear_modulus = bodies[name].young_moduli[0] / (3.0 if is_tension else 2.0 * (1.0 + ratio))
        hooke = {"young_modulus": 3.0 * shear_modulus}
        coefficients = hooke if law == "hooke" else RUBBER_LAWS[law].of_shear_modulus(shear_modulus)
    stress = nominal_stress if is_tension else shear_stress
    difference: np.ndarray = (stress(law, coefficients, data.over) - data.curves[0]) / data.scales[0]
    return difference


def _of_experiment(study: Calibration, index: int) -> Calibration:
    """The study with the scene and the changes of an experiment."""
    own = study.experiments[index]
    return study.model_copy(update={"scene": own.scene or study.scene, "set": (*study.set, *own.set)})


def statics(study: Calibration, index: int) -> tuple[tuple[str, ...], str]:
    """What makes every step of an experiment an equilibrium, for `set`, and a sentence that says so, or why not."""
    experiment, where = study.experiments[index], f"experiments.{index}"
    if experiment.test is not None:
        return (), f"{where}: {experiment.test} by the law of incompressible rubber"
    texts = [experiment.over, *(curve.quantity for curve in experiment.curves)]
    names = {name for text in texts for name in Expression(text, where).names}
    of_rates = any(part in name for name in names for part in ("time", "velocit", "flow"))
    of_rates |= any(key.rpartition(".")[2].startswith("rayleigh_") for key in study.parameters)
    if experiment.quasi_static is False or (experiment.quasi_static is None and of_rates):
        return (), ""
    study = _of_experiment(study, index)
    own = fixed_overrides(study) | {key: parameter.start for key, parameter in study.parameters.items()}
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


def experiment_job(
    study: Calibration,
    index: int,
    values: Mapping[str, float],
    folder: Path,
    gradient: Mapping[str, Any] | None = None,
) -> RunJob:
    """The run that stands for an experiment, with values of the parameters; `gradient` as of `RunJob`."""
    experiment, own = study.experiments[index], _of_experiment(study, index)
    changed = own.model_copy(
        update={
            "set": (*statics(study, index)[0], *own.set),
            "duration": experiment.duration or study.duration,
        }
    )
    watch = {OVER: experiment.over, **{str(n): curve.quantity for n, curve in enumerate(experiment.curves)}}
    return job_for(changed, values, folder, study.seed, watch=watch, gradient=gradient)


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
    rises = np.append(np.diff(over) > 0.0, True)  # of values that are held the last, where the run has come to rest
    if (np.diff(over) < -1e-9 * np.ptp(over)).any() or rises.sum() < 2:
        raise StudyError(
            f"experiments.{index}.over = '{study.experiments[index].over}': must not fall from step to step"
        )
    over = over[rises]
    # Observations are of the end of a step, requests of its beginning: data may reach one step beyond the run.
    before, after = over[1] - over[0], over[-1] - over[-2]
    if data.over[0] < over[0] - 1.001 * before or data.over[-1] > over[-1] + 1.001 * after:
        raise StudyError(
            f"experiments.{index}: the data lie from {data.over[0]:g} to {data.over[-1]:g}, and the run from "
            f"{over[0]:g} to {over[-1]:g}; change duration, first, last or shift"
        )
    return CurveDifferences(columns, compared(study, index, data)).values.ravel()


def compared(study: Calibration, index: int, data: Measurement) -> Compared:
    """The measurement of an experiment, as plain data."""
    relative = [curve.relative for curve in study.experiments[index].curves]
    return Compared(data.over.tolist(), data.curves.tolist(), data.scales.tolist(), relative)


def _split(residuals: np.ndarray, measurements: Sequence[Measurement]) -> list[np.ndarray]:
    """The residuals of each experiment, shape (curve_count, row_count)."""
    ends = np.cumsum([data.curves.size for data in measurements])
    parts = np.split(residuals, ends[:-1])
    return [part.reshape(data.curves.shape) for part, data in zip(parts, measurements, strict=True)]


def _values(study: Calibration, point: np.ndarray) -> dict[str, float]:
    """The values at a point of the unit cube, by key."""
    pairs = zip(study.parameters.items(), point, strict=True)
    return {key: float(f"{value_at(parameter, float(share)):.12g}") for (key, parameter), share in pairs}


def _intervals(
    study: Calibration, point: np.ndarray, slopes: np.ndarray, residuals: np.ndarray, correlation: float
) -> dict[str, tuple[float, float]]:
    """Lowest and highest value by key; beyond both bounds where the data say nothing."""
    half = np.minimum(half_widths(slopes, residuals, correlation), 1.0)
    return {
        key: (value_at(parameter, float(share - one)), value_at(parameter, float(share + one)))
        for (key, parameter), share, one in zip(study.parameters.items(), point, half, strict=True)
    }
