"""The Makefile, workflows, hooks and templates for GitHub run commands and Pythons that there are."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import yaml
from conftest import PATIENCE

import taichisoft

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def parsed(path: str) -> Any:
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_mypy_ignores_types_of_peers(tmp_path: Path) -> None:
    """`make scoreboard` installs them beside the rest: `make test` must not find other errors then."""
    stubs = tmp_path / "pydrake"
    stubs.mkdir()
    (stubs / "__init__.pyi").write_text("def add(one: int) -> int: ...\n")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mypy"]
    del settings["packages"]  # mypy takes either these or a program
    (tmp_path / "pyproject.toml").write_text(tomli_w.dumps({"tool": {"mypy": settings}}))
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "-c", "import pydrake; pydrake.add([1.0])"],
        cwd=tmp_path,
        env={**os.environ, "MYPYPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert checked.returncode == 0, checked.stdout


JOBS = parsed(".github/workflows/checks.yml")["jobs"]
RUN = [step["run"] for job in JOBS.values() for step in job["steps"] if "run" in step]


@pytest.mark.parametrize("command", sorted(set(RUN)))
def test_command_of_workflow_exists(command: str) -> None:
    program, *arguments = command.split()
    if program != "make":
        assert (ROOT / program).stat().st_mode & 0o111
        subprocess.run(["bash", "-n", ROOT / program], check=True, timeout=PATIENCE)
        return
    if shutil.which("make") is None:
        pytest.skip("needs make")
    done = subprocess.run(["make", "-n", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr


def test_workflow_runs_what_change_must_pass() -> None:
    must = re.findall(r"^(make \w+)$", (ROOT / ".ci/run").read_text(encoding="utf-8"), re.MULTILINE)
    suite = [step["run"].removesuffix(" PYTHON=python") for step in JOBS["suite"]["steps"] if "run" in step]
    assert suite == must


def test_workflow_runs_on_every_python() -> None:
    versions = [line.rpartition(" :: ")[2] for line in PROJECT["classifiers"] if re.search(r"Python :: \d", line)]
    assert JOBS["suite"]["strategy"]["matrix"]["python"] == versions
    others = [
        step["with"]["python-version"]
        for name in ("lint", "packages", "lowest")
        for step in JOBS[name]["steps"]
        if "setup-python" in step.get("uses", "")
    ]
    assert len(others) == 3 and set(others) <= set(versions)
    assert JOBS["lowest"]["steps"][1]["with"]["python-version"] == versions[0]


def test_commit_hooks_are_those_of_make_lint() -> None:
    (hooks,) = (repository["hooks"] for repository in parsed(".pre-commit-config.yaml")["repos"])
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.partition("\nlint:")[2].partition("\n\n")[0].splitlines()[1:]
    assert [hook["entry"] for hook in hooks] == [line.strip() for line in recipe]


def test_issue_templates_ask_something() -> None:
    templates = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
    assert len(templates) == 2
    for template in templates:
        read = yaml.safe_load(template.read_text(encoding="utf-8"))
        assert read["name"] and read["description"]
        assert all(field["type"] == "textarea" and field["attributes"]["label"] for field in read["body"])


def test_oldest_packages_are_tried_with_all_extras() -> None:
    script = (ROOT / ".ci/try-lowest").read_text(encoding="utf-8")
    extras = set(PROJECT["optional-dependencies"]) - {"peers", "site", "test"}
    assert set(re.findall(r"--extra (\w+)", script)) == extras


def test_version_is_same_everywhere() -> None:
    assert parsed("CITATION.cff")["version"] == taichisoft.__version__


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

needs_make = pytest.mark.skipif(MAKE is None, reason="needs make")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a pyproject.toml, and in `bin` all programs that the Makefile may find."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "pyproject.toml").touch()
    for tool in TOOLS:
        program = shutil.which(tool)
        assert program is not None
        (tmp_path / "bin" / tool).symlink_to(program)
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


USUAL, BY_UV = "python3 -m venv --clear .venv", "uv venv --seed --python 3.12 .venv"


@needs_make
@pytest.mark.parametrize(
    ("version", "venv", "uv", "outcome"),
    [
        ((3, 11), True, True, USUAL),
        ((3, 12), True, True, USUAL),
        ((3, 13), True, True, USUAL),
        ((3, 10), True, True, BY_UV),
        ((3, 14), True, True, BY_UV),
        ((3, 12), False, True, BY_UV),
        ((3, 14), True, False, "with uv installed"),
        ((3, 10), False, False, "with uv installed"),
        ((3, 13), False, False, "python3-venv"),
    ],
)
def test_make_finds_python_or_says_how_to_get_one(
    folder: Path, version: tuple[int, int], venv: bool, uv: bool, outcome: str
) -> None:
    add_python(folder, "python3", version, venv)
    if uv:
        add_uv(folder)
        called, errors = install(folder)
        assert errors == [] and called[0] == outcome and "pip install" in called[1]
        assert outcome == BY_UV or not any(line.startswith("uv") for line in called)
    else:
        called, (line,) = install(folder)
        assert called == [] and line.startswith("error: ") and outcome in line


@needs_make
def test_make_keeps_to_named_python(folder: Path) -> None:
    add_python(folder, "python3", (3, 12))
    add_python(folder, "mine", (3, 9))
    add_uv(folder)
    called, (line,) = install(folder, "PYTHON=mine")
    assert called == [] and "none of mine is one" in line


def installed(called: list[str]) -> list[str]:
    return [line.partition(" install ")[2].split()[-1] for line in called]


@needs_make
def test_make_installs_what_is_missing_or_changed(folder: Path) -> None:
    """A grasp needs no tools; tools whose installation was cut short, and a changed project, are installed again."""
    add_python(folder, "python3", (3, 12))
    assert installed(install(folder)[0][1:]) == ["."]
    tools, log = ".venv/test-tools", folder / "log"
    assert installed(install(folder, stamp=tools)[0][1:]) == [".", ".[test]"]
    log.unlink()
    for stamp in (".venv/installed", tools):
        assert install(folder, stamp=stamp) == ([], []), "all is there"
    (folder / tools).unlink()
    (line,) = install(folder, stamp=tools)[0]
    assert line.endswith("--editable .[test]")
    log.unlink()
    later = (folder / tools).stat().st_mtime + 10.0
    os.utime(folder / "pyproject.toml", (later, later))
    os.utime(folder / ".venv/installed", (later - 5.0, later - 5.0))
    called = install(folder, stamp=tools)[0]
    assert installed(called) == [".", ".[test]"]
    assert not any("venv" in line.partition("-m ")[2] for line in called)
