"""The `taichisoft` command: run a scene, list plug-ins, and commands of plug-ins."""

import difflib
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer
from typer.core import TyperGroup

from taichisoft import __version__
from taichisoft.base.processes import interrupted_by_signals
from taichisoft.base.text import printable
from taichisoft.errors import GoalMissed, PluginFailed, TaichisoftError
from taichisoft.running import plugin_commands, plugins
from taichisoft.running.plugin_commands import (
    GoalOption,
    OutputsOption,
    SpeedOption,
    command_names,
    load_requested,
    requested,
    takes_reader_options,
    takes_run_options,
    with_plugin_commands,
)
from taichisoft.running.plugins import plugin_traceback

ORDER = (
    *("run", "render", "view", "resume"),  # used every day
    *("new", "mesh", "mould", "characterise", "converge", "study", "reduce"),
    *("recording", "materials", "plugins", "sofa", "doctor"),
)
"""Commands in the order of the help; further ones of plug-ins come after them."""


class CommandLine(TyperGroup):
    """All commands of taichisoft."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of the commands in the order of the help."""
        return sorted(self.commands, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the first word names; otherwise the error names what it may have meant."""
        if (word := args[0]) not in self.commands:
            meant = ", ".join(map(repr, nearest(word, [*self.commands, *command_names(self)])))
            ctx.fail(f"No such command {word!r}." + (f" Did you mean {meant}?" if meant else ""))
        return super().resolve_command(ctx, args)


def nearest(word: str, names: Sequence[str]) -> list[str]:
    """The commands that a word names apart from their group or a space; otherwise the most similar one.

    For example, "mesh-info" may mean "mesh info", "export" may mean "recording export".
    """
    spaced = f" {word.replace('-', ' ')}"
    named = [name for name in names if f" {name}".endswith(spaced)]
    return named or difflib.get_close_matches(word, names, 1)


application = typer.Typer(
    name="taichisoft",
    cls=CommandLine,
    help="Soft pneumatic grippers as finite elements with contact and friction, without a desktop.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

application.add_typer(plugin_commands.application, name="plugins")

LONGEST_LINE = 1000
"""Largest number of characters of an error message."""

OUTPUT = "standard output"

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

USAGE_ERROR: Any = typer.BadParameter.__base__  # base of the parser's errors, without a public name


def main() -> None:
    """Run the command line; an error is one line, with a traceback only if a plug-in failed."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # where the encoding is not UTF-8
    with interrupted_by_signals():
        code = _exit_code()
    problem = _flush_problem(sys.stdout)
    if problem is not None and code == 0:
        code = EXIT_BAD_INPUT
        if not isinstance(problem, BrokenPipeError):  # of `head`, which has seen enough
            _print_error(f"{OUTPUT}: {problem.strerror}")
    _flush_problem(sys.stderr)
    sys.exit(code)


def _exit_code() -> int:
    try:
        load_requested(sys.argv[1:])
        for line in plugins.plugin_registry().unknown_blocked():
            _print_error(line)
        command = with_plugin_commands(application)
        code = command(prog_name="taichisoft", standalone_mode=False)  # otherwise typer draws boxes around errors
        return code if isinstance(code, int) else 0
    except USAGE_ERROR as error:
        if message := error.format_message().rstrip("."):  # empty if help was shown for lack of arguments
            _print_error(f"{message}; see {error.ctx.command_path} --help" if error.ctx else message)
        return EXIT_BAD_INPUT
    except (GoalMissed, PluginFailed) as error:
        _print_error(error)
        return EXIT_FAILED
    except TaichisoftError as error:
        _print_error(error)
        return EXIT_BAD_INPUT
    except Warning as warning:  # which PYTHONWARNINGS=error raises
        _print_error(f"{type(warning).__name__}: {warning}")
        return EXIT_FAILED
    except OSError as error:  # such as a name too long, or an unreadable folder
        place = OUTPUT if _flush_problem(sys.stdout) else error.filename
        _print_error(str(error) if place is None else f"{place}: {error.strerror}")
        return EXIT_BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):
        return EXIT_INTERRUPTED


def _flush_problem(stream: TextIO | None) -> OSError | None:
    """Why a stream cannot be written, as on a full disk; None: it can, or is closed.

    What is left of it is dropped, or Python would report the same once more as it ends.
    """
    if stream is None:
        return None
    try:
        stream.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return error
    return None


def _print_error(problem: Exception | str) -> None:
    """Print an error in one line, and below it the traceback of a failed plug-in."""
    line = printable(" ".join(str(problem).split()))
    if len(line) > LONGEST_LINE:  # repeats the input, such as a name of thousands of characters
        line = f"{line[: LONGEST_LINE // 2]} ... {line[-LONGEST_LINE // 2 :]}"
    with suppress(OSError):  # the exit code says it, too
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
    steps: Annotated[int | None, typer.Option(help="Number of time steps, instead of --duration.", min=1)] = None,
    outputs: OutputsOption = "recording,metrics",
    speed: SpeedOption = None,
    keys: Annotated[Path | None, typer.Option(help="Key log (keys.jsonl) of an earlier run, to repeat it.")] = None,
    profile: Annotated[bool, typer.Option("--profile", help="Show the times of the phases of a step.")] = False,
    reduced: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Soft bodies move by modes of `taichisoft reduce`, or by shipped ones, such as gripper.",
        ),
    ] = None,
) -> None:
    """Simulate a scene and write the results to a folder."""
    import rich

    with rich.get_console().status("starting Taichi"):  # for which --help need not wait
        from taichisoft.running.run_command import RunRequest, run_scene
    from taichisoft.running.session import KeyReplay

    options = requested(context, outputs)
    folder = output or Path("out") / Path(scene).stem
    replay = KeyReplay(keys) if keys is not None else None
    request = RunRequest(folder, options.outputs, duration, speed, replay, profile, options.controller, reduced, steps)
    run_scene(scene, set_ or [], controller, request, options.reader, goal)
