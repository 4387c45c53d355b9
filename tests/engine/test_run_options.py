"""Options that plug-ins add to `taichisoft run`: each brings an output, or gives it a setting."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from taichisoft.command_line import main
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import plugins

Command = Callable[..., tuple[int, str, str]]

COUNTER = """
from pathlib import Path
from taichisoft import Control, Controller, Output, hookimpl
from taichisoft.running.hookspecs import RunOption

class Counter(Output):
    def __init__(self, folder, start: int = 0, file: Path = Path("count"), loud: bool = False):
        self.path, self.count, self.loud = folder / file, start, loud

    def record(self, state, report):
        self.count += 1

    def end(self, outcome):
        self.path.write_text(f"{self.count}{'!' if self.loud else ''}")

class Idle(Controller):
    def control(self, observation):
        return Control()

    def summary(self):
        return {"driven by": "idle"}

class Other(Idle):
    def summary(self):
        return {}

@hookimpl
def taichisoft_outputs():
    return {"counter": Counter}

@hookimpl
def taichisoft_controllers():
    return {"idle": Idle, "other": Other}

@hookimpl
def taichisoft_run_options():
    return {
        "--count": RunOption("counter", "Count the steps.", controller="idle"),
        "--count-from": RunOption("counter", "Where to begin.", "start", int, "N"),
        "--count-file": RunOption("counter", "Where to write.", "file", Path, "FILE"),
        "--count-loud": RunOption("counter", "With emphasis.", "loud", bool),
    }
"""


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    """Runs the command with the plug-in above in a folder of its own; returns exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "counter.py").write_text(COUNTER)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["taichisoft", *arguments, "--plugin", "counter.py"])
        with plugins.separate_registry(), pytest.raises(SystemExit) as left:
            main()
        shown = capfd.readouterr()
        return int(left.value.code or 0), shown.out, shown.err

    return run


RUN = ("run", str(TINY_GRIPPER), "--duration", "0.03", "--output", "out", "--controller", "other", "--outputs", "csv")


@pytest.mark.parametrize(
    ("options", "file", "written"),
    [
        (["--count"], "count", "3"),
        (["--count-from", "4"], "count", "7"),
        (["--count-from=4", "--count-file", "steps.txt", "--count-loud"], "steps.txt", "7!"),
    ],
)
def test_an_option_brings_its_output_with_the_setting(
    command: Command, options: list[str], file: str, written: str
) -> None:
    code, _, errors = command(*RUN, *options)
    assert code == 0, errors
    assert Path("out", file).read_text() == written
    assert list(Path("out").glob("*.csv"))


def test_without_its_options_an_output_is_not_there_but_by_its_name(command: Command) -> None:
    assert command(*RUN)[0] == 0
    assert not Path("out", "count").exists()
    assert command(*RUN[:-1], "counter")[0] == 0
    assert Path("out", "count").read_text() == "3"


def test_an_option_may_name_who_drives_where_the_user_does_not(command: Command) -> None:
    unnamed = [argument for argument in RUN if argument not in ("--controller", "other")]
    assert "idle" in command(*unnamed, "--count")[1]
    assert "idle" not in command(*unnamed, "--count-from", "1")[1]
    assert "idle" not in command(*RUN, "--count")[1]


def test_the_options_are_in_the_help_and_the_list(command: Command) -> None:
    shown = command("run", "--help")[1]
    assert "--count-from" in shown and "Where to begin." in shown and "Outputs" in shown
    assert "run option --count-from" in " ".join(command("plugins")[1].replace("│", " ").split())


READER = """
import json
from taichisoft import hookimpl
from taichisoft.running.hookspecs import RunOption

def read(path, edge: float = 10.0):
    return {"rigid_bodies": {"cube": {"box": [edge] * 3, "mass": 0.001}}}

@hookimpl
def taichisoft_scene_readers():
    return {".cube": read}

@hookimpl
def taichisoft_run_options():
    return {"--edge": RunOption(None, "Edge of the cube.", "edge", float, "MM")}
"""


def test_an_option_without_an_output_sets_something_of_the_reader(command: Command, tmp_path: Path) -> None:
    (tmp_path / "reader.py").write_text(READER)
    (tmp_path / "one.cube").touch()
    plugin = ("--plugin", "reader.py")
    arguments = ("--duration", "0.01", "--output", "out", "--controller", "other", "--outputs", "csv", *plugin)
    assert command("run", "one.cube", *arguments)[0] == 0
    assert "[\n    10.0," in Path("out", "scene.toml").read_text()
    code, _, errors = command("run", "one.cube", "--edge", "7", *arguments)
    assert (code, errors) == (0, "")
    assert "[\n    7.0," in Path("out", "scene.toml").read_text()
    code, _, errors = command("run", str(TINY_GRIPPER), "--edge", "7", *arguments)
    assert code == 2 and "edge has no effect on a .toml scene" in errors
    assert "--edge" in command("run", "--help", *plugin)[1]
    assert "--edge" not in command("resume", "--help", *plugin)[1]


def test_a_value_of_another_type_is_refused(command: Command) -> None:
    code, _, errors = command(*RUN, "--count-from", "soon")
    assert code == 2 and "Invalid value for '--count-from'" in errors
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("[]", "gave []; must be a mapping by name"),
        ('{"count": RunOption("counter", "")}', "gave the name 'count'; must begin with --"),
        ('{"--count": "counter"}', "gave 'counter' as '--count'; must be a RunOption"),
        ('{"--speed": RunOption("counter", "")}', "'--speed' of output 'counter': `taichisoft run` has one"),
    ],
)
def test_what_is_no_option_is_an_error(command: Command, tmp_path: Path, options: str, problem: str) -> None:
    head = COUNTER.partition('    return {\n        "--count"')[0]
    (tmp_path / "counter.py").write_text(head + f"    return {options}\n")
    code, _, errors = command(*RUN)
    assert code == 2 and problem in errors


def test_two_options_of_one_name_are_an_error_that_names_both(command: Command, tmp_path: Path) -> None:
    other = COUNTER.replace('"counter"', '"other"').replace('"idle"', '"other"')
    (tmp_path / "other.py").write_text(other)
    code, _, errors = command(*RUN, "--plugin", "other.py")
    assert code == 2
    assert "'counter'" in errors and "'other'" in errors and "both provide the run option '--count'" in errors
