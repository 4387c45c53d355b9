"""Options of `taichisoft run` that plug-ins add: each brings an output, or sets something of one or of a reader."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from taichisoft.errors import PluginError
from taichisoft.plugin_system.hooks import provided
from taichisoft.plugin_system.hookspecs import RunOption

GIVEN = "taichisoft.run_options"
"""Key under which a parsed command line keeps the values of the options that were given."""

CommandFunction = TypeVar("CommandFunction", bound=Callable[..., Any])

# Options that all commands which make a run have.
OutputsOption = Annotated[str, typer.Option(help="Outputs by name, separated by commas.")]
GoalOption = Annotated[
    str | None,
    typer.Option(
        metavar="KIND", help="Goal instead of the scene's own: held, placed, pushed, lifted; none is judged by none."
    ),
]
SpeedOption = Annotated[
    float | None,
    typer.Option(help="Simulated seconds in a second, 1 is real time; as fast as it goes unless a person steers."),
]

_taking: set[Callable[..., Any]] = set()
"""Functions of the commands that make a run."""
_reading: set[Callable[..., Any]] = set()
"""Functions of the commands that read the scene of their run."""


@dataclass(frozen=True)
class Requested:
    """Outputs and controller that the options of a command line ask for.

    Attributes:
        outputs: settings by the name of the output.
        controller: name of the controller; None where no option names one.
        reader: settings of the reader of the scene.
    """

    outputs: Mapping[str, dict[str, Any]]
    controller: str | None
    reader: Mapping[str, Any]


def takes_run_options(function: CommandFunction) -> CommandFunction:
    """Decorator of a command that makes a run: it takes the options that plug-ins add, see `requested`."""
    _taking.add(function)
    return function


def takes_reader_options(function: CommandFunction) -> CommandFunction:
    """Decorator of a command that reads the scene of its run: it takes the options of scene readers, too."""
    _reading.add(function)
    return function


def add_run_options(command: Any) -> None:
    """Let the parser of a command take them, if the command makes a run.

    Raises:
        PluginError: an option is not valid, or has the name of one of the command's own.
    """
    if command.callback is None or inspect.unwrap(command.callback) not in _taking:
        return
    reads = inspect.unwrap(command.callback) in _reading
    own = {name for parameter in command.params for name in parameter.opts}
    for name, option in provided("run option").items():
        if option.output is None and not reads:
            continue
        if name in own:
            whose = f"output '{option.output}'" if option.output is not None else "scene readers"
            raise PluginError(f"option '{name}' of {whose}: `taichisoft run` has one of this name")
        command.params.append(_parsed(name, option))


def requested(context: typer.Context, outputs_option: str) -> Requested:
    """Sum up the options that were given.

    Args:
        context: parsed command line.
        outputs_option: value of --outputs.
    """
    options: Mapping[str, RunOption] = provided("run option")
    outputs: dict[str, dict[str, Any]] = {name.strip(): {} for name in outputs_option.split(",") if name.strip()}
    controller = None
    reader: dict[str, Any] = {}
    for name, value in context.meta.get(GIVEN, {}).items():
        option = options[name]
        settings = reader if option.output is None else outputs.setdefault(option.output, {})
        if option.setting is not None:
            settings[option.setting] = value
        controller = controller or option.controller
    return Requested(outputs, controller, reader)


def parsed_options(function: Callable[..., Any]) -> list[Any]:
    """The options that Typer makes of the arguments of a function."""
    application = typer.Typer(add_completion=False)
    application.command()(function)
    return [option for option in typer.main.get_command(application).params if option.name != "help"]


def _parsed(name: str, option: RunOption) -> Any:
    """The option as the parser has it. Typer makes options of a function's signature, so it is given one."""
    flag = option.setting is None or option.type is bool
    declared: Any = typer.Option(
        name,
        help=option.help,
        metavar=None if flag else option.metavar,
        rich_help_panel="Outputs" if option.output is not None else "Scenes of other programs",
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
    (parsed,) = parsed_options(only_option)
    return parsed


def _keep(name: str, converted: type | None) -> Any:
    def keep(context: typer.Context, value: Any) -> None:
        if value is not None and value is not False:
            context.meta.setdefault(GIVEN, {})[name] = converted(value) if converted else value

    return keep
