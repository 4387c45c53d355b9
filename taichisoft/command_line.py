"""The `taichisoft` command: run a scene, list plug-ins, and what plug-ins add."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft import __version__
from taichisoft.errors import GoalMissed, PluginFailed, TaichisoftError
from taichisoft.plugin_system import plugins, plugins_command
from taichisoft.plugin_system.commands import load_requested, with_plugin_commands
from taichisoft.plugin_system.failure import plugin_traceback
from taichisoft.plugin_system.run_options import (
    GoalOption,
    OutputsOption,
    SpeedOption,
    requested,
    takes_reader_options,
    takes_run_options,
)
from taichisoft.terminal_text import printable

application = typer.Typer(
    name="taichisoft",
    help="Soft pneumatic grippers as finite elements with contact and friction, without a desktop.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

application.add_typer(plugins_command.application, name="plugins")

LONGEST_LINE = 1000
"""Characters of an error that are shown."""

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

USAGE_ERROR: Any = typer.BadParameter.__base__  # has no public name; every error of the parser is one


def main() -> None:
    """Run the command line; what is the user's to mend is one line, and the traceback of a plug-in that failed."""
    try:
        load_requested(sys.argv[1:])
        for line in plugins.plugin_registry().unknown_blocked():
            _complain(line)
        command = with_plugin_commands(application)
        code = command(prog_name="taichisoft", standalone_mode=False)  # otherwise typer draws boxes round errors
        sys.exit(code if isinstance(code, int) else 0)
    except USAGE_ERROR as error:
        if message := error.format_message().rstrip("."):  # empty where help was shown because nothing was asked for
            _complain(f"{message}; see {error.ctx.command_path} --help" if error.ctx else message)
        sys.exit(EXIT_BAD_INPUT)
    except (GoalMissed, PluginFailed) as error:
        _complain(error)
        sys.exit(EXIT_FAILED)
    except TaichisoftError as error:
        _complain(error)
        sys.exit(EXIT_BAD_INPUT)
    except OSError as error:  # what the system refuses: a name too long, a folder that may not be read
        _complain(f"{error.filename}: {error.strerror}" if error.filename is not None else str(error))
        sys.exit(EXIT_BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(EXIT_INTERRUPTED)


def _complain(problem: Exception | str) -> None:
    """One line, whatever a parser or a plug-in had to say; under it where a plug-in raised what it should not."""
    line = printable(" ".join(str(problem).split()))
    if len(line) > LONGEST_LINE:  # it repeats what was given, such as a name of thousands of characters
        line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
    print(f"taichisoft: {line}", file=sys.stderr)
    if isinstance(problem, TaichisoftError):
        print(printable(plugin_traceback(problem)), end="", file=sys.stderr)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"taichisoft {__version__}")
        raise typer.Exit


@application.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Options of the command itself."""


@application.command("run")
@takes_run_options
@takes_reader_options
def run_command(
    context: typer.Context,
    scene: Annotated[
        str, typer.Argument(help="Scene file (TOML, SOFA's Python), or the name of a shipped one, such as gripper.")
    ],
    controller: Annotated[str | None, typer.Option(help="Name of a controller  \\[default: the scene's own]")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the results  \\[default: out/SCENE]")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: --set contact.friction=0.3 (repeatable).")
    ] = None,
    goal: GoalOption = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time \\[s]  \\[default: the scene's]")] = None,
    outputs: OutputsOption = "recording,metrics",
    speed: SpeedOption = None,
    keys: Annotated[Path | None, typer.Option(help="Key log (keys.jsonl) of an earlier run, to repeat it.")] = None,
    profile: Annotated[bool, typer.Option("--profile", help="Show where the time of a step goes.")] = False,
) -> None:
    """Simulate a scene and write the results to a folder."""
    from taichisoft.running.command import RunRequest, run_scene  # these start Taichi, which --help need not wait for
    from taichisoft.session.key_log import KeyReplay

    asked = requested(context, outputs)
    folder = output or Path("out") / Path(scene).stem
    replay = KeyReplay(keys) if keys is not None else None
    request = RunRequest(folder, asked.outputs, duration, speed, replay, profile, asked.controller)
    run_scene(scene, set_ or [], controller, request, asked.reader, goal)
