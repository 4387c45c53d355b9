"""docs/controllers.md, section "Closed-loop": the tuning that it explains is the one in the code."""

import re
from pathlib import Path

from taichisoft.scenes.shipped import data_folder
from taichisoft_controllers.closed_loop.grasp_sequence import Phase
from taichisoft_controllers.closed_loop.grasp_settings import GraspSettings

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "controllers.md"
SECTION = DOCUMENT.read_text(encoding="utf-8").partition("\n## Closed-loop\n")[2].partition("\n## ")[0]


def test_every_setting_has_its_row_with_its_default_and_unit() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*\|[^|]*) \|", SECTION, re.MULTILINE))
    assert list(rows) == list(GraspSettings.model_fields)
    for key, field in GraspSettings.model_fields.items():
        default, unit = (cell.strip() for cell in rows[key].split("|"))
        assert default == str(field.default)
        assert unit in (field.description or "")
        assert bool(unit) == ("[" in (field.description or ""))


def test_every_phase_has_its_number() -> None:
    for phase in Phase:
        assert re.search(rf"\b{phase.value} {phase.name.lower()}\b", SECTION)


def test_what_the_commands_name_is_there() -> None:
    commands = "".join(re.findall(r"^```sh\n(.*?)^```$", SECTION, re.DOTALL | re.MULTILINE))
    for key in re.findall(r"controller\.settings\.(\w+)=", commands):
        assert key in (*GraspSettings.model_fields, "script", "pressure")
    for script in re.findall(r"settings\.script=([\w-]+)", commands):
        assert (data_folder() / "scripts" / f"{script}.toml").is_file()
    for picture in re.findall(r"\]\((\w+\.svg)\)", SECTION):
        assert (DOCUMENT.parent / picture).is_file()
