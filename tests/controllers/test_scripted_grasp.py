"""Scripts that wait, from the command line: the shipped one grasps the cube, one that waits in vain fails the run."""

import csv
import json
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from conftest import Command
from made_up import write

DOCS = Path(__file__).resolve().parents[2] / "docs"


def column(folder: Path, name: str) -> list[float]:
    with (folder / "run.csv").open(newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]


def test_the_shipped_script_grasps_by_force_lifts_and_holds(command: Command, tmp_path: Path) -> None:
    """Without a pressure in it that was found by trying."""
    arguments = ["run", "gripper", "--output", str(tmp_path), "--outputs", "metrics,csv", "--duration", "5.6"]
    code, _, _ = command(*arguments, "--set", "controller.settings.script=grasp-until-contact")
    assert code == 0
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["held"] is True
    assert metrics["object_lift_mm"] == pytest.approx(column(tmp_path, "lift cube [mm]")[-1], abs=0.1)

    step, pressure = column(tmp_path, "signal script_step"), column(tmp_path, "pressure finger1.cavity [kPa]")
    force = [
        sum(forces)
        for forces in zip(*(column(tmp_path, f"normal_force finger{n}|cube [mN]") for n in (1, 2, 3)), strict=True)
    ]
    squeezed = next(index for index, value in enumerate(force) if value > 500.0)
    assert step[-1] == 5.0  # all done
    assert max(force[:squeezed]) <= 500.0 < force[squeezed]
    assert pressure[squeezed] == pytest.approx(pressure[-1], rel=1e-6)  # it stopped there
    lifting = step.index(3.0)
    assert max(map(abs, column(tmp_path, "base_translation x [mm]")[:lifting])) == 0.0


def test_failed_condition_keeps_what_was_computed(command: Command, tmp_path: Path) -> None:
    folder = tmp_path / "out" / "gripper"
    script = write(tmp_path, '[[steps]]\nname = "close"\nuntil = "contact_force > 60"\ntimeout = 0.1')
    arguments = ["run", "gripper", "--output", str(folder), "--outputs", "recording,metrics,csv"]
    code, _, errors = command(*arguments, "--set", f"controller.settings.script={script}")
    said = errors.splitlines()[-1]
    assert code == 1
    assert said == (
        f"taichisoft: {script}: steps.0 'close': until = 'contact_force > 60' was not true within 0.1 s; "
        "at 0.1 s: contact_force = 0 mN"
    )
    assert column(folder, "time [s]") == pytest.approx([0.01 * (step + 1) for step in range(10)])
    assert json.loads((folder / "metrics.json").read_text())["outcome"] == said.removeprefix("taichisoft: ")


def test_the_programs_of_the_documents_read_what_a_run_leaves(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    push = 'external_forces=[{body="cube", force=[-1.0, 0.0, 0.0], start=0.01, duration=0.02}]'
    arguments = ["run", "gripper", "--controller", "closed-loop", "--outputs", "csv", "--duration", "0.05"]
    code, _, _ = command(*arguments, "--set", push)
    assert code == 0
    names = execute("controllers.md")
    assert names["lift"].tolist() == column(tmp_path / "out" / "gripper", "lift cube [mm]")
    assert len(names["force"]) == 5
    with matplotlib.rc_context():
        runpy.run_path(str(DOCS / "pictures.py"))["draw_closed_loop"](Path("out/gripper"), tmp_path / "drawn.svg")
    drawn = (tmp_path / "drawn.svg").read_text(encoding="utf-8")
    for text in ("signal set_point", "lift cube [mm]", "slip [mm/s]", "time [s]", "#d62728"):
        assert text in drawn


def execute(page: str) -> dict[str, Any]:
    """Run the first Python program of a page; returns its names."""
    text = (DOCS / page).read_text(encoding="utf-8")
    program, *_ = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    names: dict[str, Any] = {}
    exec(program, names)
    return names
