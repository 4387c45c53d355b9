"""`taichisoft plugins`: the loaded plug-ins, and the project of a new one."""

import shlex
from typing import Annotated

import typer

from taichisoft.plugin_system.commands import command_names, commands_by_plugin
from taichisoft.plugin_system.hooks import KINDS, implementations, provided, provided_by_plugin
from taichisoft.plugin_system.plugins import plugin_registry
from taichisoft.plugin_system.registry import hook_names
from taichisoft.terminal_text import plain, say

application = typer.Typer(help="List the plug-ins that are loaded, or begin one of your own.")

LIFE_CYCLE = [name for name in hook_names() if name not in (*KINDS.values(), "taichisoft_commands")]


def provided_names() -> dict[str, list[str]]:
    """What each loaded plug-in provides, in the order of loading: things with their names, commands, hooks of a run.

    Raises:
        PluginError: a plug-in failed, or something that it provides is not valid.
    """
    names: dict[str, list[str]] = {name: [] for name in plugin_registry().origins}
    for kind in KINDS:
        provided(kind)  # no name may be claimed twice
        for plugin, by_name in provided_by_plugin(kind):
            names[plugin] += [f"{kind} {name}" for name in sorted(by_name)]
    for plugin, added in commands_by_plugin():
        names[plugin] += [f"command {command}" for command in command_names(added)]
    for hook in LIFE_CYCLE:
        for implementation in implementations(hook):
            names[implementation.plugin_name].append(f"{hook}()")
    return names


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
    origins = plugin_registry().origins
    for name, provides in provided_names().items():
        origin = origins[name]
        source = f"{origin.kind} {origin.distribution}".rstrip()
        table.add_row(*map(plain, (name, origin.version, f"{source}\n{origin.place}", "\n".join(provides))))
    Console().print(table)


@application.command("new")
def new_command(
    name: Annotated[
        str, typer.Argument(help="Name of the plug-in, its folder, distribution and controller, such as soft-touch.")
    ],
) -> None:
    """Write a project with a controller, a test and all that publishing it needs to the folder NAME."""
    from taichisoft.plugin_system.new_plugin import check_name, write_project

    module, written = check_name(name), write_project(name)
    say(f"{written} holds the plug-in '{name}'; its README.md says what to do with it. To begin with:\n")
    for command in (
        f"cd {shlex.quote(str(written))}",
        "python -m pytest",
        f"taichisoft run gripper --plugin {module}.py --controller {name} --duration 1 --outputs recording",
    ):
        say(f"  {command}")
