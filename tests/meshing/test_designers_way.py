"""A designer's way: a STEP finger of two solids, its datasheet, a search over two scenes, a gripper, and a mould."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from solid_shapes import write_step
from test_step_solids import HEIGHT, LAYER, LENGTH, WIDTH, finger

from taichisoft.command_line import main
from taichisoft.running import plugins
from taichisoft_studies.least_squares import Calibration, experiment_job, fit_parameters, read_measurement
from taichisoft_studies.optimiser import Optimisation, best_trials, open_study
from taichisoft_studies.results_table import result_row, write_table
from taichisoft_studies.run_job import RunJob, make_run, read_curves
from taichisoft_studies.study_file import Sweep, check_study
from taichisoft_studies.sweep_runs import RUNS, make_missing, sweep_jobs
from taichisoft_studies.trials import run_trials

FINGER = """
gravity = [0.0, 0.0, 0.0]
time = { step = 0.02, duration = 0.1 }
controller = { name = "scripted", settings = { script = "inflate", pressure = 30.0 } }
limits = { pressure_rate = 400.0 }

[soft_bodies.finger]
mesh = { file = "finger.step", size = 10.0, set = { close_inlets = true } }
density = 1.1e-6
young_modulus = 100.0
poisson_ratio = 0.3
rayleigh_stiffness = 0.05
regions = [{ group = "solid_2", young_modulus = 1000.0 }]
anchors = [{ group = "base" }]
cavities = { cavity_0 = { group = "cavity_0" }, cavity_1 = { group = "cavity_1" } }
"""
GRIPPER = """
pattern = { count = 3, axis = "x", centre = [0.0, 6.0, -7.0] }

[goal]
object = "cube"
hold = 0.2

[rigid_bodies.cube]
box = [10.0, 10.0, 10.0]
mass = 0.005
position = [35.0, 6.0, -7.0]

[obstacles.table]
plane = { point = [41.2, 0.0, 0.0], normal = [-1.0, 0.0, 0.0] }
"""
LIFT = """
keyframes = [
    { time = 0.02, pressure = 0.0 },
    { time = 0.3, pressure = 15.0 },
    { time = 0.6, pressure = 15.0, base_translation = [-10.0, 0.0, 0.0] },
]
"""
GRIPPED = ["gravity=[9810.0, 0.0, 0.0]", "controller.settings={script='lift.toml'}", "time.duration=0.9"]
STIFFNESS = "soft_bodies.finger.young_modulus"
SEARCH = {
    "scene": "finger.toml",
    "scenes": {"free": {}, "soft": {"set": ["controller.settings.pressure=10"]}},
    "variables": {STIFFNESS: [100.0, 150.0, 300.0]},
    "objectives": {"bend": {"maximise": "free['final_bending_angles_degrees']['finger']"}},
    "constraints": {"still": "soft['largest_stretch']['finger'] <= 1.02"},
    "trials": 3,
}
BEND = {
    "scene": "finger.toml",
    "parameters": {STIFFNESS: {"start": 200.0, "low": 50.0, "high": 500.0, "log": True}},
    "experiments": [
        {
            "data": "bend.csv",
            "over": "pressures['finger.cavity_0']",
            "over_column": "Druck",
            "curves": [{"column": "Winkel", "quantity": "degrees(bending_angles['finger'])"}],
        }
    ],
}
WIDTHS = {
    "scene": "finger-inflated",
    "set": ["soft_bodies.finger.mesh={file='tutorial.toml', size=14}"],
    "duration": 0.04,
    "vary": {"body.width": [18.0, 22.0]},
}


def upper_part(occ: Any) -> None:
    """The upper part as it is cast: its chambers are open below, and the duct is pierced afterwards."""
    upper = (3, occ.addBox(0, 0, LAYER, LENGTH, WIDTH, HEIGHT - LAYER))
    occ.cut([upper], [(3, occ.addBox(4, 3, LAYER, 12, 6, 7)), (3, occ.addBox(22, 3, LAYER, 14, 6, 7))])


class OneAfterTheOther:
    """Workers that are this process."""

    count, about = 1, "here"

    def __init__(self) -> None:
        self.waiting: list[tuple[str, RunJob]] = []

    def submit(self, key: str, job: RunJob) -> None:
        self.waiting.append((key, job))

    def next_done(self) -> tuple[str, dict[str, Any]]:
        key, job = self.waiting.pop(0)
        return key, make_run(job)


def test_from_a_step_file_to_a_gripper_a_datasheet_and_a_mould(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def taichisoft(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["taichisoft", *words])
        with plugins.separate_registry(), pytest.raises(SystemExit) as left:
            main()
        said = "".join(capfd.readouterr())
        assert not left.value.code, said
        return said

    monkeypatch.chdir(tmp_path)
    write_step(tmp_path / "finger.step", finger)
    (tmp_path / "finger.toml").write_text(FINGER)
    taichisoft("characterise", "finger.toml", "--pressure", "8", "--steps", "2", "--bends", "1", "-o", "sheet")
    with (tmp_path / "sheet" / "characteristics.csv").open(newline="") as file:
        bends = [float(row["bending [degrees]"]) for row in csv.DictReader(file)]
    assert len(bends) == 3 and bends == sorted(bends) and bends[-1] > 0.1
    assert (tmp_path / "sheet" / "datasheet.html").stat().st_size > 1000

    study = check_study(Optimisation, SEARCH, "study")
    trials = open_study(study, tmp_path / "search")
    trials.set_user_attr("folder", str(tmp_path / "search"))
    run_trials(study, tmp_path / "search", trials, OneAfterTheOther(), lambda trial, record: None)  # type: ignore[arg-type]
    (best,) = best_trials(trials, 1)
    assert best.params[STIFFNESS] == "150.0", "100 kPa bends further, but breaks the rule for the other scene"

    (tmp_path / "gripper.toml").write_text(FINGER + GRIPPER)
    (tmp_path / "lift.toml").write_text(LIFT)
    chosen = [f"--set={one}" for one in (f"{STIFFNESS}={best.params[STIFFNESS]}", *GRIPPED)]
    taichisoft("run", "gripper.toml", "--outputs", "recording,metrics,pictures", "--image", *chosen, "-o", "grip")
    metrics = json.loads((tmp_path / "grip" / "metrics.json").read_text())
    assert metrics["object_lift_mm"] > 9.0, "of the 10 mm by which the base rises"
    holding = [metrics["final_friction_forces_mN"][f"finger{number}|cube"] for number in (1, 2, 3)]
    assert sum(holding) > 0.005 * 9810.0 and min(holding) > 1.0, "friction of all three carries its weight"
    red, _, blue = np.asarray(Image.open(tmp_path / "grip" / "lifted.png").convert("RGB"), dtype=int).transpose(2, 0, 1)
    assert (blue - red > 80).sum() > 500, "the cube is seen"

    write_step(tmp_path / "upper.step", upper_part)
    assert "fill the block" in taichisoft("mould", "upper.step", "--parting", "z=10", "-o", "mould")


def test_from_a_measured_bend_to_a_width_and_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_step(tmp_path / "finger.step", finger)
    (tmp_path / "finger.toml").write_text(FINGER)
    study, workers = check_study(Calibration, BEND, "study"), OneAfterTheOther()
    truth = experiment_job(study, 0, {STIFFNESS: 130.0}, tmp_path / "truth")
    make_missing([truth], workers)  # type: ignore[arg-type]
    curves = read_curves(truth.place)
    rows = zip(curves["over"].tolist(), curves["0"].tolist(), strict=True)
    lines = [f"{pressure};{bend}".replace(".", ",") for pressure, bend in rows]
    (tmp_path / "bend.csv").write_text("\n".join(["Druck (kPa);Winkel (deg)", *lines]) + "\n")
    measured = read_measurement(study.experiments[0], tmp_path / "bend.csv", "study")
    assert measured.curves[0, -1] > 1.0, "degrees: it bends"
    fit = fit_parameters(study, [measured], tmp_path / "fit", workers, lambda values, cost: None)  # type: ignore[arg-type]
    assert fit.values[STIFFNESS] == pytest.approx(130.0, rel=1e-3)

    jobs = sweep_jobs(check_study(Sweep, WIDTHS, "study"), tmp_path / "sweep")
    records = make_missing(jobs, workers)  # type: ignore[arg-type]
    narrow, wide = (record["metrics"]["rest_volumes_mm3"]["finger"] for record in records)
    assert wide > 1.05 * narrow
    write_table([result_row(record, f"{RUNS}/{record['run']}") for record in records], tmp_path / "sweep")
    monkeypatch.setattr(sys, "argv", ["taichisoft", "study", "report", "sweep"])
    with plugins.separate_registry(), pytest.raises(SystemExit) as left:
        main()
    assert not left.value.code, capfd.readouterr()
    assert "body.width" in (tmp_path / "sweep" / "report.html").read_text()
