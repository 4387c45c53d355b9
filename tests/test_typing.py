"""mypy --strict passes examples and the controllers of the documents, and knows what users get."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from documents import ROOT, blocks

UNTYPED = "start.md"
"""Its controller is not annotated, to be short; the base class tells editors what it gets."""
USE = """
import numpy as np
import taichisoft
from taichisoft import Control, Controller, Observation


class Follow(Controller):
    def control(self, observation: Observation) -> Control:
        reveal_type(observation.tip_positions)
        return Control(base_translation=[1.0, 0.0, 0.0], gravity=(0, 0, -9810), pressure={"a": np.float64(1.0)})


simulation = taichisoft.Simulation(taichisoft.load_scene("gripper"))
report = simulation.step(Control(anchor_positions={"a": [[0.0, 0.0, 1.0]]}, frame_translation={"a": [0, 0, 1]}))
reveal_type(report.observation)
"""
FLAWS = """
from taichisoft import Control

Control(presure={"a": 1.0})
Control(pressure=[1.0])
"""


def complaints(folder: Path, *options: str) -> str:
    """What mypy --strict prints of the programs in a folder."""
    files = sorted(map(str, folder.glob("*.py")))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *options, *files], cwd=ROOT, capture_output=True, text=True
    )
    return done.stdout


def test_examples_pass() -> None:
    pytest.importorskip("mypy")
    assert "Success" in complaints(ROOT / "examples") and "Success" in complaints(ROOT / "examples" / "learning")


def test_controllers_of_documents_pass(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    for page in sorted((ROOT / "docs").glob("*.md")):
        folder = tmp_path / ("short" if page.name == UNTYPED else "typed")
        folder.mkdir(exist_ok=True)
        for number, (_, code) in enumerate(blocks(page)):
            if re.search(r"^class \w+\((taichisoft\.)?Controller\):", code, re.MULTILINE):
                (folder / f"{page.stem.replace('-', '_')}_{number}.py").write_text(code, encoding="utf-8")
    assert "Success: no issues found" in complaints(tmp_path / "typed")
    assert "Success" in complaints(tmp_path / "short", "--allow-untyped-defs")


def test_requests_and_results_have_types(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "use.py").write_text(USE, encoding="utf-8")
    known = complaints(tmp_path)
    assert "Success" in known and "Mapping[str, numpy.ndarray[" in known and "observation.Observation" in known
    (tmp_path / "use.py").write_text(FLAWS, encoding="utf-8")
    flaws = complaints(tmp_path)
    assert 'did you mean "pressure"?' in flaws and 'expected "Mapping[str, float]"' in flaws
