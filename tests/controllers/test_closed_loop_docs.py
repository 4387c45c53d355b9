"""The pages about the closed loop: settings and phases are those in the code."""

import re
from pathlib import Path

from taichisoft.scene import key_descriptions
from taichisoft_controllers.closed_loop import Phase
from taichisoft_controllers.grasp_sensing import GraspSettings

DOCS = Path(__file__).resolve().parents[2] / "docs"
GUIDE = (DOCS / "controllers.md").read_text(encoding="utf-8").partition("\n## Closed-loop\n")[2]
NOTES = (DOCS / "notes" / "experiments.md").read_text(encoding="utf-8")


def test_every_setting_has_its_row() -> None:
    meanings, fields = key_descriptions(GraspSettings), GraspSettings.model_fields
    rows = [f"| `{key}` | {fields[key].default} | {meaning} |" for key, meaning in meanings.items()]
    assert "|---|---|---|\n" + "\n".join(rows) + "\n" in GUIDE


def test_every_phase_has_its_number() -> None:
    for phase in Phase:
        assert re.search(rf"\b{phase.value} {phase.name.lower()}\b", GUIDE)


def test_commands_name_settings() -> None:
    commands = "".join(re.findall(r"^```sh\n(.*?)^```$", NOTES, re.DOTALL | re.MULTILINE))
    assert set(re.findall(r"controller\.settings\.(\w+)=", commands)) <= set(GraspSettings.model_fields)
