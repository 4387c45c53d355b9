"""`taichisoft plugins`: what is loaded, and how a new one is begun."""

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

    from taichisoft.plugin_list import list_plugins

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
    from taichisoft.new_plugin import write_project

    written = write_project(name, folder)
    print(f"{written} holds the plug-in '{name}'. Try it:\n")
    print(f"  cd {written}\n  python -m pytest\n  taichisoft run gripper --plugin {written} ...")
