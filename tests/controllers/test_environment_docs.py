"""The Python of docs/environments.md runs as it stands; so does the example that learns, where it can."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PATIENCE

ROOT = Path(__file__).resolve().parents[2]


def test_the_first_example_and_the_arguments_and_wrappers_that_are_shown() -> None:
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
    pytest.importorskip("stable_baselines3")
    command = [sys.executable, str(ROOT / "examples/learning/learn_reach.py"), "--minutes", "0.05", "--processes", "1"]
    done = subprocess.run([*command, str(tmp_path)], capture_output=True, text=True, timeout=PATIENCE)
    assert re.search(r"^\d+ of 20 new targets reached within 3 mm$", done.stdout, re.MULTILINE), done.stderr
    written = {path.name for path in tmp_path.iterdir()}
    assert written >= {"policy.zip", "learning_curve.csv", "evaluation.csv", "reach.mp4"}
