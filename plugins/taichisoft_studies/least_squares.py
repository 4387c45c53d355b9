"""Calibration: parameters whose runs repeat measured curves, by least squares on the runs of a study."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_studies.calibration_file import Calibration, Measurement, Parameter
from taichisoft_studies.curves_output import read_curves
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_folder import COMPLETED, LOG, read_record
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.scene_keys import scene_with
from taichisoft_studies.study_expressions import Expression
from taichisoft_studies.sweep_runs import fixed_overrides, job_for, make_missing
from taichisoft_studies.workers import Workers

CONFIDENCE = 0.95
OVER = "over"
AT_BOUND = 1e-4
"""Distance from a bound, as a share of the way between both, below which a value has come to it [-]."""
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


def calibrate(
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

    Raises:
        StudyError: a run failed where its residual is needed, or its curve does not reach as far as the data.
    """
    from scipy.optimize import least_squares

    evaluations = 0

    def residuals(points: Sequence[np.ndarray]) -> list[np.ndarray | StudyError]:
        return _residuals(study, measurements, folder, workers, [_values(study, point) for point in points])

    def cost(point: np.ndarray) -> np.ndarray:
        nonlocal evaluations
        (found,) = residuals([point])
        if isinstance(found, StudyError):
            if not evaluations:
                raise found
            return np.full(sum(one.curves.size for one in measurements), np.inf)  # scipy then takes a shorter step
        evaluations += 1
        tried(_values(study, point), float(0.5 * found @ found))
        return found

    def slopes(point: np.ndarray) -> np.ndarray:
        steps = study.difference * np.eye(len(point))
        forward, backward = np.minimum(point + steps, 1.0), np.maximum(point - steps, 0.0)
        found = residuals([*forward, *backward])
        for one in found:
            if isinstance(one, StudyError):
                raise one
        after, before = np.split(np.array(found), 2)
        change: np.ndarray = (after - before) / np.diag(forward - backward)[:, None]
        return change.T

    start = np.array([_share(one, one.start) for one in study.parameters.values()])
    found = least_squares(
        cost, start, slopes, bounds=(0.0, 1.0), xtol=STEP, ftol=1e-8, gtol=1e-10, max_nfev=study.most_steps
    )
    correlation = _correlation(found.fun, measurements)
    intervals = _intervals(study, found.x, found.jac, found.fun, correlation)
    differences = [
        parts * one.scales[:, None] for one, parts in zip(measurements, _split(found.fun, measurements), strict=True)
    ]
    residual = [np.sqrt((difference**2).mean(axis=1)).tolist() for difference in differences]
    modelled = [one.curves + difference for one, difference in zip(measurements, differences, strict=True)]
    return CalibrationFit(_values(study, found.x), intervals, residual, modelled, evaluations, correlation)


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
        said = (read_record(job.place) or {}).get("warnings", [])
        if said:
            first = next((one for one in said if "equilibrium" in one), said[0])
            more = f" ({len(said) - 1} more in its {LOG})" if len(said) > 1 else ""
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
    records = {one["run"]: one for one in make_missing(list(unique.values()), workers, lambda job, record: None)}
    found: list[np.ndarray | StudyError] = []
    for row in jobs:
        try:
            parts = [
                scaled_differences(job, records[job.name], one, study, index)
                for index, (job, one) in enumerate(zip(row, measurements, strict=True))
            ]
            found.append(np.concatenate(parts))
        except StudyError as error:
            found.append(error)
    return found


def statics(study: Calibration, index: int) -> tuple[tuple[str, ...], str]:
    """What makes every step of an experiment an equilibrium, for `set`, and a sentence that says so, or why not.

    Raises:
        SceneError, StudyError: it is asked for, and the scene cannot; or the scene is not valid.
    """
    experiment, where = study.experiments[index], f"experiments.{index}"
    texts = [experiment.over, *(one.quantity for one in experiment.curves)]
    names = {name for text in texts for name in Expression(text, where).names}
    of_rates = any(part in name for name in names for part in ("time", "velocit", "flow"))
    of_rates |= any(key.rpartition(".")[2].startswith("rayleigh_") for key in study.parameters)
    if experiment.quasi_static is False or (experiment.quasi_static is None and of_rates):
        return (), ""
    own = fixed_overrides(study.model_copy(update={"set": (*study.set, *experiment.set)}))
    own |= {key: one.start for key, one in study.parameters.items()}
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
    """The run that stands for an experiment, with values of the parameters.

    Raises:
        SceneError, StudyError: a key or value is not valid; it is named.
    """
    experiment = study.experiments[index]
    changed = study.model_copy(
        update={
            "set": (*statics(study, index)[0], *study.set, *experiment.set),
            "duration": experiment.duration or study.duration,
        }
    )
    watch = {OVER: experiment.over, **{str(n): one.quantity for n, one in enumerate(experiment.curves)}}
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

    Raises:
        StudyError: the run failed, or its curve does not reach as far as the data.
    """
    if record["status"] != COMPLETED:
        said = ", ".join(f"{key} = {value:g}" for key, value in job.parameters.items())
        raise StudyError(f"experiments.{index}: the run with {said}: {record['status']}: {record['message']}")
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
    ends = np.cumsum([one.curves.size for one in measurements])
    parts = np.split(residuals, ends[:-1])
    return [part.reshape(one.curves.shape) for part, one in zip(parts, measurements, strict=True)]


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
