"""A designer's way by commands: a STEP finger of two solids, its datasheet, and what its negative cannot cast."""

import csv
import sys
from pathlib import Path

import pytest
from solid_shapes import write_step
from test_step_solids import finger

from taichisoft.command_line import main
from taichisoft.plugin_system import plugins

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


def test_from_a_step_file_to_a_datasheet_and_a_negative(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """tests/studies has the search over several scenes, tests/meshing/test_mould.py the mould of a finger."""

    def taichisoft(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["taichisoft", *words])
        with plugins.separate_registry(), pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0), "".join(capfd.readouterr())

    monkeypatch.chdir(tmp_path)
    write_step(tmp_path / "finger.step", finger)
    (tmp_path / "finger.toml").write_text(SCENE)
    code, said = taichisoft("characterise", "finger.toml", "--pressure", "8", "--steps", "2", "--bends", "1", "-o", "c")
    assert code == 0, said
    with (tmp_path / "c" / "characteristics.csv").open(newline="") as file:
        bends = [float(row["bending [degrees]"]) for row in csv.DictReader(file)]
    assert len(bends) == 3 and bends == sorted(bends) and bends[-1] > 0.1
    assert (tmp_path / "c" / "datasheet.html").stat().st_size > 1000
    code, said = taichisoft("mould", "finger.step", "-o", "m")
    assert code == 1, "its chambers are undercuts of a mould of two halves"
    assert "undercut" in said and "a cavity of 588 mm^3 is closed" in said
