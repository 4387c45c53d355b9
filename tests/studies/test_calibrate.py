"""Calibration: data that a run made give back what made them; bounds, failures and wrong files are told."""

import csv
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from studies import PLUGIN, Here

from taichisoft import load_plugin
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_from_toml
from taichisoft_studies.errors import StudyError
from taichisoft_studies.least_squares import (
    Calibration,
    CalibrationFit,
    Experiment,
    Measurement,
    Parameter,
    complaints,
    experiment_job,
    fit_parameters,
    gradient_requests,
    misfits,
    read_measurement,
    scaled_differences,
    statics,
)
from taichisoft_studies.run_job import read_curves
from taichisoft_studies.study_file import check_study
from taichisoft_studies.sweep_runs import job_for, make_missing

pytestmark = pytest.mark.usefixtures("taichisoft_plugins")

MODULUS, DAMPING = "soft_bodies.left.young_modulus", "soft_bodies.left.rayleigh_stiffness"
TIP = "tip_positions['left'][0]"
TRUE = {MODULUS: 130.0, DAMPING: 0.05}
OVER_PRESSURE = {"over": "pressures['left.cavity']", "curves": [{"column": "x", "quantity": TIP}]}
BEND = Experiment(over_column="t", curves=({"column": "d", "quantity": TIP},))  # type: ignore[arg-type]


def calibration_of(folder: Path, **tables: Any) -> Calibration:
    plugin = folder / "squeeze.py"
    plugin.write_text(PLUGIN)
    load_plugin(plugin)
    base = {
        "scene": str(TINY_GRIPPER),
        "controller": "squeeze",
        "duration": 0.3,
        "plugins": [str(plugin)],
        "set": ["soft_bodies.left.tip={box=[[-1000.0, -1000.0, -1000.0], [1000.0, 1000.0, 1000.0]]}"],
        "parameters": {
            MODULUS: {"start": 70.0, "low": 40.0, "high": 400.0, "log": True},
            DAMPING: {"start": 0.01, "low": 0.001, "high": 0.2, "log": True},
        },
        "experiments": [{"data": "tip.csv", "curves": [{"column": "tip_mm", "quantity": TIP, "relative": True}]}],
    }
    return check_study(Calibration, {**base, **tables}, "study")


def made_data(study: Calibration, folder: Path, noise: float) -> Measurement:
    """The curve of a run with the true values, with errors of measurement [mm]."""
    job = job_for(study, TRUE, folder / "truth", 1, watch={"time": "time", "tip": TIP})
    (record,) = make_missing([job], Here())
    assert record["status"] == "completed", record
    curves = read_curves(job.place)
    tip = curves["tip"] + noise * np.random.default_rng(2).standard_normal(len(curves["tip"]))
    with (folder / "tip.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["time", "tip_mm"], *zip(curves["time"], tip, strict=True)])
    return read_measurement(study.experiments[0], folder / "tip.csv", "experiments.0")


def test_fit_finds_what_made_the_data(tmp_path: Path, figures: Figures) -> None:
    """Modulus and damping of a pad from the motion of its nodes, within 2 %; the tip moves by some millimetres."""
    study = calibration_of(tmp_path)
    data = made_data(study, tmp_path, noise=0.0)
    fit = fit_parameters(study, [data], tmp_path, Here(), lambda values, cost: None)
    for key, value in TRUE.items():
        figures.close(f"{key}, found and true", fit.values[key], value, 0.02 * value)
    assert fit.residuals[0][0] < 1e-3 * np.ptp(data.curves)
    np.testing.assert_allclose(fit.modelled[0], data.curves, atol=1e-2 * np.ptp(data.curves))


def test_interval_of_noisy_data_holds_the_truth(tmp_path: Path) -> None:
    """One draw of noise, 2 % of the motion: an interval of 95 % holds the true value, and is wider than none at all."""
    study = calibration_of(tmp_path)
    clean = made_data(study, tmp_path, noise=0.0)
    noise = 0.02 * float(np.ptp(clean.curves))
    fit = fit_parameters(study, [made_data(study, tmp_path, noise)], tmp_path, Here(), lambda values, cost: None)
    for key, value in TRUE.items():
        low, high = fit.intervals[key]
        assert low < value < high
        assert 1.001 < high / low < 3.0
    assert fit.residuals[0][0] == pytest.approx(noise, rel=0.4)


def test_warnings_of_the_fitted_run_name_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, the unstable equilibrium first; the same warning in a second run of the process counts again."""

    def simulate(*_: Any) -> None:
        for line in ("something else", "at 0.1 s the equilibrium is unstable"):
            warnings.warn(line, stacklevel=1)

    monkeypatch.setattr("taichisoft_studies.run_job._simulate", simulate)
    study = calibration_of(tmp_path)
    for modulus in (130.0, 140.0):
        values = {**TRUE, MODULUS: modulus}
        job = experiment_job(study, 0, values, tmp_path)
        with pytest.warns(UserWarning, match="unstable"):
            make_missing([job], Here())
        fit = CalibrationFit(values, {}, [], [], 1, 0.0)
        (told,) = complaints(study, fit, tmp_path)
        assert f"run {job.name}: at 0.1 s the equilibrium is unstable (1 more in its log.txt)" in told


def test_rows_are_chosen_shifted_and_computed(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("t,a-1,b\n0,1,10\n1,2,20\n2,4,30\n3,9,40\n")
    (experiment,) = calibration_of(
        tmp_path,
        experiments=[
            {
                "over_column": "t",
                "first": 1.5,
                "last": 3.0,
                "shift": 0.5,
                "curves": [{"column": "columns['a-1'] + b", "quantity": TIP, "relative": True, "scale": 2.0}],
            }
        ],
    ).experiments
    data = read_measurement(experiment, tmp_path / "d.csv", "experiments.0")
    assert data.over.tolist() == [1.5, 2.5]
    assert data.curves.tolist() == [[0.0, 12.0]]
    assert data.scales.tolist() == [2.0]


@pytest.mark.parametrize(
    "text",
    [
        "t;d\n0,5;1\n1,5;2,25\n",
        "t\td\n0,5\t1\n1,5\t2,25\n",
        "Probe 3;27.11.2026\n\nd;t\nmm;s\n1;0,5\n2,25;1,5\n",
        "\ufefft ; d\r\n0.5;1.0\r\n\r\n1.5;2.25\r\n",
        't,d\n0.5,"1"\n1.5,2.25\n',
    ],
)
def test_semicolons_tabs_and_decimal_commas_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "d.csv").write_text(text, encoding="utf-8")
    data = read_measurement(BEND, tmp_path / "d.csv", "experiments.0")
    assert data.over.tolist() == [0.5, 1.5] and data.curves.tolist() == [[1.0, 2.25]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "t,d\n0,5,1\n1,5,2\n",
            r"d\.csv, line 2: has 3 cells for 2 columns; where commas are in the numbers, semicolons",
        ),
        ("t;d\n0;1\n1;nan\n", "line 3: a value is not finite"),
        ("t;d\n0;1\n1\n", "line 3: '1' lacks a number, column 2 'd'"),
        ("t;d\n0,5;1\n1.5;2\n", "line 2: '0,5;1' lacks a number, column 1 't'"),
        ("t,d,d\n0,1,2\n1,2,3\n", "two columns are called 'd'; give the number of one"),
        ("\n\n", "no numbers follow the names"),
    ],
)
def test_data_without_numbers_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(StudyError, match=said) as refused:
        read_measurement(BEND, tmp_path / "d.csv", "experiments.0")
    assert "\n" not in str(refused.value)


def test_data_beyond_the_run_are_refused(tmp_path: Path) -> None:
    data = Measurement(np.array([0.0, 5.0]), np.array([[0.0, 1.0]]), np.ones(1), np.zeros(1))
    with pytest.raises(StudyError, match=r"experiments.0: the data lie from 0 to 5, and the run from 0.01 to 0.02"):
        fit_parameters(calibration_of(tmp_path, duration=0.02), [data], tmp_path, Here(), lambda values, cost: None)


def test_tension_and_shear_give_one_modulus(tmp_path: Path) -> None:
    """A neo-Hookean body of mu = 60 kPa, both in one fit: tension mu (l - l^-2), as a force on 10 mm^2; shear mu g."""
    stretch, shear = np.linspace(1.0, 2.0, 20).tolist(), np.linspace(0.0, 1.0, 20).tolist()
    rows = [f"{one - 1.0:.6f};{0.6 * (one - one**-2):.6f}".replace(".", ",") for one in stretch]
    (tmp_path / "pull.csv").write_text("Dehnung;Kraft (N)\n" + "\n".join(rows))
    (tmp_path / "shear.csv").write_text("".join(f"{one}\t{60.0 * one}\n" for one in shear))
    scene = PAD.replace("MESH", str(TINY_GRIPPER.parent / "pad.msh"))
    scene = scene.replace("poisson_ratio = 0.3", 'poisson_ratio = 0.4999\nlaw = "neo-hookean"')
    (tmp_path / "pad.toml").write_text(scene + 'anchors = [{ group = "base" }]')
    tests = [
        {"test": "tension", "columns": {"force": "Kraft"}, "area": 10.0},
        {"test": "shear", "columns": {"strain": "1", "stress": "2 (kPa)"}},
    ]
    key = "soft_bodies.left.young_modulus"
    study = check_study(
        Calibration,
        {
            "scene": str(tmp_path / "pad.toml"),
            "parameters": {key: {"start": 60.0, "low": 15.0, "high": 600.0, "log": True}},
            "experiments": tests,
        },
        "study",
    )
    files = [tmp_path / "pull.csv", tmp_path / "shear.csv"]
    data = [read_measurement(one, file, "study") for one, file in zip(study.experiments, files, strict=True)]
    fit = fit_parameters(study, data, tmp_path, Here(), lambda values, cost: None)
    assert fit.values[key] == pytest.approx(180.0, rel=2e-4)
    low, high = fit.intervals[key]
    assert low <= 1.0002 * 180.0 and 1.0002 * high >= 180.0 and high < 1.01 * low
    compressible = study.model_copy(update={"set": ("soft_bodies.left.poisson_ratio=0.3",)})
    with pytest.raises(StudyError, match=r"study: columns strain=3: .* has no such column; there are: 1 'Dehnung', 2"):
        read_measurement(study.experiments[0].model_copy(update={"columns": {"strain": "3"}}), files[0], "study")
    with pytest.raises(StudyError, match=r"experiments.0.body: law 'neo-hookean' with poisson_ratio = 0.3"):
        fit_parameters(compressible, data, tmp_path, Here(), lambda values, cost: None)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"test": "tension", "quasi_static": True}, "quasi_static would have no effect beside test"),
        ({**OVER_PRESSURE, "area": 2.0}, "area would have no effect unless test"),
        ({"curves": OVER_PRESSURE["curves"], "test": "shear"}, "either curves of a run, or a test of a specimen"),
        ({}, "either curves of a run, or a test of a specimen"),
        ({"test": "bending"}, "tension"),
    ],
)
def test_keys_of_other_experiments_are_refused(keys: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Experiment.model_validate(keys)


def test_values_held_at_the_end_of_a_ramp_are_fitted(tmp_path: Path) -> None:
    """What a curve is drawn over stays the same where a ramp has ended: its last row counts."""
    study = calibration_of(
        tmp_path,
        experiments=[
            {
                "over": "min(time, 0.2)",
                "over_column": "t",
                "curves": [{"column": "x", "quantity": "min(time, 0.2) * 3"}],
            }
        ],
        duration=0.3,
    )
    (tmp_path / "d.csv").write_text("t;x\n0,05;0,15\n0,1;0,3\n0,2;0,6\n")
    data = read_measurement(study.experiments[0], tmp_path / "d.csv", "study")
    job = experiment_job(study, 0, TRUE, tmp_path)
    (record,) = make_missing([job], Here())
    np.testing.assert_allclose(scaled_differences(job, record, data, study, 0), 0.0, atol=1e-9)


PAD = """
controller = { name = "scripted", settings = { script = "inflate", pressure = 6.0 } }
time = { step = 0.05, duration = 0.2, theta = 0.5 }
[soft_bodies.left]
mesh = "MESH"
density = 1e-6
young_modulus = 100.0
poisson_ratio = 0.3
tip = { box = [[-1000.0, -1000.0, -1000.0], [1000.0, 1000.0, 1000.0]] }
cavities = { cavity = { group = "cavity" } }
"""


@pytest.mark.parametrize(
    ("experiment", "parameter", "anchored", "dynamics", "said"),
    [
        (OVER_PRESSURE, MODULUS, True, "static", "every step is an equilibrium; quasi_static = false"),
        ({**OVER_PRESSURE, "over": "time"}, MODULUS, True, "inertial", ""),
        (OVER_PRESSURE, DAMPING, True, "inertial", ""),
        ({**OVER_PRESSURE, "quasi_static": False}, MODULUS, True, "inertial", ""),
        ({**OVER_PRESSURE, "set": ["time.dynamics=inertial"]}, MODULUS, True, "inertial", ""),
        (OVER_PRESSURE, MODULUS, False, "inertial", "no step can be an equilibrium: "),
        ({**OVER_PRESSURE, "quasi_static": True}, MODULUS, False, None, "needs anchors of every soft body"),
    ],
)
def test_data_without_rates_need_equilibria(
    tmp_path: Path, experiment: dict[str, Any], parameter: str, anchored: bool, dynamics: str | None, said: str
) -> None:
    """And one for data over time, for a damping, or where the study says so, is a motion."""
    text = PAD.replace("MESH", str(TINY_GRIPPER.parent / "pad.msh"))
    (tmp_path / "pad.toml").write_text(text + 'anchors = [{ group = "base" }]' * anchored)
    study = check_study(
        Calibration,
        {
            "scene": str(tmp_path / "pad.toml"),
            "parameters": {parameter: {"start": 0.1, "low": 0.05, "high": 400.0}},
            "experiments": [experiment],
        },
        "study",
    )
    if dynamics is None:
        with pytest.raises(SceneError, match=said):
            statics(study, 0)
        return
    assert said in statics(study, 0)[1] and bool(said) == bool(statics(study, 0)[1])
    job = experiment_job(study, 0, {parameter: 100.0}, tmp_path)
    assert scene_from_toml(job.scene, "job").time.dynamics == dynamics


def test_residual_far_above_the_noise_is_a_hint(tmp_path: Path) -> None:
    """The noise of a parabola with errors of 0.1 is found within a third, whatever the distances of its rows."""
    random = np.random.default_rng(3)
    over = np.sort(random.uniform(0.0, 10.0, 200))
    (tmp_path / "d.csv").write_text(
        "p,y\n" + "".join(f"{p},{p**2 + 0.1 * e}\n" for p, e in zip(over, random.standard_normal(200), strict=True))
    )
    experiment = Experiment.model_validate({"over_column": "p", "curves": [{"column": "y", "quantity": "1"}]})
    data = read_measurement(experiment, tmp_path / "d.csv", "experiments.0")
    assert data.noise[0] == pytest.approx(0.1, rel=0.3)
    study = Calibration.model_construct(experiments=(experiment,))
    fits = [CalibrationFit({}, {}, [[residual]], [], 1, 0.0) for residual in (0.1, 0.9, 5.0)]
    assert [len(list(misfits(study, [data], fit))) for fit in fits] == [0, 0, 1], "1 % of the range is 1"
    for low, near in ((1.0, 3.9), (0.0, 0.001)):
        bounded = study.model_copy(update={"parameters": {MODULUS: Parameter(start=2.0, low=low, high=4.0)}})
        ends = [CalibrationFit({MODULUS: value}, {}, [[0.1]], [], 1, 0.0) for value in (low + 1e-5, near, 3.99999)]
        hints = [" ".join(misfits(bounded, [data], fit)) for fit in ends]
        assert f"its bound, low = {low:g}" in hints[0] and not hints[1] and "its bound, high = 4" in hints[2]


FRICTION = "contact.friction"
PUSHED = {MODULUS: 130.0, DAMPING: 0.05, FRICTION: 0.4}
"""Of a pad that is inflated against a slanted wall and slides along it."""


def pushed_pad(folder: Path) -> Calibration:
    scene = PAD.replace("MESH", str(TINY_GRIPPER.parent / "pad.msh")).replace("pressure = 6.0", "pressure = 7.0")
    scene = scene.replace("step = 0.05, duration = 0.2, theta = 0.5", "step = 0.01, duration = 0.2")
    scene += """
anchors = [{ group = "base" }]
[contact]
tolerance = 1e-10
[obstacles.wall]
plane = { point = [27.3, 0.0, 0.0], normal = [-0.8, 0.0, 0.6] }
"""
    (folder / "pad.toml").write_text(scene)
    curves = [{"column": "x", "quantity": f"{TIP} ** 2 / 10"}, {"column": "z", "quantity": TIP[:-2] + "2]"}]
    curves[1]["relative"] = True
    parameters = {
        MODULUS: {"start": 100.0, "low": 60.0, "high": 300.0, "log": True},
        DAMPING: {"start": 0.03, "low": 0.01, "high": 0.2, "log": True},
        FRICTION: {"start": 0.3, "low": 0.1, "high": 0.8},
    }
    tables = {"scene": str(folder / "pad.toml"), "method": "gradient", "parameters": parameters}
    study = check_study(Calibration, {**tables, "experiments": [{"curves": curves}]}, "study")
    watch = {"time": "time", **{curve.column: curve.quantity for curve in study.experiments[0].curves}}
    job = job_for(study, PUSHED, folder / "truth", 1, watch=watch)
    (record,) = make_missing([job], Here())
    assert record["status"] == "completed", record
    made = read_curves(job.place)
    columns = np.array([made[name] for name in watch])
    np.savetxt(
        folder / "pad.csv",
        0.5 * (columns[:, 1:] + columns[:, :-1]).T,
        "%.17g",
        ",",
        header=",".join(watch),
        comments="",
    )
    return study


def test_gradient_of_squares_agrees_with_differences(tmp_path: Path, figures: Figures) -> None:
    """Away from the truth, by all parameters at once; differences over 1e-5 of each are exact to some 1e-8."""
    study = pushed_pad(tmp_path)
    data = read_measurement(study.experiments[0], tmp_path / "pad.csv", "experiments.0")
    requests = gradient_requests(study, [data])
    values = {key: parameter.start for key, parameter in study.parameters.items()}

    def half_squares(changed: dict[str, float]) -> float:
        job = experiment_job(study, 0, {**values, **changed}, tmp_path)
        (record,) = make_missing([job], Here())
        misses = scaled_differences(job, record, data, study, 0)
        return float(0.5 * misses @ misses)

    (record,) = make_missing([experiment_job(study, 0, values, tmp_path, requests[0])], Here())
    assert record["status"] == "completed", record
    for key, value in values.items():
        sides = [half_squares({key: (1.0 + sign * 1e-5) * value}) for sign in (1.0, -1.0)]
        expected = (sides[0] - sides[1]) / (2e-5 * value)
        figures.close(f"gradient by {key}", record["metrics"]["gradient"][key], expected, 1e-6 * abs(expected))


def test_gradient_finds_what_made_the_data(tmp_path: Path, figures: Figures) -> None:
    """Modulus, damping and friction of a pad against a wall at once, without noise."""
    study = pushed_pad(tmp_path)
    data = read_measurement(study.experiments[0], tmp_path / "pad.csv", "experiments.0")
    workers = Here()
    fit = fit_parameters(study, [data], tmp_path, workers, lambda values, cost: None)
    for key, value in PUSHED.items():
        figures.close(f"{key}, found and true", fit.values[key], value, 1e-6 * value)
    assert len(workers.made) < 7 * fit.evaluations  # of which those of differences have six more runs
