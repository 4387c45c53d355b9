"""The command line with plug-ins: where they may be named, what they add to it, and how they fail."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer

import taichisoft.step.time_stepper  # noqa: F401 - Taichi may say something when it starts: not in the middle of a test
from taichisoft import group_with_default
from taichisoft.command_line import main
from taichisoft.errors import PluginError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import plugins
from taichisoft.running.plugin_commands import command_names, with_plugin_commands

Install = Callable[..., None]
Command = Callable[..., tuple[int, str, str]]

WAVE = '''
from taichisoft import hookimpl

class Wave:
    def __init__(self, hands: int = 2):
        self.hands = hands

@hookimpl
def taichisoft_controllers():
    return {"wave": Wave}

@hookimpl
def taichisoft_commands(application):
    @application.command()
    def wave(hands: int = 2):
        """Wave to somebody."""
        print("hello " * hands)
'''


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    """Runs the command in a folder of its own with wave.py; returns exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wave.py").write_text(WAVE)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["taichisoft", *arguments])
        with plugins.separate_registry(), pytest.raises(SystemExit) as left:
            main()
        shown = capfd.readouterr()
        return int(left.value.code or 0), shown.out, shown.err

    return run


@pytest.mark.parametrize(
    "arguments",
    [
        ["--plugin", "wave.py", "wave", "--hands", "3"],
        ["wave", "--plugin", "wave.py", "--hands", "3"],
        ["wave", "--hands", "3", "--plugin=wave.py"],
        ["--plugin=wave.py", "wave", "--plugin", "wave.py", "--hands", "3"],
    ],
)
def test_plugins_may_be_named_anywhere_and_add_commands(command: Command, arguments: list[str]) -> None:
    assert command(*arguments) == (0, "hello hello hello \n", "")


def test_a_command_that_no_plugin_adds_is_none(command: Command) -> None:
    code, _, errors = command("wave")
    assert code == 2
    assert "No such command 'wave'" in errors


@pytest.mark.parametrize(
    "arguments", [[], ["run"], ["mesh"], ["plugins"], ["plugins", "new"], ["wave", "--plugin", "wave.py"]]
)
def test_every_help_shows_the_option_that_loads_plugins(command: Command, arguments: list[str]) -> None:
    code, output, _ = command(*arguments, "--help")
    assert code == 0
    assert "--plugin " in output


def test_the_help_shows_what_a_plugin_adds(command: Command) -> None:
    assert "Wave to somebody." in command("--help", "--plugin", "wave.py")[1]


def test_the_list_has_name_version_origin_and_what_is_provided(command: Command, tmp_path: Path) -> None:
    code, output, errors = command("plugins", "--plugin", "wave.py")
    assert (code, errors) == (0, "")
    row = output[output.index("│ wave") :]
    for shown in ("file", str(tmp_path / "wave.py"), "controller wave", "command wave"):
        assert shown in row


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["plugins", "--plugin", "nothing.py"], "nothing.py: no such file"),
        (["--help", "--plugin", "nothing"], "nothing: no such file"),
        (["plugins", "new", "class"], "Python has a 'class' already"),
        (["run", "gripper", "--plugin", "wave.py", "--controller", "wav"], "there are: "),
    ],
)
def test_what_is_wrong_is_one_line(command: Command, arguments: list[str], problem: str) -> None:
    code, _, errors = command(*arguments)
    (line,) = errors.splitlines()
    assert code == 2
    assert line.startswith("taichisoft: ")
    assert problem in line


def test_an_option_without_its_value_is_refused(command: Command) -> None:
    code, _, errors = command("plugins", "--plugin")
    assert code == 2
    assert "Option '--plugin' requires an argument" in errors


def test_a_plugin_that_fails_is_reported_with_its_own_traceback(command: Command, tmp_path: Path) -> None:
    (tmp_path / "wave.py").write_text(WAVE.replace("    @application", "    arms\n    @application"))
    code, _, errors = command("--help", "--plugin", "wave.py")
    line, *traceback = errors.splitlines()
    assert code == 1
    where = f"plug-in 'wave' ({tmp_path / 'wave.py'}) failed in taichisoft_commands()"
    problem = "NameError: name 'arms' is not defined (wave.py, line 14)"
    assert line == f"taichisoft: {where}: {problem}; TAICHISOFT_DISABLE_PLUGINS=wave leaves it out"
    assert traceback[0] == "Traceback (most recent call last):"
    assert traceback[1] == f'  File "{tmp_path / "wave.py"}", line 14, in taichisoft_commands'
    assert traceback[-1] == "NameError: name 'arms' is not defined"


CLUMSY = """
import json
from taichisoft import Control, Controller, Output, hookimpl

class Clumsy(Controller):
    def reset(self, model): ...
    def control(self, observation):
        return Control() if observation.step < 3 else self.drop()
    def drop(self):
        return json.loads("{")

class Blind(Output):
    def __init__(self, folder): ...
    def begin(self, model, state): ...
    def record(self, state, report): ...
    def end(self, outcome):
        raise ValueError("no light")

@hookimpl
def taichisoft_controllers():
    return {"clumsy": Clumsy}

@hookimpl
def taichisoft_outputs():
    return {"blind": Blind}
"""


def test_a_controller_that_raises_ends_the_run_with_its_traceback_and_a_whole_recording(
    command: Command, tmp_path: Path
) -> None:
    import h5py

    file = tmp_path / "clumsy.py"
    file.write_text(CLUMSY)
    code, output, errors = command(
        *("run", str(TINY_GRIPPER), "--plugin", "clumsy.py", "--controller", "clumsy", "--output", "out"),
        *("--outputs", "recording,blind"),
    )
    line, *traceback = errors.splitlines()
    assert code == 1
    failed = "controller taichisoft_plugin_clumsy.Clumsy failed in control(): JSONDecodeError: Expecting property name"
    assert line.startswith(f"taichisoft: {failed}")
    assert line.endswith("(clumsy.py, line 10)")
    places = [shown for shown in traceback if shown.startswith("  File ")]
    assert places[:2] == [f'  File "{file}", line 8, in control', f'  File "{file}", line 10, in drop']
    assert traceback[-1].startswith("json.decoder.JSONDecodeError: ")
    assert "Blind failed in end(): ValueError: no light" in output
    with h5py.File(tmp_path / "out" / "recording.h5") as recording:
        assert recording["outcome"][()].decode() == line.removeprefix("taichisoft: ")
        assert len(recording["steps/time"]) == 1 + 3


@pytest.mark.parametrize(
    ("place", "before", "after"),
    [
        ("control()", "return json.loads", "raise SystemExit(0) #"),
        ("end()", 'raise ValueError("no light")', "raise SystemExit(0)"),
    ],
)
def test_a_part_that_calls_exit_does_not_end_a_run_silently(
    command: Command, tmp_path: Path, place: str, before: str, after: str
) -> None:
    import h5py

    (tmp_path / "clumsy.py").write_text(CLUMSY.replace(before, after).replace("< 3", "< 3 or 'end' in " + repr(place)))
    code, _, errors = command(
        *("run", str(TINY_GRIPPER), "--plugin", "clumsy.py", "--controller", "clumsy", "--output", "out"),
        *("--outputs", "blind,recording", "--duration", "0.1"),
    )
    assert code == 1
    assert f"failed in {place}: SystemExit: 0 (clumsy.py, line" in errors.splitlines()[0]
    with h5py.File(tmp_path / "out" / "recording.h5") as recording:
        assert recording["outcome"][()].decode() not in ("", "unfinished")


def test_blocked_names_that_nothing_has_are_said_and_the_command_goes_on(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", "wave,meshng")
    code, output, errors = command("plugins", "--plugin", "wave.py")
    assert code == 0
    assert "wave" not in output
    told = (
        "taichisoft: TAICHISOFT_DISABLE_PLUGINS names 'meshng', which no plug-in is called; did you mean 'meshing'?\n"
    )
    assert errors == told


def test_a_plugin_that_is_left_out_adds_no_command(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", "wave")
    code, _, errors = command("wave", "--plugin", "wave.py")
    assert code == 2
    assert "No such command 'wave'" in errors


def test_commands_of_one_name_are_an_error_that_names_both(install: Install) -> None:
    def add(application: typer.Typer) -> None:
        application.command("wave")(lambda: None)

    def add_group(application: typer.Typer) -> None:
        group = typer.Typer()
        group.command("back")(lambda: None)
        application.add_typer(group, name="run")

    own = typer.Typer()
    own.command("run")(lambda: None)
    own.command("plugins")(lambda: None)
    install("one", taichisoft_commands=add)
    assert list(with_plugin_commands(own).commands) == ["run", "plugins", "wave"]
    assert command_names(typer.main.get_group(own)) == ["run", "plugins"]  # it has not changed
    install("two", taichisoft_commands=add_group)
    with pytest.raises(
        PluginError, match=r"^two plug-ins, taichisoft itself and 'two' \(plugin_two\), both add the com"
    ):
        with_plugin_commands(own)


def test_two_plugins_that_add_one_command_are_named(install: Install) -> None:
    def add(application: typer.Typer) -> None:
        application.command("wave")(lambda: None)

    install("one", taichisoft_commands=add)
    install("two", taichisoft_commands=add)
    own = typer.Typer()
    own.command("run")(lambda: None)
    both = r"^two plug-ins, 'one' \(plugin_one\) and 'two' \(plugin_two\), both add the command 'wave'$"
    with pytest.raises(PluginError, match=both):
        with_plugin_commands(own)


def shape(file: str, fine: bool = False) -> None:
    """Make a shape."""
    print("made", file, fine)


def info(file: str) -> None:
    """Show a shape."""
    print("shown", file)


def sweep(file: str) -> None:
    """Make many shapes."""
    print("swept", file)


def install_shapes(install: Install, names: str = "one two") -> None:
    """Two plug-ins, of which one adds `shape` and `shape info`, the other `shape sweep`."""

    def add_default(application: typer.Typer) -> None:
        group = group_with_default(shape)
        group.command()(info)
        application.add_typer(group, name="shape")

    def add_sweep(application: typer.Typer) -> None:
        group = typer.Typer(no_args_is_help=True)
        group.command()(sweep)
        application.add_typer(group, name="shape")

    for name, add in zip(names.split(), (add_default, add_sweep), strict=True):
        install(name, taichisoft_commands=add)


@pytest.mark.parametrize("names", ["one two", "two one"])
@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["cube.toml", "--fine"], "made cube.toml True"),
        (["--fine", "cube.toml"], "made cube.toml True"),
        (["info", "cube.msh"], "shown cube.msh"),
        (["sweep", "cube.toml"], "swept cube.toml"),
        (["./info"], "made ./info False"),
        (["cube.toml", "--plugin", "wave.py"], "made cube.toml False"),
        (["--plugin", "wave.py", "--plugin=wave.py", "info", "cube.msh"], "shown cube.msh"),
        (["info", "--plugin", "wave.py", "cube.msh"], "shown cube.msh"),
    ],
)
def test_groups_of_one_name_become_one_whose_default_runs_where_no_command_is_named(
    command: Command, install: Install, names: str, arguments: list[str], output: str
) -> None:
    install_shapes(install, names)
    assert command("shape", *arguments) == (0, f"{output}\n", "")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["shape"], "Missing argument 'file'; see taichisoft shape --help"),
        (["shape", "info"], "Missing argument 'file'; see taichisoft shape info --help"),
        (["shape", "a", "b"], "Got unexpected extra argument(s) (b); see taichisoft shape --help"),
        (["shape-info", "a"], "No such command 'shape-info'. Did you mean 'shape info'?; see taichisoft --help"),
    ],
)
def test_what_is_wrong_with_a_command_of_a_group_is_one_line(
    command: Command, install: Install, arguments: list[str], problem: str
) -> None:
    install_shapes(install)
    assert command(*arguments) == (2, "", f"taichisoft: {problem}\n")


def test_the_help_of_a_group_shows_the_options_of_its_default_and_its_commands(
    command: Command, install: Install
) -> None:
    install_shapes(install)
    code, output, _ = command("shape", "--help")
    assert code == 0
    for part in (" | COMMAND", "Make a shape.", "--fine", "--plugin ", "Show a shape.", "Make many shapes."):
        assert part in output


def test_two_plugins_that_add_one_command_to_a_group_or_two_defaults_are_named(install: Install) -> None:
    own = typer.Typer()
    own.add_typer(group_with_default(shape), name="shape")
    install_shapes(install)
    with pytest.raises(
        PluginError, match=r"^two plug-ins, taichisoft itself and 'one' .*, both add the command 'shape'$"
    ):
        with_plugin_commands(own)

    def add_sweep(application: typer.Typer) -> None:
        group = typer.Typer()
        group.command("sweep")(lambda: None)
        application.add_typer(group, name="shape")

    install("three", taichisoft_commands=add_sweep)
    both = r"^two plug-ins, 'three' \(plugin_three\) and 'two' \(plugin_two\), both add the command 'shape sweep'$"
    with pytest.raises(PluginError, match=both):
        with_plugin_commands(typer.Typer())
