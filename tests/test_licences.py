"""docs/licences.md has the licence of everything that pip installs with taichisoft."""

import importlib.util
import re
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]


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


def test_other_packages_are_permissive(program: ModuleType) -> None:
    """The table is what the installed packages say, and what it leaves out is under a licence that the page names."""
    assert listed(program.PAGE.read_text(encoding="utf-8")).keys() >= {"gmsh", "certifi"}
    for text, names in program.by_licence().items():
        if not program.COPYLEFT.search(text) and text != program.NOT_NAMED:
            assert re.search("Apache|BSD|ISC|MIT|PSF|Python Software Foundation", text), (text, names)


def test_no_copyleft_licence_is_left_out(program: ModuleType) -> None:
    """Which extra brings a package depends on Python, as Open3D does; that it is copyleft does not."""
    table = listed(program.PAGE.read_text(encoding="utf-8"))
    bare = {key.partition(" ")[0]: licence for key, licence in table.items()}
    for name in program.all_brought():
        if program.COPYLEFT.search(program.licence(distribution(name))):
            assert program.COPYLEFT.search(bare[name]), name


def test_gmsh_is_among_them(program: ModuleType) -> None:
    assert "GPL" in listed(program.page())["gmsh"]
