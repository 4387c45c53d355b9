"""docs/licences.md has the licence of everything that pip installs with taichisoft."""

import importlib.util
import re
import tomllib
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
FAMILIES = ("Apache", "BSD", "GPL", "ISC", "MIT", "MPL", "PSF|Python Software Foundation")


@pytest.fixture(scope="module")
def program() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_licences", ROOT / "docs" / "write_licences.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def listed(page: str) -> dict[str, str]:
    """Licence of each package of the table, by its name with the extra's mark."""
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")]
    return {name: licence for licence, packages in rows for name in packages.split(", ")}


def families(licence: str) -> set[str]:
    return {family for family in FAMILIES if re.search(family, licence)}


def test_named_packages_have_licences_in_the_table(program: ModuleType) -> None:
    """The wording, and what other packages bring, change with their versions; the family of a licence does not."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    table = listed(program.PAGE.read_text(encoding="utf-8"))
    extras = {"": project["dependencies"], **{name: project["optional-dependencies"][name] for name in program.EXTRAS}}
    bare = {key.partition(" ")[0]: licence for key, licence in table.items()}
    for extra, required in extras.items():
        for name in (re.split("[<>=;]", line)[0] for line in required):
            if not program.is_installed(name):
                continue  # Open3D for other machines
            assert name in table or f"{name} [{extra}]" in table, name
            assert families(program.licence(distribution(name))) & families(bare[name]), name


def test_no_copyleft_licence_is_left_out(program: ModuleType) -> None:
    """Which extra brings a package depends on Python, as Open3D does; that it is copyleft does not."""
    table = listed(program.PAGE.read_text(encoding="utf-8"))
    bare = {key.partition(" ")[0]: licence for key, licence in table.items()}
    for name in program.all_brought():
        if program.COPYLEFT.search(program.licence(distribution(name))):
            assert program.COPYLEFT.search(bare[name]), name


def test_gmsh_is_among_them(program: ModuleType) -> None:
    assert "GPL" in listed(program.page())["gmsh"]
