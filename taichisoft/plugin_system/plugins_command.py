"""`taichisoft plugins`: what is loaded, and how a new one is begun."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

application = typer.Typer(help="List the plug-ins that are loaded, or begin one of your own.")


@application.callback(invoke_without_command=True)
def list_command(context: typer.Context) -> None:
    """List the plug-ins that are loaded and what they provide, or begin one of your own."""
    if context.invoked_subcommand is not None:
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from taichisoft.plugin_system.listing import list_plugins

    table = Table("plug-in", "version", "from", "provides")
    for plugin in list_plugins():
        origin = plugin.origin
        source = " ".join(filter(None, (origin.kind, origin.distribution)))
        cells = (plugin.name, origin.version, f"{source}\n{origin.place}", "\n".join(plugin.provides))
        table.add_row(*(Text(cell, overflow="fold") for cell in cells))
    Console().print(table)


@application.command("new")
def new_command(
    name: Annotated[
        str, typer.Argument(help="Of the plug-in, its distribution and its controller, such as soft-touch.")
    ],
    folder: Annotated[Path | None, typer.Option(help="Where the project goes; NAME in this folder otherwise.")] = None,
) -> None:
    """Write a project with a controller, a test and all that it takes to publish it."""
    from taichisoft.plugin_system.new_plugin import check_name, write_project

    module, written = check_name(name), write_project(name, folder)
    print(f"{written} holds the plug-in '{name}'; what to do with it is in its README.md. To begin with:\n")
    for command in (
        f"cd {shlex.quote(str(written))}",
        "python -m pytest",
        f"taichisoft run gripper --plugin {module}.py --controller {name} --duration 1 --outputs recording",
    ):
        print(f"  {command}")
