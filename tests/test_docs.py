"""The documents say what the code does."""

import importlib.util
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from documents import PAGES, ROOT, commands, mentioned, name_of
from test_architecture import LAYERS

from taichisoft.command_line import application
from taichisoft.running.plugin_commands import command_names, with_plugin_commands

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_of_readme_inflates_finger():
    (block,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict = {}
    exec(block, names)
    simulation, report = names["simulation"], names["report"]
    cavity = simulation.model.cavities
    assert report.observation.pressures["finger.cavity"] > 29.0
    assert report.observation.volumes["finger.cavity"] > 1.02 * cavity.rest_value[0]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_shown_commands_and_options_exist(page: Path) -> None:
    for line in (*commands(page), *mentioned(page)):
        program, *words = line.words
        if program != "taichisoft":
            continue
        command: Any = with_plugin_commands(application)
        while words and words[0] in getattr(command, "commands", {}):
            command = command.commands[words.pop(0)]
        if hasattr(command, "commands") and not any(one.param_type_name == "argument" for one in command.params):
            if "--plugin" in words:
                continue  # a command that a plug-in on the page adds; tests/test_plugin_docs.py runs these
            assert not words or words[0].startswith("-"), line
        known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)} | {"--help"}
        given = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert given <= known, line


OTHERS = {
    "dask": "starts a cluster; tests/studies/test_workers.py does so from Python",
    "sbatch": "needs SLURM",
    "ruff": "is run by `make test`",
    "mypy": "is run by `make test`",
    "pytest": "runs tests",
}
"""Programs of which nothing but the paths is checked, and why."""


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_other_shown_commands_exist(page: Path) -> None:
    """Targets of make, extras of the package, files, and the options of modules that are run."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for command in (*commands(page), *mentioned(page)):
        program, *words = command.words
        match program, *words:
            case "taichisoft", *_:
                continue
            case "make", target, *_:
                assert target in targets, command
            case "pip", "install", *wanted:
                named = re.findall(r"taichisoft\[(.*?)\]", " ".join(wanted))
                assert {extra for found in named for extra in found.split(",")} <= set(extras), command
            case "python", "-m", module, *options if module.startswith("taichisoft"):
                given = [one for one in options if one.startswith("-")]
                assert [one for one in given if not is_option(one, module)] == [], command
            case _:
                assert program in (*OTHERS, "python"), command
        paths = [word for word in words if re.match(r"(tests|docs|examples)/", word)]
        assert [path for path in paths if not (ROOT / path).exists()] == [], command


def is_option(option: str, module: str) -> bool:
    """Whether a module, or the `__main__` of a package, has an option as an argument for typer, or by its name."""
    spec = importlib.util.find_spec(module)
    if spec is not None and spec.submodule_search_locations:
        spec = importlib.util.find_spec(f"{module}.__main__")
    assert spec is not None and spec.origin is not None, module
    argument = option.removeprefix("--").replace("-", "_") + "_?"  # some names are taken in Python
    return bool(
        re.search(rf'"{option}"|(^    |\(){argument}: ', Path(spec.origin).read_text(encoding="utf-8"), re.MULTILINE)
    )


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_pictures_are_made_by_named_programs(page: Path) -> None:
    """The last column of its table is a command that runs a file or a module, which is there."""
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`docs/[^|]+`) \| `([^`]+)` \|$", table, re.MULTILINE)
    made = {name.strip("`"): command for names, command in rows for name in names.split(", ")}
    for shown in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        picture = (page.parent / shown).resolve().relative_to(ROOT).as_posix()
        assert (ROOT / picture).is_file(), picture
        picture = picture if picture in made else f"{Path(picture).parent.as_posix()}/*{Path(picture).suffix}"
        match made[picture].split():
            case "taichisoft", command, argument, *_:
                names = command_names(with_plugin_commands(application))
                assert command in names or f"{command} {argument}" in names, made[picture]
            case "python", "-m", module, *_:
                assert importlib.util.find_spec(module), made[picture]
            case "git", "show", _:  # which was removed since
                pass
            case "python", file, *_:
                assert (ROOT / file).is_file(), made[picture]
            case _:
                pytest.fail(made[picture])


def test_readme_shows_how_to_run_mesh_and_render() -> None:
    assert {"run", "mesh", "render"} <= set(re.findall(r"^taichisoft ([a-z-]+)", README, re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_pages_and_headings(page: Path) -> None:
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
def test_named_files_of_the_code_exist(page: str) -> None:
    named = re.findall(r"`([\w/.]+/[\w/.]*)`", (ROOT / page).read_text(encoding="utf-8"))
    assert len(named) > 5
    assert [name for name in named if not (ROOT / name).exists() and not (ROOT / "taichisoft" / name).exists()] == []


def test_stack_that_is_drawn_is_one_that_is_asserted() -> None:
    (drawing,) = re.findall(
        r"```\n(.*?)```", (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"), re.DOTALL
    )
    drawn = [word.strip("/").removesuffix(".py") for line in drawing.splitlines()[2:] for word in line[:36].split()]
    asserted = [name for name in LAYERS["taichisoft"] if name not in ("pytest_fixtures", "__init__", "__main__")]
    assert [name for name in drawn if name in asserted] == asserted


def test_readme_leads_somewhere() -> None:
    assert len(re.findall(r"\]\(docs/", README)) > 5
