"""docs/controllers.md, section "Scripted": its tables are those of the code, and its examples do what it says."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import controller_of, follow, made_up_model, write
from pydantic import BaseModel

from taichisoft import Controller, Observation
from taichisoft.errors import ControllerFailed
from taichisoft.scene import data_folder, key_descriptions
from taichisoft_controllers.script_file import Keyframe, Step
from taichisoft_controllers.scripted_controller import ScriptSettings, scripted_controller

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "controllers.md"
SECTION = re.split(r"^## ", DOCUMENT.read_text(encoding="utf-8").partition("\n## Scripted\n")[2], flags=re.MULTILINE)[0]
FINGERS = ("finger1.cavity", "finger2.cavity", "finger3.cavity")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", SECTION, re.DOTALL | re.MULTILINE)


def controller(folder: Path, content: str, name: str = "script.toml", **settings: Any) -> Controller:
    made = scripted_controller(write(folder, content, name), **settings)
    made.reset(made_up_model(FINGERS))
    return made


@pytest.mark.parametrize("table", [ScriptSettings, Keyframe, Step])
def test_every_key_has_its_row(table: type[BaseModel]) -> None:
    """A row has the docstring of its key, or stands for several keys."""
    joined = {
        key for row in re.findall(r"^\| (`\w+`, [^|]*) \|", SECTION, re.MULTILINE) for key in re.findall(r"\w+", row)
    }
    for key, meaning in key_descriptions(table).items():
        assert key in joined or f"| `{key}` | {meaning} |\n" in SECTION, key


def test_every_toml_is_a_script(tmp_path: Path) -> None:
    scripts = blocks("toml")
    assert len(scripts) == 3
    for content in scripts:
        controller(tmp_path, content)


def test_the_steps_are_those_of_the_shipped_script() -> None:
    shipped = (data_folder() / "scripts" / "grasp-until-contact.toml").read_text(encoding="utf-8")
    assert shipped in blocks("toml")


def test_the_csv_is_the_same_as_the_toml(tmp_path: Path) -> None:
    (table,) = blocks("csv")
    one = controller(tmp_path, blocks("toml")[0])
    other = controller(tmp_path, table, "script.csv", interpolation="smooth")
    for time in np.arange(0.0, 3.0, 0.05):
        asked, same = (each.control(Observation(time, 0)) for each in (one, other))
        assert asked.pressure == same.pressure
        np.testing.assert_array_equal(asked.base_translation, same.base_translation)
        np.testing.assert_array_equal(asked.base_rotation, same.base_rotation)


def test_a_failure_reads_as_it_is_shown(tmp_path: Path) -> None:
    (shown,) = blocks("text")
    script = '[[steps]]\nhold = 0.2\n[[steps]]\nname = "close"\nuntil = "contact_force > 60"\ntimeout = 3.0'
    with pytest.raises(ControllerFailed) as failed:
        follow(controller_of(tmp_path, script, "my-script.toml"), 5.0, lambda time: 12.25)
    assert shown.strip() == f"taichisoft: {failed.value}".replace(f"{tmp_path}/", "")


def test_every_expression_in_the_text_can_be_asked_for(tmp_path: Path) -> None:
    """What stands in code quotes and has brackets or a comparison is a condition, or a part of one."""
    written = re.findall(r"`([a-z_]+\[\"[^`]*\"\])`", SECTION)
    assert len(written) == 5
    conditions = [f"{quantity} > 0" for quantity in written] + re.findall(r"`until = \"([^`]*)\"`", SECTION)
    conditions += re.findall(r"`([0-9]+ < [a-z]+ < [0-9]+)`", SECTION)
    assert len(conditions) == 7
    for condition in conditions:
        controller(tmp_path, f"[[steps]]\nuntil = '{condition}'\ntimeout = 1.0")
