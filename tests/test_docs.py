"""The documents say what the code does."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from test_architecture import LAYERS

from taichisoft.command_line import application
from taichisoft.plugin_system.commands import with_plugin_commands

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_of_the_readme_inflates_the_finger():
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(block, names)
    simulation, report = names["simulation"], names["report"]
    cavity = simulation.model.cavities
    assert report.observation.pressures["finger.cavity"] > 29.0
    assert report.observation.volumes["finger.cavity"] > 1.02 * cavity.rest_volume[0]


PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_within_the_project_leads_to_a_page_and_a_heading(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for name, anchor in re.findall(r"\]\(([^)#]*)#?([^)]*)\)", text):
        if "://" in name:
            continue
        target = page.parent / name if name else page
        assert target.exists(), name
        assert not anchor or anchor in anchors(target), f"{name}#{anchor}"


def anchors(page: Path) -> set[str]:
    """What may stand behind # in a link to a page: its headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).replace(" ", "-").lower() for heading in headings}


@pytest.mark.parametrize("page", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_every_file_that_a_page_about_the_code_names_is_there(page: str) -> None:
    named = re.findall(r"`([\w/.]+/[\w/.]*)`", (ROOT / page).read_text(encoding="utf-8"))
    assert len(named) > 5
    assert [name for name in named if not (ROOT / name).exists() and not (ROOT / "taichisoft" / name).exists()] == []


def test_the_stack_that_is_drawn_is_the_one_that_is_asserted() -> None:
    (drawing,) = re.findall(
        r"```\n(.*?)```", (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"), re.DOTALL
    )
    drawn = [word.strip("/").removesuffix(".py") for line in drawing.splitlines()[2:] for word in line[:36].split()]
    asserted = [name for name in LAYERS["taichisoft"] if name not in ("pytest_fixtures", "__init__", "__main__")]
    assert [name for name in drawn if name in asserted] == asserted


def test_the_readme_leads_somewhere() -> None:
    assert len(re.findall(r"\]\(docs/", README)) > 5
