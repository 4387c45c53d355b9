"""The workflows, hooks and templates for GitHub parse, and run commands and Pythons that there are."""

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


def test_mypy_ignores_types_of_the_peers(tmp_path: Path) -> None:
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
def test_a_command_of_the_workflow_exists(command: str) -> None:
    program, *arguments = command.split()
    if program != "make":
        assert (ROOT / program).stat().st_mode & 0o111
        subprocess.run(["bash", "-n", ROOT / program], check=True, timeout=PATIENCE)
        return
    if shutil.which("make") is None:
        pytest.skip("needs make")
    done = subprocess.run(["make", "-n", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr


def test_the_workflow_runs_what_a_change_must_pass() -> None:
    must = re.findall(r"^(make \w+)$", (ROOT / ".ci/run").read_text(encoding="utf-8"), re.MULTILINE)
    suite = [step["run"].removesuffix(" PYTHON=python") for step in JOBS["suite"]["steps"] if "run" in step]
    assert suite == must


def test_the_workflow_runs_on_every_python_of_the_project() -> None:
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


def test_the_hooks_before_a_commit_are_those_of_make_lint() -> None:
    (hooks,) = (repository["hooks"] for repository in parsed(".pre-commit-config.yaml")["repos"])
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = makefile.partition("\nlint:")[2].partition("\n\n")[0].splitlines()[1:]
    assert [hook["entry"] for hook in hooks] == [line.strip() for line in recipe]


def test_the_templates_of_issues_ask_something() -> None:
    templates = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
    assert len(templates) == 2
    for template in templates:
        read = yaml.safe_load(template.read_text(encoding="utf-8"))
        assert read["name"] and read["description"]
        assert all(one["type"] == "textarea" and one["attributes"]["label"] for one in read["body"])


def test_the_oldest_packages_are_tried_with_all_extras_of_users() -> None:
    script = (ROOT / ".ci/try-lowest").read_text(encoding="utf-8")
    extras = set(PROJECT["optional-dependencies"]) - {"peers", "site", "test"}
    assert set(re.findall(r"--extra (\w+)", script)) == extras


def test_the_version_is_the_same_everywhere() -> None:
    assert parsed("CITATION.cff")["version"] == taichisoft.__version__
