"""The plug-in registry: installed distributions announce themselves in the entry-point group `taichisoft`."""

import functools
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pluggy

from taichisoft import hookspecs
from taichisoft.errors import GoalMissed, PluginError

if TYPE_CHECKING:
    import typer

KINDS = {"controller": "taichisoft_controllers", "output": "taichisoft_outputs"}
"""What a plug-in can provide by name, and the hook that it does so through."""


@functools.cache
def plugin_registry() -> pluggy.PluginManager:
    """Load every installed plug-in once per process.

    Raises:
        PluginError: a plug-in cannot be imported, two have one name, or one implements a hook that does not exist.
    """
    registry = pluggy.PluginManager(hookspecs.PROJECT)
    registry.add_hookspecs(hookspecs)
    loaded: dict[str, str] = {}
    for entry_point in entry_points(group=hookspecs.PROJECT):
        name, where = entry_point.name, entry_point.value
        if name in loaded:
            raise PluginError(f"two plug-ins are called '{name}': {loaded[name]} and {where}; uninstall one of them")
        loaded[name] = where
        try:
            registry.register(_load(entry_point), name=name)
        except (ValueError, pluggy.PluginValidationError) as error:
            raise PluginError(f"plug-in '{name}' ({where}) cannot be registered: {error}") from error
    try:
        registry.check_pending()
    except pluggy.PluginValidationError as error:
        raise PluginError(f"plug-in: {error}; there are: {', '.join(_hook_names())}") from error
    return registry


def find(kind: str, name: str) -> Callable[..., Any]:
    """What makes the controller or output called `name`; `kind` is one of `KINDS`.

    Raises:
        PluginError: nothing or more than one thing has that name.
    """
    found: dict[str, tuple[str, Callable[..., Any]]] = {}
    for plugin, provided in _provided(kind):
        for key, factory in provided.items():
            if key in found:
                raise PluginError(f"two plug-ins, '{found[key][0]}' and '{plugin}', both provide the {kind} '{key}'")
            found[key] = (plugin, factory)
    if name not in found:
        raise PluginError(f"no {kind} is called '{name}'; there are: {', '.join(sorted(found)) or 'none'}")
    return found[name][1]


def add_commands(application: "typer.Typer") -> None:
    """Let every plug-in add its sub-commands to the command line.

    Raises:
        PluginError: a plug-in could not.
    """
    for _ in _answers("taichisoft_commands", application=application):
        pass


def notify(hook: str, **arguments: Any) -> None:
    """Call a life-cycle hook of every plug-in that implements it; costs next to nothing when none does.

    Raises:
        PluginError: an implementation failed; those after it are not called.
        GoalMissed: an implementation says that the run has missed its goal.
    """
    if getattr(plugin_registry().hook, hook).get_hookimpls():
        for _ in _answers(hook, **arguments):
            pass


def plugin_failure(what: str, error: Exception) -> PluginError:
    """One line about an exception that a plug-in did not expect, with the place where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return PluginError(f"{what}: {type(error).__name__}: {error}{place}")


def _hook_names() -> list[str]:
    return [name for name in vars(hookspecs) if name.startswith(f"{hookspecs.PROJECT}_")]


def _answers(hook: str, **arguments: Any) -> Iterator[tuple[str, Any]]:
    """Name and answer of each plug-in that implements the hook: called one by one, so that an error has a name."""
    for implementation in getattr(plugin_registry().hook, hook).get_hookimpls():
        name = implementation.plugin_name
        try:
            answer = implementation.function(*(arguments[argument] for argument in implementation.argnames))
        except GoalMissed:
            raise
        except Exception as error:
            raise plugin_failure(f"plug-in '{name}' failed in {hook}()", error) from error
        yield name, answer


def _provided(kind: str) -> Iterator[tuple[str, Mapping[str, Callable[..., Any]]]]:
    """Name of each plug-in and what it provides of a kind."""
    for plugin, provided in _answers(KINDS[kind]):
        if not isinstance(provided, Mapping):
            raise PluginError(f"plug-in '{plugin}': {KINDS[kind]}() gave {provided!r}; must be a mapping by name")
        yield plugin, provided


def _load(entry_point: EntryPoint) -> Any:
    try:
        return entry_point.load()
    except Exception as error:
        raise PluginError(f"plug-in '{entry_point.name}' ({entry_point.value}) cannot be imported: {error}") from error


@dataclass(frozen=True)
class LoadedPlugin:
    """One row of `taichisoft plugins`."""

    name: str
    version: str
    source: str
    provides: list[str]


def list_plugins() -> list[LoadedPlugin]:
    """Every loaded plug-in, in the order of loading."""
    distributions = {entry_point.name: entry_point.dist for entry_point in entry_points(group=hookspecs.PROJECT)}
    provides: dict[str, list[str]] = {name: [] for name, _ in plugin_registry().list_name_plugin()}
    for kind in KINDS:
        for name, provided in _provided(kind):
            provides[name] += [f"{kind} {key}" for key in sorted(provided)]
    for implementation in plugin_registry().hook.taichisoft_commands.get_hookimpls():
        provides[implementation.plugin_name].append("commands")
    rows = []
    for name, plugin in plugin_registry().list_name_plugin():
        distribution = distributions.get(name)
        version = distribution.version if distribution is not None else ""
        rows.append(LoadedPlugin(name, version, getattr(plugin, "__name__", repr(plugin)), provides[name]))
    return rows
