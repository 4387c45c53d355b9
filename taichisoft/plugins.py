"""The plug-in registry: installed distributions announce themselves in the entry-point group `taichisoft`."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import pluggy

from taichisoft import hookspecs
from taichisoft.errors import PluginError


@functools.cache
def plugin_registry() -> pluggy.PluginManager:
    """Load every installed plug-in once per process.

    Raises:
        PluginError: a plug-in cannot be imported, or implements a hook that does not exist.
    """
    registry = pluggy.PluginManager(hookspecs.PROJECT)
    registry.add_hookspecs(hookspecs)
    for entry_point in entry_points(group=hookspecs.PROJECT):
        registry.register(_load(entry_point), name=entry_point.name)
    try:
        registry.check_pending()
    except pluggy.PluginValidationError as error:
        raise PluginError(f"plug-in: {error}") from error
    return registry


def make(hook: str, kind: str, name: str, *arguments: Any, **settings: Any) -> Any:
    """Make the controller or output called `name`, from what the plug-ins provide through `hook`.

    Raises:
        PluginError: nothing or more than one thing has that name.
    """
    found: dict[str, Callable[..., Any]] = {}
    for provided in getattr(plugin_registry().hook, hook)():
        clash = sorted(found.keys() & provided.keys())
        if clash:
            raise PluginError(f"two plug-ins provide a {kind} called '{clash[0]}'")
        found.update(provided)
    if name not in found:
        raise PluginError(f"no {kind} is called '{name}'; there are: {', '.join(sorted(found)) or 'none'}")
    return found[name](*arguments, **settings)


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
    rows = []
    for name, plugin in plugin_registry().list_name_plugin():
        distribution = distributions.get(name)
        version = distribution.version if distribution is not None else ""
        rows.append(LoadedPlugin(name, version, getattr(plugin, "__name__", repr(plugin)), _provided_by(plugin)))
    return rows


def _provided_by(plugin: Any) -> list[str]:
    """What a plug-in gives through each hook that it implements."""
    provided = []
    for hook, kind in (("taichisoft_controllers", "controller"), ("taichisoft_outputs", "output")):
        if hasattr(plugin, hook):
            provided += [f"{kind} {name}" for name in sorted(getattr(plugin, hook)())]
    if hasattr(plugin, "taichisoft_commands"):
        provided.append("commands")
    return provided
