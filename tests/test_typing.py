"""mypy --strict passes examples and the controllers of the documents, and knows what users get."""

import re
import subprocess
import sys

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


@pytest.fixture(scope="module")
def complaints(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What mypy --strict prints of the examples, the controllers of the documents, and the programs above."""
    pytest.importorskip("mypy")
    folder = tmp_path_factory.mktemp("programs")
    (folder / "use.py").write_text(USE, encoding="utf-8")
    (folder / "flaws.py").write_text(FLAWS, encoding="utf-8")
    for page in sorted((ROOT / "docs").glob("*.md")):
        for number, (_, code) in enumerate(blocks(page)):
            if re.search(r"^class \w+\((taichisoft\.)?Controller\):", code, re.MULTILINE):
                options = "# mypy: allow-untyped-defs\n" if page.name == UNTYPED else ""
                file = folder / f"{page.stem.replace('-', '_')}_{number}.py"
                file.write_text(options + code, encoding="utf-8")
    files = [*(ROOT / "examples").rglob("*.py"), *folder.glob("*.py")]
    command = [sys.executable, "-m", "mypy", "--strict", *map(str, files)]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout
    assert f"(checked {len(files)} source files)" in printed
    return printed


def test_examples_and_documents_have_no_error(complaints: str) -> None:
    assert [line for line in complaints.splitlines() if ": error: " in line and "flaws.py" not in line] == []


def test_requests_and_results_have_types(complaints: str) -> None:
    assert "Mapping[str, numpy.ndarray[" in complaints and "observation.Observation" in complaints
    assert 'did you mean "pressure"?' in complaints and 'expected "Mapping[str, float]"' in complaints
