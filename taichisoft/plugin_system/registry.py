"""The registry of plug-ins: pluggy's, with origins and checks."""

import inspect
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import pluggy

from taichisoft.errors import PluginError, nearest
from taichisoft.plugin_system import hookspecs

DISABLE = "TAICHISOFT_DISABLE_PLUGINS"
TRACE = "TAICHISOFT_TRACE_PLUGINS"


@dataclass(frozen=True)
class Origin:
    """The source of a plug-in.

    Attributes:
        kind: an installed distribution, a file, or code that registered an object.
        place: module, path, or file and line of the code.
        version: version of the distribution, or the plug-in's `__version__`; or empty.
        distribution: name of the distribution; empty for other kinds.
    """

    kind: Literal["distribution", "file", "code"]
    place: str
    version: str = ""
    distribution: str = ""

    def __str__(self) -> str:
        if self.distribution:
            return f"{self.distribution} {self.version}: {self.place}"
        return f"registered in {self.place}" if self.kind == "code" else self.place


class Registry(pluggy.PluginManager):
    """All plug-ins of a process.

    Attributes:
        origins: source of each plug-in, by name, in the order of loading.
        blocked: names of plug-ins to leave out.
        left_out: names of blocked plug-ins that were found.
        traced: whether every call of a hook is printed.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ):
        super().__init__(hookspecs.PROJECT)
        self.add_hookspecs(hookspecs)
        self.origins: dict[str, Origin] = {}
        self.blocked = [name.strip() for name in environment.get(DISABLE, "").split(",") if name.strip()]
        self.left_out: set[str] = set()
        self._reported: set[str] = set()
        self.traced = environment.get(TRACE, "0") not in ("", "0")

    def add(self, name: str, origin: Origin, load: Callable[[], Any]) -> None:
        """Load a plug-in and register it, unless its name is blocked.

        Raises:
            PluginError: it cannot be loaded, its name is taken, or its hooks are not valid.
        """
        if name in self.blocked:
            self.left_out.add(name)
            return
        if name in self.origins:
            raise PluginError(
                f"two plug-ins are called '{name}': {self.origins[name]} and {origin}; rename one of them"
            )
        plugin = load()
        try:
            _check_hooks(self, plugin)
            if self.get_name(plugin) is not None:
                raise ValueError(f"it is registered as '{self.get_name(plugin)}' already")
            self.register(plugin, name)
        except (ValueError, pluggy.PluginValidationError) as error:
            problem = " ".join(str(error).split())
            raise PluginError(f"plug-in '{name}' ({origin}) cannot be registered: {problem}") from None
        version = origin.version or str(getattr(plugin, "__version__", ""))
        self.origins[name] = replace(origin, version=version)

    def remove(self, name: str) -> None:
        """Forget a plug-in; blocked ones are ignored.

        Raises:
            PluginError: no plug-in has that name.
        """
        if name in self.left_out:
            return
        if name not in self.origins:
            raise PluginError(f"no plug-in is called '{name}'; {nearest(name, list(self.origins), 'there are')}")
        self.unregister(name=name)
        del self.origins[name]

    def unknown_blocked(self) -> list[str]:
        """One line for every blocked name that no plug-in has; each name is reported once."""
        known = [*self.origins, *self.left_out]
        unknown = [name for name in self.blocked if name not in {*self.left_out, *self._reported}]
        self._reported.update(unknown)
        return [
            f"{DISABLE} names '{name}', which no plug-in is called; {nearest(name, known, 'there are')}"
            for name in unknown
        ]

    def described(self, name: str) -> str:
        """A plug-in's name and origin, as they stand in errors."""
        return f"'{name}' ({self.origins[name]})"


def hook_names() -> list[str]:
    """All hooks, in the order of their specification."""
    return [name for name in vars(hookspecs) if name.startswith(f"{hookspecs.PROJECT}_")]


def _check_hooks(registry: Registry, plugin: Any) -> None:
    """Raise ValueError for what pluggy would overlook or say at length."""
    if inspect.isclass(plugin):
        raise ValueError(f"{plugin.__name__} is a class; give an object of it")
    names = hook_names()
    implemented = False
    for attribute, function, options in _implementations(registry, plugin):
        implemented = True
        name = options.get("specname") or attribute
        if name not in names and options.get("optionalhook"):
            continue  # of another version of taichisoft, says its author
        if name not in names:
            raise ValueError(f"{name}() is not a hook; {nearest(name, names, 'there are')}")
        if options.get("wrapper") or options.get("hookwrapper"):
            raise ValueError(f"{name}() wraps the hooks of other plug-ins, which is not supported")
        known = list(inspect.signature(getattr(hookspecs, name)).parameters)
        for argument in inspect.signature(function).parameters.values():
            if argument.default is argument.empty and argument.name not in known:
                raise ValueError(
                    f"{name}() has no argument '{argument.name}'; {nearest(argument.name, known, 'there are')}"
                )
    for name in names:
        if inspect.isroutine(getattr(plugin, name, None)) and registry.parse_hookimpl_opts(plugin, name) is None:
            raise ValueError(f"{name}() is not marked with @hookimpl")
    if not implemented:
        raise ValueError(f"it implements no hook; there are: {', '.join(names)}")


def _implementations(registry: Registry, plugin: Any) -> Iterator[tuple[str, Callable[..., Any], Mapping[str, Any]]]:
    """Attribute, function and options of everything that is marked as a hook."""
    for attribute in dir(plugin):
        options = registry.parse_hookimpl_opts(plugin, attribute)
        if options is not None:
            yield attribute, getattr(plugin, attribute), options
