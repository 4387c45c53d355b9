"""All that docs/plugins.md, force-control.md and cables.md show to be typed works, and prints what they say."""

import csv
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import PATIENCE

import taichisoft
from taichisoft import KeyEvent, Observation
from taichisoft.command_line import main
from taichisoft.running import hooks, plugins
from taichisoft.running.loop import saved_as_json

DOCS = Path(__file__).resolve().parents[1] / "docs"
DOCUMENT = (DOCS / "plugins.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", DOCUMENT, re.DOTALL | re.MULTILINE)


def test_first_controller_has_ten_lines() -> None:
    language, code = BLOCKS[0]
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith("#")]
    assert (language, len(lines)) == ("python", 10)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    with plugins.separate_registry():
        yield tmp_path


def test_shown_plugins_work(folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """In the order of the document: files are written, programs and commands run, from one folder."""
    shown: dict[str, str] = {}
    for language, code in BLOCKS:
        file = re.match(r"# (\S+\.\w+)\n", code)
        if file:
            (folder / file[1]).write_text(code, encoding="utf-8")
        elif language == "python":
            exec(compile(code, "docs/plugins.md", "exec"), {})
            shown["program"] = capfd.readouterr().out
        elif language == "sh":
            for line in code.splitlines():
                shown[line.split()[1]] = run(line, monkeypatch, capfd)
    assert "results in out/gripper" in shown["run"]
    assert "completed after 10 steps" in shown["run"]
    assert shown["cavities"].split() == ["finger1.cavity", "finger2.cavity", "finger3.cavity"]
    assert (folder / "wedge.msh").exists()
    assert shown["mesh"] == "4 nodes\n"
    assert "cube|pedestal" in (folder / "out" / "pedestal" / "run.csv").read_text()
    assert (folder / "out" / "gripper" / "forces.csv").read_text().startswith("0.01,")
    assert shown["program"].split()[0] == "completed"
    assert 4.0 < float(shown["program"].split()[1]) <= 5.0
    assert (folder / "soft-touch" / "pyproject.toml").exists()
    assert "3 passed" in shown["-m"]
    taichisoft.load_plugin("buttons.py")
    buttons = hooks.find("controller", "buttons")()
    buttons.reset(None)
    buttons.key(KeyEvent("c"))
    assert buttons.control(Observation(0.0, 0, pressures={"left": 0.0})).pressure == {"left": 30.0}
    taichisoft.load_plugin("dither.py")
    seen = Observation(0.0, 0, pressures={"left": 4.0})
    dither, again = hooks.find("controller", "dither")(), hooks.find("controller", "dither")()
    dither.reset(None)
    first = dither.control(seen)
    again.reset(None)
    again.restore(json.loads(saved_as_json(dither)))
    assert again.control(seen) == dither.control(seen) != first


def run(line: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """Output of a command line; it must succeed. Tests are run in this process, which has its kernels."""
    command = shlex.split(line)
    if command[:3] == ["python", "-m", "pytest"]:
        before = set(sys.modules)
        with plugins.separate_registry():
            code = pytest.main(["-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:dash", *command[3:]])
        for name in set(sys.modules) - before:  # those of this folder alone
            if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == Path.cwd():
                del sys.modules[name]
        out, errors = capfd.readouterr()
        assert code == 0, out + errors
        return out
    if command[0] == "python":
        result = subprocess.run(
            [sys.executable, *command[1:]], capture_output=True, text=True, env=os.environ, timeout=PATIENCE
        )
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout
    assert command[0] == "taichisoft"
    monkeypatch.setattr(sys, "argv", command)
    with plugins.separate_registry(), pytest.raises(SystemExit) as left:
        main()
    out, errors = capfd.readouterr()
    assert left.value.code in (0, None), errors
    return out


def test_only_what_needs_network_or_installation_is_not_run() -> None:
    """`console` blocks are covered by tests/test_installation.py, but for the upload."""
    languages = {language for language, _ in BLOCKS}
    assert languages == {"python", "sh", "toml", "console"}
    lines = [line for language, code in BLOCKS if language == "console" for line in code.splitlines()]
    assert all(line.startswith(("$ pip ", "$ python -m ", "$ cd ", "$ taichisoft ")) for line in lines)


def test_force_is_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In the order of the page, which first has the mistake that everybody makes; forces to 1 mN."""
    monkeypatch.chdir(tmp_path)
    page = (DOCS / "force-control.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    guarded = 'observation.normal_forces.get(("finger", "block"), 0.0)'
    commands = [line for language, code in blocks if language == "sh" for line in code.splitlines()]
    (program,) = (code for language, code in blocks if language == "python")
    file = tmp_path / "press.py"
    file.write_text(program, encoding="utf-8")
    with plugins.separate_registry():
        for line in commands[:2]:
            run(line, monkeypatch, capfd)
        with pytest.raises(AssertionError, match=r"KeyError: \('finger', 'block'\)"):
            run(commands[2], monkeypatch, capfd)
        assert guarded in page
        file.write_text(program.replace('observation.normal_forces[("finger", "block")]', guarded), encoding="utf-8")
        for line in commands[2:]:
            run(line, monkeypatch, capfd)
    rows = re.findall(r"^\| [a-z ]+ \| [\d., ]+ \| (\d+) mN \| (\d+) mN \| (\d+) mN \|$", page, re.MULTILINE)
    for folder, shown in zip(("press", "slow", "tuned"), rows, strict=True):
        with (tmp_path / "out" / folder / "run.csv").open(encoding="utf-8", newline="") as table:
            steps = list(csv.DictReader(table))
        force = {round(float(row["time [s]"]), 6): float(row["normal_force finger|block [mN]"]) for row in steps}
        assert [force[0.4], max(force.values()), force[2.0]] == pytest.approx(list(map(float, shown)), abs=1.0)


def test_example_of_cables_prints_what_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (DOCS / "cables.md").read_text(encoding="utf-8")
    (scene,), (program,), (shown,) = (
        re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL) for kind in ("toml", "python", "text")
    )
    (tmp_path / "tendon.toml").write_text(scene, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(program, {})
    assert capsys.readouterr().out == shown
