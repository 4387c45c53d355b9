"""The `taichisoft` command: run a scene, list plug-ins, and what plug-ins add."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from taichisoft import __version__
from taichisoft.errors import GoalMissed, TaichisoftError
from taichisoft.plugins import add_commands, list_plugins

application = typer.Typer(
    name="taichisoft",
    help="Soft pneumatic grippers as finite elements with contact and friction, without a desktop.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

EXIT_GOAL_MISSED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main() -> None:
    """Run the command line; what is the user's to mend is one line without a traceback."""
    try:
        add_commands(application)
        application()
    except GoalMissed as error:
        _complain(error)
        sys.exit(EXIT_GOAL_MISSED)
    except TaichisoftError as error:
        _complain(error)
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


def _complain(error: Exception) -> None:
    """One line, whatever a parser or a plug-in had to say."""
    print(f"taichisoft: {' '.join(str(error).split())}", file=sys.stderr)


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
def run_command(
    scene: Annotated[str, typer.Argument(help="Scene file (TOML), or the name of a shipped one, such as gripper.")],
    controller: Annotated[str | None, typer.Option(help="Name of a controller; the scene's own otherwise.")] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for the results; out/SCENE otherwise.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Override a value: --set contact.friction=0.3 (repeatable).")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time [s]; the scene's otherwise.")] = None,
    outputs: Annotated[str, typer.Option(help="Outputs by name, separated by commas.")] = "recording,metrics",
    profile: Annotated[bool, typer.Option("--profile", help="Show where the time of a step goes.")] = False,
) -> None:
    """Simulate a scene and write the results to a folder."""
    from taichisoft.run_command import run_scene  # starts Taichi, which --help need not wait for

    names = [name.strip() for name in outputs.split(",") if name.strip()]
    interrupted = run_scene(scene, controller, output, set_ or [], duration, names, profile)
    if interrupted:
        raise typer.Exit(EXIT_INTERRUPTED)


@application.command("plugins")
def plugins_command() -> None:
    """List the plug-ins that are loaded and what they provide."""
    from rich.console import Console
    from rich.table import Table

    table = Table("plug-in", "version", "from", "provides")
    for plugin in list_plugins():
        table.add_row(plugin.name, plugin.version, plugin.source, ", ".join(plugin.provides))
    Console().print(table)
