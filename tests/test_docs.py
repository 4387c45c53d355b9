"""The documents say what the code does."""

import re
from pathlib import Path

from taichisoft.command_line import application
from taichisoft.plugin_commands import with_plugin_commands
from taichisoft.scene_reference import scene_reference

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_scene_reference_is_up_to_date():
    written = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    assert written == scene_reference(), "run: python -m taichisoft.scene_reference > docs/scenes.md"


def test_the_python_of_the_readme_inflates_the_finger():
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(block, names)
    simulation, report = names["simulation"], names["report"]
    cavity = simulation.model.cavities
    assert report.pressures["finger.cavity"] > 29.0
    assert report.volumes["finger.cavity"] > 1.02 * cavity.rest_volume[0]


def test_every_command_of_the_readme_exists():
    known = with_plugin_commands(application).commands
    shell = "".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))
    commands = set(re.findall(r"^taichisoft ([a-z-]+)", shell, re.MULTILINE))
    assert {"run", "mesh", "render"} <= commands
    assert commands <= set(known)


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
