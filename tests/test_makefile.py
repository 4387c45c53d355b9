"""The Makefile finds a Python that fits, lets uv fetch one, or says in one line how to get one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PATIENCE

MAKEFILE = Path(__file__).resolve().parents[1] / "Makefile"
MAKE = shutil.which("make")
TOOLS = ("sh", "rm", "touch", "mkdir", "cp", "chmod")
FAKE_PYTHON = """#!/bin/sh
if test "$1" = -c; then exec {real} -c "import sys; sys.version_info = {version}; {without}
$2"; fi
echo "{name} $*" >> log
test -e .venv/bin/python || {{ mkdir -p .venv/bin && cp "$0" .venv/bin/python; }}
"""
FAKE_UV = """#!/bin/sh
echo "uv $*" >> log
mkdir -p .venv/bin && cp bin/fake .venv/bin/python
"""

pytestmark = pytest.mark.skipif(MAKE is None, reason="needs make")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a pyproject.toml, and in `bin` all programs that the Makefile may find."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "pyproject.toml").touch()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found is not None
        (tmp_path / "bin" / tool).symlink_to(found)
    return tmp_path


def add_python(folder: Path, name: str, version: tuple[int, int], venv: bool = True) -> None:
    without = "" if venv else "sys.modules['ensurepip'] = None"
    program = FAKE_PYTHON.format(real=sys.executable, version=version, without=without, name=name)
    write_program(folder / "bin" / name, program)


def write_program(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)


def add_uv(folder: Path) -> None:
    write_program(folder / "bin" / "fake", FAKE_PYTHON.format(real="", version="", without="", name=".venv"))
    write_program(folder / "bin" / "uv", FAKE_UV)


def install(folder: Path, *arguments: str, stamp: str = ".venv/installed") -> tuple[list[str], list[str]]:
    """What was called, and the error lines that are not make's own."""
    assert MAKE is not None
    environment = {"PATH": str(folder / "bin"), "HOME": os.environ.get("HOME", "")}
    command = [MAKE, "-f", MAKEFILE, stamp, *arguments]
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    log = folder / "log"
    called = log.read_text().splitlines() if log.exists() else []
    errors = [line for line in result.stderr.splitlines() if not line.startswith("make")]
    assert (result.returncode == 0) == (not errors) == (folder / stamp).exists(), result.stderr
    return called, errors


@pytest.mark.parametrize("version", [(3, 11), (3, 12), (3, 13)])
def test_a_python_that_fits_is_used(folder: Path, version: tuple[int, int]) -> None:
    add_python(folder, "python3", version)
    add_uv(folder)
    called, errors = install(folder)
    assert errors == []
    assert called[0] == "python3 -m venv --clear .venv"
    assert not any(line.startswith("uv") for line in called)


@pytest.mark.parametrize(("version", "venv"), [((3, 10), True), ((3, 14), True), ((3, 12), False)])
def test_uv_makes_the_environment_where_no_python_fits(folder: Path, version: tuple[int, int], venv: bool) -> None:
    add_python(folder, "python3", version, venv)
    add_uv(folder)
    called, errors = install(folder)
    assert errors == []
    assert called[0] == "uv venv --seed --python 3.12 .venv"
    assert "pip install" in called[1]


@pytest.mark.parametrize(
    ("version", "venv", "advice"),
    [((3, 14), True, "with uv installed"), ((3, 10), False, "with uv installed"), ((3, 13), False, "python3-venv")],
)
def test_one_line_says_how_to_get_a_python(folder: Path, version: tuple[int, int], venv: bool, advice: str) -> None:
    add_python(folder, "python3", version, venv)
    called, errors = install(folder)
    assert called == []
    (line,) = errors
    assert line.startswith("error: ") and advice in line


def test_a_python_that_the_user_names_is_not_replaced(folder: Path) -> None:
    add_python(folder, "python3", (3, 12))
    add_python(folder, "mine", (3, 9))
    add_uv(folder)
    called, errors = install(folder, "PYTHON=mine")
    assert called == []
    (line,) = errors
    assert "none of mine is one" in line


def test_a_grasp_installs_no_tools_and_the_tests_add_them(folder: Path) -> None:
    add_python(folder, "python3", (3, 12))
    called, _ = install(folder)
    assert [line.partition(" install ")[2].split()[-1] for line in called[1:]] == ["."]
    called, _ = install(folder, stamp=".venv/test-tools")
    assert [line.partition(" install ")[2].split()[-1] for line in called[1:]] == [".", ".[test]"]
    (folder / "log").unlink()
    for stamp in (".venv/installed", ".venv/test-tools"):
        assert install(folder, stamp=stamp) == ([], []), "all is there"


def test_tools_that_were_not_installed_to_the_end_are_installed_again(folder: Path) -> None:
    add_python(folder, "python3", (3, 12))
    install(folder, stamp=".venv/test-tools")
    (folder / ".venv/test-tools").unlink()
    (folder / "log").unlink()
    called, _ = install(folder, stamp=".venv/test-tools")
    (line,) = called
    assert line.endswith("--editable .[test]")


def test_a_changed_project_is_installed_again_with_its_tools_into_the_same_environment(folder: Path) -> None:
    add_python(folder, "python3", (3, 12))
    install(folder, stamp=".venv/test-tools")
    (folder / "log").unlink()
    later = (folder / ".venv/test-tools").stat().st_mtime + 10.0
    os.utime(folder / "pyproject.toml", (later, later))
    os.utime(folder / ".venv/installed", (later - 5.0, later - 5.0))
    called, _ = install(folder, stamp=".venv/test-tools")
    assert [line.partition(" install ")[2].split()[-1] for line in called] == [".", ".[test]"]
    assert not any("venv" in line.partition("-m ")[2] for line in called)
