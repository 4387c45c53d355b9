"""Commands of plug-ins, groups of commands, and the options that load plug-ins, which every command takes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

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


class GroupWithDefault(TyperGroup):
    """A group that runs its callback where the first word after its name is not one of its commands."""

    allow_extra_args = False
    allow_interspersed_args = True

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Let the parser of a command of the group, or of the default command, read the words after the name."""
        before = _leading_loaders(args)
        name = next(iter(args[before:]), None)
        if name is None or name not in self.commands:
            return super().make_context(info_name, args, parent, **extra)
        rest = [*args[:before], *args[before + 1 :]]
        return self.commands[name].make_context(f"{info_name} {name}", rest, parent, **extra)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Arguments of the default command, or the name of a command."""
        *default, command = super().collect_usage_pieces(ctx)
        return [*default, f"| {command}"]


def _leading_loaders(arguments: Sequence[str]) -> int:
    """Number of words at the beginning of arguments that load plug-ins."""
    count = 0
    while arguments[count:] and arguments[count].partition("=")[0] in LOADERS:
        count += 1 if "=" in arguments[count] else 2
    return count


def group_with_default(default: Callable[..., Any]) -> typer.Typer:
    """Make a group of commands with a default, as in `taichisoft mesh FILE` and `taichisoft mesh info FILE`.

    The default command runs where the first word is not the name of a command of the group. A file called `info` can be
    given as `./info`.

    Args:
        default: function of the default command, whose arguments and options are declared as for Typer.
    """
    group = typer.Typer(cls=GroupWithDefault)
    group.callback(invoke_without_command=True)(default)
    return group


def with_plugin_commands(application: typer.Typer) -> Any:
    """A parser with the commands of an application and of all plug-ins; each takes the options that load plug-ins.

    Groups of one name become one group, so that a plug-in can add `taichisoft mesh sweep` to another's `mesh`.

    Raises:
        PluginError: a plug-in could not add its commands, or two claim one name.
    """
    whole: Any = typer.main.get_group(application)
    owners = {typed: "taichisoft itself" for typed, _ in _below(whole)}
    for plugin, added in commands_by_plugin():
        owner, names = plugins.plugin_registry().described(plugin), list(_below(added))
        _merge(whole, added, owner, owners)
        owners |= {typed: owner for typed, command in names if typed not in owners or _runs(command)}
    loading = parsed_options(_loading_options)
    for command in (whole, *(command for _, command in _below(whole))):
        add_run_options(command)
        command.params = [*command.params, *loading]
    return whole


def commands_by_plugin() -> Iterator[tuple[str, Any]]:
    """Name of each plug-in that adds commands, and a group that has them.

    Raises:
        PluginError: a plug-in could not.
    """
    hook = "taichisoft_commands"
    for implementation in implementations(hook):
        added = typer.Typer()
        name = implementation.plugin_name
        try:
            ask(hook, implementation, application=added)
        except PluginError as error:  # which would stand in the way of every command
            raise type(error)(f"{error}; {DISABLE}={name} leaves it out") from error.__cause__
        yield name, typer.main.get_group(added)


def command_names(group: Any) -> list[str]:
    """The commands of a group and of the groups in it as they are typed, such as "run" and "mesh info"."""
    return [typed for typed, command in _below(group) if _runs(command)]


def _below(group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every command and group below a group, with what is typed for it."""
    for name, command in group.commands.items():
        yield f"{prefix}{name}", command
        if isinstance(command, TyperGroup):
            yield from _below(command, f"{prefix}{name} ")


def _runs(command: Any) -> bool:
    """Whether a command does something by itself: a group does where it has a default."""
    return not isinstance(command, TyperGroup) or command.invoke_without_command


def _merge(group: Any, added: Any, owner: str, owners: Mapping[str, str], prefix: str = "") -> None:
    """Put the commands that a plug-in adds, the owner, into a group whose commands have the owners given.

    Raises:
        PluginError: a command, or a default of a group, is there already.
    """
    for name, command in added.commands.items():
        typed, present = f"{prefix}{name}", group.commands.setdefault(name, command)
        if present is command:
            continue
        groups = isinstance(present, TyperGroup) and isinstance(command, TyperGroup)
        if not groups or (_runs(present) and _runs(command)):
            raise PluginError(f"two plug-ins, {owners[typed]} and {owner}, both add the command '{typed}'")
        _merge(present, command, owner, owners, f"{typed} ")
        if (_runs(command), bool(command.help)) > (_runs(present), bool(present.help)):
            command.commands = present.commands
            group.commands[name] = command


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
