"""Calling the hooks of plug-ins, and finding what plug-ins provide by name."""

import reprlib
import sys
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint
from typing import Any

from pluggy import HookImpl

from taichisoft.base.text import warn_caller
from taichisoft.errors import GoalMissed, PluginError
from taichisoft.running.hookspecs import RunOption
from taichisoft.running.plugins import plugin_failure, plugin_registry


class Imported(Mapping[str, Any]):
    """What a plug-in provides by name, imported when it is looked up: listing the names takes no time.

    Args:
        package: the package in which the modules are.
        places: "module:name" by the name under which it is provided.
    """

    def __init__(self, package: str, places: Mapping[str, str]):
        self._package, self._places = package, places

    def __getitem__(self, name: str) -> Any:
        """Import what a name stands for."""
        return EntryPoint(name, f"{self._package}.{self._places[name]}", self._package).load()

    def __iter__(self) -> Iterator[str]:
        """The names, in their order."""
        return iter(self._places)

    def __len__(self) -> int:
        """Number of names."""
        return len(self._places)


SHORT = reprlib.Repr()  # of arguments and answers in a trace
SHORT.maxother = SHORT.maxstring = 80

KINDS = {
    "controller": "taichisoft_controllers",
    "output": "taichisoft_outputs",
    "geometry kind": "taichisoft_geometry_kinds",
    "mesh maker": "taichisoft_mesh_makers",
    "scene reader": "taichisoft_scene_readers",
    "run option": "taichisoft_run_options",
    "renderer": "taichisoft_renderers",
    "material": "taichisoft_materials",
    "scene addition": "taichisoft_scene_additions",
}
"""The kinds of things that a plug-in can provide by name, and the hook that provides each."""

NEEDED: Mapping[str, tuple[Any, str]] = {
    "run option": (RunOption, "a RunOption"),
    "material": (Mapping, "a mapping with the keys of a material's file"),
}
"""Type of what a plug-in provides, and its name in errors, of the kinds that are not made by a class or function."""


def find(kind: str, name: str) -> Callable[..., Any]:
    """Find what a plug-in provides under `name`; `kind` is one of `KINDS`."""
    things = provided(kind)
    for line in plugin_registry().unknown_blocked():
        warn_caller(line)
    if name not in things:
        valid = ", ".join(sorted(things)) or "none"
        raise PluginError(f"no {kind} is called '{name}'; there are: {valid}; --plugin FILE.py brings others")
    thing: Callable[..., Any] = things[name]
    return thing


def provided(kind: str) -> Mapping[str, Any]:
    """All that plug-ins provide of a kind, by name: options as `RunOption`, materials as tables, else what makes it.

    What is `Imported` is imported when it is looked up.

    Raises:
        PluginError: two plug-ins claim one name, or one gave something that is not valid.
    """
    registry = plugin_registry()
    owners: dict[str, str] = {}
    every: list[Any] = []
    for plugin, by_name in provided_by_plugin(kind):
        for name in by_name:
            if name in owners:
                both = f"{registry.described(owners[name])} and {registry.described(plugin)}"
                raise PluginError(f"two plug-ins, {both}, both provide the {kind} '{name}'")
            owners[name] = plugin
        every.insert(0, by_name)  # a ChainMap begins with the names of the last
    return ChainMap(*every)


def provided_by_plugin(kind: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Name of each plug-in that provides something of a kind, and what it provides by name.

    Raises:
        PluginError: one gave something that is not valid.
    """
    hook = KINDS[kind]
    for plugin, by_name in answers(hook):
        gave = f"plug-in {plugin_registry().described(plugin)}: {hook}() gave"
        if not isinstance(by_name, Mapping):
            raise PluginError(f"{gave} {by_name!r}; must be a mapping by name")
        right, what = NEEDED.get(kind, (Callable, "a class or a function"))
        for name in by_name:
            if not isinstance(name, str) or not name.strip():
                raise PluginError(f"{gave} the name {name!r}; must be text")
            if kind == "run option" and not (name.startswith("--") and len(name) > 2):
                raise PluginError(f"{gave} the name {name!r}; must begin with --")
            if not isinstance(by_name, Imported) and not isinstance(by_name[name], right):
                raise PluginError(f"{gave} {by_name[name]!r} as '{name}'; must be {what}")
        yield plugin, by_name


def notify(hook: str, **arguments: Any) -> None:
    """Call a life-cycle hook of every plug-in that implements it; costs next to nothing when none does.

    Raises:
        PluginError: an implementation failed; later ones are not called.
        GoalMissed: an implementation says that the run has missed its goal.
    """
    if getattr(plugin_registry().hook, hook).get_hookimpls():
        for _ in answers(hook, **arguments):
            pass


def answers(hook: str, **arguments: Any) -> Iterator[tuple[str, Any]]:
    """Name and answer of each plug-in that implements a hook: called one by one, so that an error has a name."""
    for implementation in implementations(hook):
        yield implementation.plugin_name, ask(hook, implementation, **arguments)


def implementations(hook: str) -> list[HookImpl]:
    """The implementations of a hook in the order of loading, except where marked with tryfirst or trylast."""
    loaded = getattr(plugin_registry().hook, hook).get_hookimpls()
    return sorted(loaded, key=lambda implementation: (not implementation.tryfirst, implementation.trylast))


def ask(hook: str, implementation: HookImpl, **arguments: Any) -> Any:
    """The answer of one plug-in."""
    registry, name = plugin_registry(), implementation.plugin_name
    outcome = "failed"
    try:
        answer = implementation.function(*(arguments[argument] for argument in implementation.argnames))
        outcome = f"gave {SHORT.repr(answer)}" if registry.traced else ""
    except (GoalMissed, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise plugin_failure(f"plug-in {registry.described(name)} failed in {hook}()", error) from error
    finally:
        if registry.traced:
            shown = ", ".join(f"{argument}={SHORT.repr(value)}" for argument, value in arguments.items())
            print(f"taichisoft: {hook}({shown}) of plug-in '{name}' {outcome}", file=sys.stderr)
    return answer
