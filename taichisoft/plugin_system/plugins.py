"""Plug-ins: loading them, calling their hooks, and finding what they provide by name."""

import reprlib
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pluggy import HookImpl

from taichisoft.errors import GoalMissed, PluginError
from taichisoft.plugin_system import sources as plugin_sources
from taichisoft.plugin_system.failure import plugin_failure as plugin_failure  # for those who call plug-ins
from taichisoft.plugin_system.registry import Registry

SHORT = reprlib.Repr()  # of arguments and answers in a trace
SHORT.maxother = SHORT.maxstring = 80

KINDS = {
    "controller": "taichisoft_controllers",
    "output": "taichisoft_outputs",
    "geometry kind": "taichisoft_geometry_kinds",
    "mesh maker": "taichisoft_mesh_makers",
    "scene reader": "taichisoft_scene_readers",
}
"""What a plug-in can provide by name, and the hook that it does so through."""


_loaded: Registry | None = None


def plugin_registry() -> Registry:
    """The plug-ins of this process; those of installed distributions are loaded at the first call.

    Raises:
        PluginError: a plug-in cannot be imported, two have one name, or one implements a hook that does not exist.
    """
    global _loaded
    if _loaded is None:
        registry = Registry()
        plugin_sources.add_installed(registry)
        registry.check_pending()
        _loaded = registry
    return _loaded


@contextmanager
def separate_registry() -> Iterator[Registry]:
    """A registry with the installed plug-ins alone, for as long as it lasts; for tests.

    Raises:
        PluginError: as `plugin_registry`.
    """
    global _loaded
    before, _loaded = _loaded, None
    try:
        yield plugin_registry()
    finally:
        _loaded = before


def load_plugin(path: str | Path) -> None:
    """Load a file, or a package by its folder, as a plug-in called like it, as `--plugin` does.

    Raises:
        PluginError: it is no Python file, cannot be imported or registered, or its name is taken.
    """
    plugin_sources.add_file(plugin_registry(), Path(path))


def load_plugins_folder(folder: str | Path) -> None:
    """Load every file and package of a folder as a plug-in, as `--plugins-dir` does.

    Raises:
        PluginError: there is no such folder, nothing is in it, or something in it is not valid.
    """
    plugin_sources.add_folder(plugin_registry(), Path(folder))


def register_plugin(plugin: Any, name: str | None = None) -> str:
    """Make a plug-in of a module, or of an object whose methods are marked with `hookimpl`.

    Args:
        plugin: anything with hooks.
        name: under which it is listed; that of its module or class when it is not given.

    Returns:
        Its name, for `unregister_plugin`.

    Raises:
        PluginError: its hooks are not valid, or its name is taken.
    """
    caller = sys._getframe(1)
    place = f"{caller.f_code.co_filename}, line {caller.f_lineno}"
    return plugin_sources.add_object(plugin_registry(), plugin, name, place)


def unregister_plugin(name: str) -> None:
    """Forget a plug-in, so that another one may take its name.

    Raises:
        PluginError: there is none of that name.
    """
    plugin_registry().remove(name)


def find(kind: str, name: str) -> Callable[..., Any]:
    """What a plug-in provides under `name`; `kind` is one of `KINDS`.

    Raises:
        PluginError: nothing or more than one thing has that name.
    """
    found = provided(kind)
    for line in plugin_registry().unknown_blocked():
        warnings.warn(line, stacklevel=2)
    if name not in found:
        raise PluginError(f"no {kind} is called '{name}'; there are: {', '.join(sorted(found)) or 'none'}")
    return found[name]


def provided(kind: str) -> dict[str, Callable[..., Any]]:
    """All that plug-ins provide of a kind, by name.

    Raises:
        PluginError: two plug-ins claim one name, or one gave something that is not valid.
    """
    registry = plugin_registry()
    found: dict[str, tuple[str, Callable[..., Any]]] = {}
    for plugin, by_name in provided_by_plugin(kind):
        for key, factory in by_name.items():
            if key in found:
                both = f"{registry.described(found[key][0])} and {registry.described(plugin)}"
                raise PluginError(f"two plug-ins, {both}, both provide the {kind} '{key}'")
            found[key] = (plugin, factory)
    return {key: factory for key, (_, factory) in found.items()}


def provided_by_plugin(kind: str) -> Iterator[tuple[str, Mapping[str, Callable[..., Any]]]]:
    """Name of each plug-in that provides something of a kind, and what it provides by name.

    Raises:
        PluginError: one gave something that is not valid.
    """
    hook = KINDS[kind]
    for plugin, by_name in answers(hook):
        gave = f"plug-in {plugin_registry().described(plugin)}: {hook}() gave"
        if not isinstance(by_name, Mapping):
            raise PluginError(f"{gave} {by_name!r}; must be a mapping by name")
        for key, factory in by_name.items():
            if not isinstance(key, str) or not key.strip():
                raise PluginError(f"{gave} the name {key!r}; must be text")
            if not callable(factory):
                raise PluginError(f"{gave} {factory!r} as '{key}'; must be a class or a function")
        yield plugin, by_name


def notify(hook: str, **arguments: Any) -> None:
    """Call a life-cycle hook of every plug-in that implements it; costs next to nothing when none does.

    Raises:
        PluginError: an implementation failed; those after it are not called.
        GoalMissed: an implementation says that the run has missed its goal.
    """
    if getattr(plugin_registry().hook, hook).get_hookimpls():
        for _ in answers(hook, **arguments):
            pass


def answers(hook: str, **arguments: Any) -> Iterator[tuple[str, Any]]:
    """Name and answer of each plug-in that implements a hook: called one by one, so that an error has a name.

    Raises:
        PluginError: an implementation failed; those after it are not called.
        GoalMissed: an implementation says that the run has missed its goal.
    """
    for implementation in implementations(hook):
        yield implementation.plugin_name, ask(hook, implementation, **arguments)


def implementations(hook: str) -> list[HookImpl]:
    """The implementations of a hook in the order of loading, but for those marked with tryfirst or trylast."""
    found = getattr(plugin_registry().hook, hook).get_hookimpls()
    return sorted(found, key=lambda one: (not one.tryfirst, one.trylast))


def ask(hook: str, implementation: HookImpl, **arguments: Any) -> Any:
    """The answer of one plug-in.

    Raises:
        PluginError: it failed.
        GoalMissed: it says that the run has missed its goal.
    """
    registry, name = plugin_registry(), implementation.plugin_name
    outcome = "failed"
    try:
        answer = implementation.function(*(arguments[argument] for argument in implementation.argnames))
        outcome = f"gave {SHORT.repr(answer)}" if registry.traced else ""
    except GoalMissed:
        raise
    except Exception as error:
        raise plugin_failure(f"plug-in {registry.described(name)} failed in {hook}()", error) from error
    finally:
        if registry.traced:
            shown = ", ".join(f"{argument}={SHORT.repr(value)}" for argument, value in arguments.items())
            print(f"taichisoft: {hook}({shown}) of plug-in '{name}' {outcome}", file=sys.stderr)
    return answer
