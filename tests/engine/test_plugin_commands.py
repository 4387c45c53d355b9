"""The command line with plug-ins: where they may be named, what they add to it, options of runs, and how they fail."""

from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from conftest import Command

import taichisoft.step.time_stepper  # noqa: F401 - Taichi may say something when it starts: not in the middle of a test
from taichisoft import group_with_default
from taichisoft.errors import PluginError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running import plugins
from taichisoft.running.plugin_commands import command_names, with_plugin_commands

Install = Callable[..., None]
RUN = ("run", str(TINY_GRIPPER), "--output", "out")

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

PLUGINS = {"wave.py": WAVE, "clumsy.py": CLUMSY, "counter.py": COUNTER, "reader.py": READER}


@pytest.fixture
def command(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Command:
    """Runs the command in a folder of its own with these plug-ins."""
    monkeypatch.chdir(tmp_path)
    for name, code in PLUGINS.items():
        (tmp_path / name).write_text(code)
    return plugins.separate_registry()(command)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--plugin", "wave.py", "wave", "--hands", "3"],
        ["wave", "--plugin", "wave.py", "--hands", "3"],
        ["wave", "--hands", "3", "--plugin=wave.py"],
        ["--plugin=wave.py", "wave", "--plugin", "wave.py", "--hands", "3"],
    ],
)
def test_plugins_may_be_named_anywhere(command: Command, arguments: list[str]) -> None:
    assert command(*arguments) == (0, "hello hello hello \n", "")


@pytest.mark.parametrize(
    "arguments", [[], ["run"], ["mesh"], ["plugins"], ["plugins", "new"], ["wave", "--plugin", "wave.py"]]
)
def test_every_help_shows_the_option_plugin(command: Command, arguments: list[str]) -> None:
    code, output, _ = command(*arguments, "--help")
    assert code == 0
    assert "--plugin " in output


def test_command_of_no_plugin_is_refused(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither is the plug-in loaded when it is not named, nor when it is left out."""
    for arguments in (["wave"], ["wave", "--plugin", "wave.py"]):
        code, _, errors = command(*arguments)
        monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", "wave")
        assert code == 2 and "No such command 'wave'" in errors


def test_help_and_list_show_what_plugin_adds(command: Command, tmp_path: Path) -> None:
    assert "Wave to somebody." in command("--help", "--plugin", "wave.py")[1]
    code, output, errors = command("plugins", "--plugin", "wave.py")
    assert (code, errors) == (0, "")
    row = output[output.index("│ wave") :]
    for shown in ("file", str(tmp_path / "wave.py"), "controller wave", "command wave"):
        assert shown in row
    shown = command("run", "--help", "--plugin", "counter.py")[1]
    assert "--count-from" in shown and "Where to begin." in shown and "Outputs" in shown
    listed = command("plugins", "--plugin", "counter.py")[1]
    assert "run option --count-from" in " ".join(listed.replace("│", " ").split())


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["plugins", "--plugin", "nothing.py"], "nothing.py: no such file"),
        (["--help", "--plugin", "nothing"], "nothing: no such file"),
        (["plugins", "--plugin"], "Option '--plugin' requires an argument"),
        (["plugins", "new", "class"], "Python has a 'class' already"),
        (["run", "gripper", "--plugin", "wave.py", "--controller", "wav"], "there are: "),
        ([*RUN, "--plugin", "counter.py", "--count-from", "soon"], "Invalid value for '--count-from'"),
    ],
)
def test_wrong_arguments_are_one_line(command: Command, arguments: list[str], problem: str) -> None:
    code, _, errors = command(*arguments)
    (line,) = errors.splitlines()
    assert code == 2
    assert line.startswith("taichisoft: ")
    assert problem in line


def test_failed_plugin_shows_its_traceback(command: Command, tmp_path: Path) -> None:
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


def test_failed_controller_leaves_traceback_and_recording(command: Command, tmp_path: Path) -> None:
    import h5py

    file = tmp_path / "clumsy.py"
    plugin = ("--plugin", "clumsy.py", "--controller", "clumsy")
    code, output, errors = command(*RUN, *plugin, "--outputs", "recording,blind")
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
        assert recording.attrs["outcome"].decode() == line.removeprefix("taichisoft: ")
        assert len(recording["steps/time"]) == 1 + 3


@pytest.mark.parametrize(
    ("place", "before", "after"),
    [
        ("control()", "return json.loads", "raise SystemExit(0) #"),
        ("end()", 'raise ValueError("no light")', "raise SystemExit(0)"),
    ],
)
def test_exit_in_part_ends_run_with_error(
    command: Command, tmp_path: Path, place: str, before: str, after: str
) -> None:
    import h5py

    (tmp_path / "clumsy.py").write_text(CLUMSY.replace(before, after).replace("< 3", "< 3 or 'end' in " + repr(place)))
    plugin = ("--plugin", "clumsy.py", "--controller", "clumsy")
    code, _, errors = command(*RUN, *plugin, "--outputs", "blind,recording", "--duration", "0.1")
    assert code == 1
    assert f"failed in {place}: SystemExit: 0 (clumsy.py, line" in errors.splitlines()[0]
    with h5py.File(tmp_path / "out" / "recording.h5") as recording:
        assert recording.attrs["outcome"].decode() not in ("", "unfinished")


def test_unknown_blocked_names_are_warned_of(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TAICHISOFT_DISABLE_PLUGINS", "wave,meshng")
    code, output, errors = command("plugins", "--plugin", "wave.py")
    assert code == 0
    assert "wave" not in output
    told = (
        "taichisoft: TAICHISOFT_DISABLE_PLUGINS names 'meshng', which no plug-in is called; did you mean 'meshing'?\n"
    )
    assert errors == told


def adding(name: str, group: str | None = None) -> Callable[[typer.Typer], None]:
    """A hook that adds a command, or a group with it."""

    def add(application: typer.Typer) -> None:
        added = application
        if group is not None:
            added = typer.Typer()
            application.add_typer(added, name=group)
        added.command(name)(lambda: None)

    return add


def test_commands_of_same_name_are_refused(install: Install) -> None:
    """Both owners are named; the application itself has not changed."""
    own = typer.Typer()
    own.command("run")(lambda: None)
    own.command("plugins")(lambda: None)
    install("one", taichisoft_commands=adding("wave"))
    assert list(with_plugin_commands(own).commands) == ["run", "plugins", "wave"]
    assert command_names(typer.main.get_group(own)) == ["run", "plugins"]
    install("two", taichisoft_commands=adding("back", group="run"))
    with pytest.raises(PluginError, match=r"^two plug-ins, taichisoft itself and 'two' \(plugin_two\), both add the c"):
        with_plugin_commands(own)


def test_plugins_that_add_same_command_are_named(install: Install) -> None:
    install("one", taichisoft_commands=adding("wave"))
    install("two", taichisoft_commands=adding("wave"))
    both = r"^two plug-ins, 'one' \(plugin_one\) and 'two' \(plugin_two\), both add the command 'wave'$"
    with pytest.raises(PluginError, match=both):
        with_plugin_commands(typer.Typer())


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
def test_groups_of_same_name_become_one(
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
def test_wrong_arguments_of_groups_are_one_line(
    command: Command, install: Install, arguments: list[str], problem: str
) -> None:
    install_shapes(install)
    assert command(*arguments) == (2, "", f"taichisoft: {problem}\n")


def test_help_of_group_shows_default_and_commands(command: Command, install: Install) -> None:
    install_shapes(install)
    code, output, _ = command("shape", "--help")
    assert code == 0
    for part in (" | COMMAND", "Make a shape.", "--fine", "--plugin ", "Show a shape.", "Make many shapes."):
        assert part in output


def test_groups_with_two_defaults_or_commands_are_refused(install: Install) -> None:
    own = typer.Typer()
    own.add_typer(group_with_default(shape), name="shape")
    install_shapes(install)
    with pytest.raises(
        PluginError, match=r"^two plug-ins, taichisoft itself and 'one' .*, both add the command 'shape'$"
    ):
        with_plugin_commands(own)

    install("three", taichisoft_commands=adding("sweep", group="shape"))
    both = r"^two plug-ins, 'three' \(plugin_three\) and 'two' \(plugin_two\), both add the command 'shape sweep'$"
    with pytest.raises(PluginError, match=both):
        with_plugin_commands(typer.Typer())


COUNTED = (*RUN, "--duration", "0.03", "--outputs", "csv", "--plugin", "counter.py")
OTHER = ("--controller", "other")


@pytest.mark.parametrize(
    ("options", "file", "written"),
    [
        (["--count"], "count", "3"),
        (["--count-from", "4"], "count", "7"),
        (["--count-from=4", "--count-file", "steps.txt", "--count-loud"], "steps.txt", "7!"),
    ],
)
def test_option_brings_its_output(command: Command, options: list[str], file: str, written: str) -> None:
    code, _, errors = command(*COUNTED, *OTHER, *options)
    assert code == 0, errors
    assert Path("out", file).read_text() == written
    assert list(Path("out").glob("*.csv"))


def test_output_without_its_options_needs_its_name(command: Command) -> None:
    assert command(*COUNTED, *OTHER)[0] == 0
    assert not Path("out", "count").exists()
    assert command(*COUNTED, *OTHER, "--outputs", "counter")[0] == 0
    assert Path("out", "count").read_text() == "3"


def test_option_names_controller_if_user_does_not(command: Command) -> None:
    assert "idle" in command(*COUNTED, "--count")[1]
    assert "idle" not in command(*COUNTED, "--count-from", "1")[1]
    assert "idle" not in command(*COUNTED, *OTHER, "--count")[1]


def test_option_without_output_belongs_to_reader(command: Command, tmp_path: Path) -> None:
    (tmp_path / "one.cube").touch()
    plugin = ("--plugin", "reader.py", "--plugin", "counter.py")
    arguments = ("--duration", "0.01", "--output", "out", *OTHER, "--outputs", "csv", *plugin)
    assert command("run", "one.cube", *arguments)[0] == 0
    assert "[\n    10.0," in Path("out", "scene.toml").read_text()
    code, _, errors = command("run", "one.cube", "--edge", "7", *arguments)
    assert (code, errors) == (0, "")
    assert "[\n    7.0," in Path("out", "scene.toml").read_text()
    code, _, errors = command("run", str(TINY_GRIPPER), "--edge", "7", *arguments)
    assert code == 2 and "edge has no effect on a .toml scene" in errors
    assert "--edge" in command("run", "--help", *plugin)[1]
    assert "--edge" not in command("resume", "--help", *plugin)[1]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("[]", "gave []; must be a mapping by name"),
        ('{"count": RunOption("counter", "")}', "gave the name 'count'; must begin with --"),
        ('{"--count": "counter"}', "gave 'counter' as '--count'; must be a RunOption"),
        ('{"--speed": RunOption("counter", "")}', "'--speed' of output 'counter': `taichisoft run` has one"),
    ],
)
def test_wrong_option_is_refused(command: Command, tmp_path: Path, options: str, problem: str) -> None:
    head = COUNTER.partition('    return {\n        "--count"')[0]
    (tmp_path / "counter.py").write_text(head + f"    return {options}\n")
    code, _, errors = command(*COUNTED, *OTHER)
    assert code == 2 and problem in errors


def test_options_of_same_name_are_refused(command: Command, tmp_path: Path) -> None:
    other = COUNTER.replace('"counter"', '"other"').replace('"idle"', '"other"')
    (tmp_path / "other.py").write_text(other)
    code, _, errors = command(*COUNTED, *OTHER, "--plugin", "other.py")
    assert code == 2
    assert "'counter'" in errors and "'other'" in errors and "both provide the run option '--count'" in errors
