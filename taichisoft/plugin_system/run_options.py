"""Options of `taichisoft run` that plug-ins add: each brings an output into the run, or a setting of one."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from taichisoft.errors import PluginError
from taichisoft.plugin_system import plugins
from taichisoft.plugin_system.run_option import RunOption

HOOK = "taichisoft_run_options"
TAKES = "takes_run_options"
"""Attribute of functions that make a run."""
GIVEN = "taichisoft.run_options"
"""Where a parsed command line keeps the values of the options that were given."""

CommandFunction = TypeVar("CommandFunction", bound=Callable[..., Any])


@dataclass(frozen=True)
class Requested:
    """What the options that were given ask for.

    Attributes:
        outputs: settings by the name of the output.
        controller: None where no option names one.
    """

    outputs: Mapping[str, dict[str, Any]]
    controller: str | None


def run_options() -> dict[str, RunOption]:
    """The options of all plug-ins by name ("--web").

    Raises:
        PluginError: two plug-ins claim one name, or one gave something that is no option.
    """
    registry = plugins.plugin_registry()
    found: dict[str, tuple[str, RunOption]] = {}
    for plugin, options in options_by_plugin():
        for name, option in options.items():
            if name in found:
                both = f"{registry.described(found[name][0])} and {registry.described(plugin)}"
                raise PluginError(f"two plug-ins, {both}, both add the option '{name}' to `taichisoft run`")
            found[name] = (plugin, option)
    return {name: option for name, (_, option) in found.items()}


def options_by_plugin() -> Iterator[tuple[str, Mapping[str, RunOption]]]:
    """Name of each plug-in that adds options, and its options by name.

    Raises:
        PluginError: one gave something that is no option.
    """
    for plugin, options in plugins.answers(HOOK):
        gave = f"plug-in {plugins.plugin_registry().described(plugin)}: {HOOK}() gave"
        if not isinstance(options, Mapping):
            raise PluginError(f"{gave} {options!r}; must be a mapping by name")
        for name, option in options.items():
            if not (isinstance(name, str) and name.startswith("--") and len(name) > 2):
                raise PluginError(f"{gave} the name {name!r}; must begin with --")
            if not isinstance(option, RunOption):
                raise PluginError(f"{gave} {option!r} as '{name}'; must be a RunOption")
        yield plugin, options


def takes_run_options(function: CommandFunction) -> CommandFunction:
    """Decorator of a command that makes a run: it takes the options that plug-ins add, see `requested`."""
    setattr(function, TAKES, True)
    return function


def add_run_options(command: Any) -> None:
    """Let the parser of a command that makes a run take them.

    Raises:
        PluginError: see `run_options`; or an option has the name of one of the command's own.
    """
    own = {name for parameter in command.params for name in parameter.opts}
    for name, option in run_options().items():
        if name in own:
            raise PluginError(f"option '{name}' of output '{option.output}': `taichisoft run` has one of this name")
        command.params.append(_parsed(name, option))


def requested(given: Mapping[str, Any], names: Sequence[str]) -> Requested:
    """What was asked for.

    Args:
        given: `meta` of the parsed command line.
        names: the outputs that it names itself.
    """
    options = run_options()
    values: dict[str, Any] = given.get(GIVEN, {})
    outputs: dict[str, dict[str, Any]] = {name: {} for name in names}
    controller = None
    for name, value in values.items():
        option = options[name]
        settings = outputs.setdefault(option.output, {})
        if option.setting is not None:
            settings[option.setting] = value
        controller = controller or option.controller
    return Requested(outputs, controller)


def _parsed(name: str, option: RunOption) -> Any:
    """The option as the parser has it. Typer makes options of a function's signature, so it is given one."""
    flag = option.setting is None or option.type is bool
    declared: Any = typer.Option(
        name,
        help=option.help,
        metavar=None if flag else option.metavar,
        rich_help_panel="Outputs",
        expose_value=False,
        callback=_keep(name, Path if option.type is Path else None),
    )
    typed = str if option.type is Path else option.type  # Typer makes no path of an option that was not given
    key = name.strip("-").replace("-", "_")
    kind: Any = Annotated[bool if flag else typed | None, declared]
    argument = inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False if flag else None)

    def only_option(**_: Any) -> None: ...

    only_option.__signature__ = inspect.Signature([argument.replace(annotation=kind)])  # type: ignore[attr-defined]
    only_option.__annotations__ = {key: kind}
    application = typer.Typer(add_completion=False)
    application.command()(only_option)
    (parsed,) = (parameter for parameter in typer.main.get_command(application).params if parameter.name != "help")
    return parsed


def _keep(name: str, converted: type | None) -> Any:
    def keep(context: typer.Context, value: Any) -> None:
        if value is not None and value is not False:
            context.meta.setdefault(GIVEN, {})[name] = converted(value) if converted else value

    return keep
