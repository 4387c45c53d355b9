"""Commands of plug-ins, groups of commands, and the option that loads plug-ins, which every command takes."""

import importlib.util
import inspect
import keyword
import re
import shlex
import string
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperGroup

from taichisoft import __version__
from taichisoft.base.files import named_os_errors
from taichisoft.base.text import plain, say
from taichisoft.errors import PluginError
from taichisoft.running import plugins
from taichisoft.running.hooks import KINDS, ask, implementations, provided, provided_by_plugin
from taichisoft.running.hookspecs import RunOption
from taichisoft.running.plugins import DISABLE, hook_names, plugin_registry

# Options of `taichisoft run` that plug-ins add: each brings an output, or sets something of one or of a reader.

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
    """Let the parser of a command take them, if the command makes a run."""
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


FILE_OPTION = "--plugin"


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
        if option == FILE_OPTION:
            path = value if separator else next(waiting, "")
            if path:  # otherwise the parser says what is missing
                plugins.load_plugin(path)


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
    while arguments[count:] and arguments[count].partition("=")[0] == FILE_OPTION:
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
    """A parser with the commands of an application and of all plug-ins; each takes the option that loads plug-ins.

    Groups of one name become one group, so that a plug-in can add `taichisoft mesh sweep` to another's `mesh`.
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
    """Name of each plug-in that adds commands, and a group that has them."""
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
    """Put the commands that a plug-in adds, the owner, into a group whose commands have the owners given."""
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
) -> None:
    """Option whose values `load_requested` has used when the parser sees them."""


# `taichisoft plugins`: the loaded plug-ins, and the project of a new one.

application = typer.Typer(help="List the plug-ins that are loaded, or begin one of your own.")

LIFE_CYCLE = [name for name in hook_names() if name not in (*KINDS.values(), "taichisoft_commands")]


def provided_names() -> dict[str, list[str]]:
    """What each loaded plug-in provides, in the order of loading: things with their names, commands, hooks of a run."""
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


TEMPLATES = Path(__file__).parent / "plugin_template"

# The file that each template makes; the names of files are templates, too.
FILES = {
    "pyproject.toml.template": "pyproject.toml",
    "README.md.template": "README.md",
    "plugin.py.template": "$module.py",
    "test_plugin.py.template": "tests/test_$module.py",
}


def check_name(name: str) -> str:
    """The name of the module of a plug-in called `name`."""
    if not re.fullmatch(r"[A-Za-z](?:[A-Za-z0-9._-]*[A-Za-z0-9])?", name):
        raise PluginError(
            f"'{name}' cannot be the name of a plug-in: it must begin with a letter, end with a letter or a digit, and "
            "have only letters, digits, '-', '_' and '.' in it, such as soft-touch"
        )
    registry = plugin_registry()
    if name in registry.origins:
        raise PluginError(f"a plug-in is called '{name}' already: {registry.origins[name]}; choose another name")
    if name in provided("controller"):
        raise PluginError(f"a controller is called '{name}' already; choose another name")
    module = re.sub(r"[-_.]+", "_", name).lower()
    if keyword.iskeyword(module) or module in sys.stdlib_module_names or importlib.util.find_spec(module) is not None:
        raise PluginError(f"'{name}' cannot be the name of a plug-in: Python has a '{module}' already")
    return module


def write_project(name: str, folder: Path | None = None) -> Path:
    """Write a project for a plug-in called `name` to a new or empty folder, by default `name` here; returns it."""
    module = check_name(name)
    folder = folder or Path(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise PluginError(f"{folder}: exists already; choose another name")
    values = {"name": name, "module": module, "taichisoft_version": __version__}
    for template, path in FILES.items():
        text = (TEMPLATES / template).read_text(encoding="utf-8")
        written = folder / string.Template(path).substitute(values)
        with named_os_errors(written, PluginError):
            written.parent.mkdir(parents=True, exist_ok=True)
            written.write_text(string.Template(text).substitute(values), encoding="utf-8")
    return folder


@application.command("new")
def new_command(
    name: Annotated[
        str, typer.Argument(help="Name of the plug-in, its folder, distribution and controller, such as soft-touch.")
    ],
) -> None:
    """Write a project with a controller, a test and all that publishing it needs to the folder NAME."""
    module, folder = check_name(name), write_project(name)
    say(f"{folder} holds the plug-in '{name}'; its README.md says what to do with it. To begin with:\n")
    for command in (
        f"cd {shlex.quote(str(folder))}",
        "python -m pytest",
        f"taichisoft run gripper --plugin {module}.py --controller {name} --duration 1 --outputs recording",
    ):
        say(f"  {command}")
