"""The Python of docs/environments.md runs as it stands; so does the example that learns, where it can."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PATIENCE

ROOT = Path(__file__).resolve().parents[2]


def test_documented_environments_and_wrappers_work() -> None:
    page = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict = {}
    exec(blocks[0], names)
    assert 0.0 < names["info"]["distance"] < 100.0
    for block in blocks[1:4]:  # the last starts processes
        exec(re.sub(r"\n *reduced=.*", "", block), names)  # the folder is what a command writes, which takes long
    squeeze = names["squeeze"]
    assert names["readings"] in squeeze.observation_space and names["reward"] < 0.0
    assert [one.name for one in squeeze.channels][-1] == "wanted force" and len(squeeze.action_channels) == 4
    assert names["environment"].unwrapped.scene.rigid_bodies["cube"].sphere.radius == 20.0


def test_the_example_that_learns_writes_what_it_says(tmp_path: Path) -> None:
    pytest.importorskip("cmaes", reason="needs the extra 'studies'")
    small = "--generations 1 --population 3 --episodes 1 --processes 1 --trials 1"
    command = [sys.executable, str(ROOT / "examples/learning/learn.py"), "Reach", *small.split(), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    for policy in ("learned", "scripted"):
        assert re.search(rf"^Reach-v0, {policy}: [01] of 1 succeed; return -", done.stdout, re.MULTILINE), done.stderr
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"reach.json", "reach.csv", "reach.svg", "reach-evaluation.csv", "reach.mp4"}
    for path in (ROOT / "examples/learning").glob("*.json"):
        policy = json.loads(path.read_text(encoding="utf-8"))
        count = {"Reach": 8, "Grasp": 8, "Carry": 7}[policy["task"]]
        assert len(policy["weights"]) == count and policy["task"].lower() == path.stem
