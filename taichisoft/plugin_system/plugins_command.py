"""`taichisoft plugins`: what is loaded, and how a new one is begun."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from taichisoft.plugin_system.commands import command_names, commands_by_plugin
from taichisoft.plugin_system.hooks import KINDS, implementations, provided, provided_by_plugin
from taichisoft.plugin_system.plugins import plugin_registry
from taichisoft.plugin_system.registry import Origin, hook_names
from taichisoft.terminal_text import plain, say

application = typer.Typer(help="List the plug-ins that are loaded, or begin one of your own.")

LIFE_CYCLE = [name for name in hook_names() if name not in (*KINDS.values(), "taichisoft_commands")]


@dataclass(frozen=True)
class LoadedPlugin:
    """One row of the list.

    Attributes:
        name: name under which it can be left out.
        origin: place that it came from, with its version.
        provides: controllers, outputs and so on with their names, and the hooks that it is called by.
    """

    name: str
    origin: Origin
    provides: list[str]


def list_plugins() -> list[LoadedPlugin]:
    """Every loaded plug-in, in the order of loading.

    Raises:
        PluginError: one cannot say what it provides, or something that it provides is not valid.
    """
    registry = plugin_registry()
    provides: dict[str, list[str]] = {name: [] for name in registry.origins}
    for kind in KINDS:
        provided(kind)  # no name may be claimed twice
        for name, by_name in provided_by_plugin(kind):
            provides[name] += [f"{kind} {key}" for key in sorted(by_name)]
    for name, added in commands_by_plugin():
        provides[name] += [f"command {command}" for command in command_names(added)]
    for hook in LIFE_CYCLE:
        for implementation in implementations(hook):
            provides[implementation.plugin_name].append(f"{hook}()")
    return [LoadedPlugin(name, origin, provides[name]) for name, origin in registry.origins.items()]


@application.callback(invoke_without_command=True)
def list_command(context: typer.Context) -> None:
    """List the plug-ins that are loaded and what they provide, or begin one of your own."""
    if context.invoked_subcommand is not None:
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for heading in ("plug-in", "version", "from", "provides"):
        table.add_column(heading, overflow="fold")
    for plugin in list_plugins():
        origin = plugin.origin
        source = " ".join(filter(None, (origin.kind, origin.distribution)))
        cells = (plugin.name, origin.version, f"{source}\n{origin.place}", "\n".join(plugin.provides))
        table.add_row(*(plain(cell) for cell in cells))
    Console().print(table)


@application.command("new")
def new_command(
    name: Annotated[
        str, typer.Argument(help="Name of the plug-in, its distribution and its controller, such as soft-touch.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the project  \\[default: NAME in this folder]")
    ] = None,
) -> None:
    """Write a project with a controller, a test and all that it takes to publish it."""
    from taichisoft.plugin_system.new_plugin import check_name, write_project

    module, written = check_name(name), write_project(name, output)
    say(f"{written} holds the plug-in '{name}'; what to do with it is in its README.md. To begin with:\n")
    for command in (
        f"cd {shlex.quote(str(written))}",
        "python -m pytest",
        f"taichisoft run gripper --plugin {module}.py --controller {name} --duration 1 --outputs recording",
    ):
        say(f"  {command}")
