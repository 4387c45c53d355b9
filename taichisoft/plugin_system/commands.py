"""What plug-ins add to the command line, and the options that load plug-ins, which every command takes."""

import copy
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.errors import PluginError
from taichisoft.plugin_system import plugins
from taichisoft.plugin_system.hooks import ask, implementations
from taichisoft.plugin_system.registry import DISABLE
from taichisoft.plugin_system.run_options import add_run_options, parsed_options

FILE_OPTION = "--plugin"
FOLDER_OPTION = "--plugins-dir"
LOADERS = {FILE_OPTION: plugins.load_plugin, FOLDER_OPTION: plugins.load_plugins_folder}


def load_requested(arguments: Sequence[str]) -> None:
    """Load the plug-ins that a command line names, before it is parsed: they may add commands to it.

    Raises:
        PluginError: one cannot be loaded.
    """
    waiting = iter(arguments)
    for argument in waiting:
        if argument == "--":
            return
        option, separator, value = argument.partition("=")
        if option in LOADERS:
            path = value if separator else next(waiting, "")
            if path:  # otherwise the parser says what is missing
                LOADERS[option](path)


def with_plugin_commands(application: typer.Typer) -> Any:
    """A parser with an application's commands and those of all plug-ins; each takes the options that load plug-ins.

    Raises:
        PluginError: a plug-in could not add its commands, or two claim one name.
    """
    whole = copy.copy(application)
    whole.registered_commands = [*application.registered_commands]
    whole.registered_groups = [*application.registered_groups]
    claimed = dict.fromkeys(command_names(application), "taichisoft itself")
    registry = plugins.plugin_registry()
    for plugin, added in commands_by_plugin():
        for name in command_names(added):
            if name in claimed:
                both = f"{claimed[name]} and {registry.described(plugin)}"
                raise PluginError(f"two plug-ins, {both}, both add the command '{name}'")
            claimed[name] = registry.described(plugin)
        whole.registered_commands += added.registered_commands
        whole.registered_groups += added.registered_groups
    command: Any = typer.main.get_command(whole)
    for below in command.commands.values():
        add_run_options(below)
    _add_options(command, parsed_options(_loading_options))
    return command


def commands_by_plugin() -> Iterator[tuple[str, typer.Typer]]:
    """Name of each plug-in that adds commands, and an application that has them.

    Raises:
        PluginError: a plug-in could not.
    """
    hook = "taichisoft_commands"
    for implementation in implementations(hook):
        added = typer.Typer()
        added.callback()(lambda: None)  # without it Typer would make a single command no command of its own
        name = implementation.plugin_name
        try:
            ask(hook, implementation, application=added)
        except PluginError as error:  # which would stand in the way of every command
            raise type(error)(f"{error}; {DISABLE}={name} leaves it out") from error.__cause__
        yield name, added


def command_names(application: typer.Typer) -> list[str]:
    """The commands and groups of an application as they are typed."""
    return list(getattr(typer.main.get_command(application), "commands", {}))


def _loading_options(
    plugin: Annotated[
        list[Path] | None,
        typer.Option(
            FILE_OPTION,
            metavar="FILE.py",
            help="Load a plug-in from a file (repeatable).",
            rich_help_panel="Plug-ins",
            expose_value=False,
        ),
    ] = None,
    plugins_dir: Annotated[
        list[Path] | None,
        typer.Option(
            FOLDER_OPTION,
            metavar="DIR",
            help="Load every plug-in in a folder (repeatable).",
            rich_help_panel="Plug-ins",
            expose_value=False,
        ),
    ] = None,
) -> None:
    """Options whose values `load_requested` has used when the parser sees them."""


def _add_options(command: Any, options: list[Any]) -> None:
    """Add options to a command and to all below it."""
    command.params = [*command.params, *options]
    for below in getattr(command, "commands", {}).values():
        _add_options(below, options)
