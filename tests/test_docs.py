"""The documents say what the code does."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from taichisoft.command_line import application
from taichisoft.plugin_system.commands import with_plugin_commands
from taichisoft.scenes.reference import scene_reference

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_scene_reference_is_up_to_date():
    written = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    assert written == scene_reference(), "run: python -m taichisoft.scenes.reference > docs/scenes.md"


def test_the_python_of_the_readme_inflates_the_finger():
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(block, names)
    simulation, report = names["simulation"], names["report"]
    cavity = simulation.model.cavities
    assert report.observation.pressures["finger.cavity"] > 29.0
    assert report.observation.volumes["finger.cavity"] > 1.02 * cavity.rest_volume[0]


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_and_option_that_is_shown_exists(page: Path) -> None:
    shell = "".join(re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
    for line in re.findall(r"^taichisoft (?:.*\\\n)*.*", shell, re.MULTILINE):
        words = shlex.split(line.replace("\\\n", " "), comments=True)[1:]
        command: Any = with_plugin_commands(application)
        while words and words[0] in getattr(command, "commands", {}):
            command = command.commands[words.pop(0)]
        if hasattr(command, "commands") and "--plugin" in words:
            continue  # a command that a plug-in on the page adds; tests/test_plugin_docs.py runs these
        assert not hasattr(command, "commands") or not words or words[0].startswith("-"), f"{page.name}: {line}"
        known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)} | {"--help"}
        given = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert given <= known, f"{page.name}: {line}"


def test_the_readme_shows_how_to_run_mesh_and_render() -> None:
    assert {"run", "mesh", "render"} <= set(re.findall(r"^taichisoft ([a-z-]+)", README, re.MULTILINE))


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
