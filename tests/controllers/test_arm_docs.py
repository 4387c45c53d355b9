"""docs/arm.md: its tables are those of the code, its script is one, and its scene is the shipped one."""

import re
import tomllib
from pathlib import Path

import pytest

from taichisoft.scene import data_folder, key_descriptions
from taichisoft_arm.arm_controller import AXES_KEY, MOVES, TURNS, ArmScript, ArmSettings, Move
from taichisoft_controllers.keyboard_controller import KeyboardSettings
from taichisoft_controllers.scripted_controller import LargestValues

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "arm.md").read_text(encoding="utf-8")
SCENE, STEPS = (tomllib.loads(block) for block in re.findall(r"^```toml\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE))


@pytest.mark.parametrize("table", [ArmSettings, Move])
def test_every_key_has_its_row(table):
    others = {*KeyboardSettings.model_fields, *LargestValues.model_fields}
    rows = [f"| `{key}` | {meaning} |" for key, meaning in key_descriptions(table).items() if key not in others]
    for row in rows:
        assert f"\n{' '.join(row.split())}\n" in PAGE
    assert len(re.findall(r"^\| `", PAGE, re.MULTILINE)) >= len(rows)


def test_the_scene_is_the_shipped_one_and_the_script_is_one():
    shipped = tomllib.loads((data_folder() / "scenes" / "pick-and-place.toml").read_text(encoding="utf-8"))
    assert SCENE["controller"] == shipped["controller"]
    assert len(ArmScript.model_validate(STEPS).steps or []) == 2


def test_every_key_is_named():
    keys = PAGE.partition("## Keys")[2].partition("## ")[0]
    named = set(re.findall(r"`(.)`", keys)) | {"up", "down", "left", "right"}
    assert {*MOVES, *TURNS, AXES_KEY, "?"} == named
