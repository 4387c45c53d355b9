"""A designer's way by commands: a STEP finger of two solids, its datasheet, a search over two scenes, a negative."""

import csv
import subprocess
from pathlib import Path

from conftest import PATIENCE
from solid_shapes import write_step
from test_step_solids import finger

from taichisoft.child_process import PYTHON

SCENE = """
gravity = [0.0, 0.0, 0.0]
time = { step = 0.01, duration = 0.05 }
controller = { name = "scripted", settings = { script = "inflate", pressure = 8.0 } }

[soft_bodies.finger]
mesh = { file = "finger.step", size = 10.0, set = { close_inlets = true } }
element = "linear"
density = 1.1e-6
young_modulus = 100.0
poisson_ratio = 0.3
regions = [{ group = "solid_2", young_modulus = 1000.0 }]
anchors = [{ group = "base" }]
cavities = { cavity_0 = { group = "cavity_0" }, cavity_1 = { group = "cavity_1" } }
"""
STUDY = """
scene = "finger.toml"
trials = 1

[variables]
"soft_bodies.finger.regions.0.young_modulus" = { low = 300.0, high = 3000.0, log = true }

[scenes.free]
[scenes.blocked]
set = ["obstacles.block={box=[10.0, 20.0, 10.0], translation=[45.0, 6.0, -6.0]}"]

[objectives]
press = { maximise = "get(blocked['final_normal_forces_mN'], 'finger|block', 0)", unit = "mN" }

[constraints]
bends = "free['final_bending_angles_degrees']['finger'] >= 0.01"
"""


def taichisoft(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [*PYTHON, "-m", "taichisoft", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE)


def test_from_a_step_file_to_a_datasheet_a_search_and_a_negative(tmp_path: Path) -> None:
    write_step(tmp_path / "finger.step", finger)
    (tmp_path / "finger.toml").write_text(SCENE)
    (tmp_path / "study.toml").write_text(STUDY)
    made = taichisoft(
        tmp_path, "characterise", "finger.toml", "--pressure", "8", "--steps", "2", "--bends", "1", "-o", "c"
    )
    assert made.returncode == 0, made.stdout + made.stderr
    with (tmp_path / "c" / "characteristics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    bends = [float(row[next(column for column in row if "bend" in column)]) for row in rows]
    assert len(bends) > 2 and bends == sorted(bends) and bends[-1] > 0.1
    assert (tmp_path / "c" / "datasheet.html").stat().st_size > 1000
    made = taichisoft(tmp_path, "study", "optimise", "study.toml", "-o", "o", "--jobs", "1")
    assert made.returncode == 0, made.stdout + made.stderr
    with (tmp_path / "o" / "winners.csv").open(newline="") as file:
        (winner,) = csv.DictReader(file)
    assert float(winner["press"]) > 0.0
    made = taichisoft(tmp_path, "mould", "finger.step", "-o", "m")
    assert made.returncode == 1, "its chambers are undercuts of a mould of two halves"
    assert "undercut" in made.stderr and "a cavity of 588 mm^3 is closed" in made.stdout + made.stderr
