"""The plug-ins of this process: installed distributions first, then files, then objects of your code."""

import difflib
import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Literal

import pluggy

from taichisoft.base.files import from_home, is_file, is_folder
from taichisoft.errors import PluginError, PluginFailed, TaichisoftError, nearest
from taichisoft.running import hookspecs

# The registry of plug-ins: pluggy's, with origins and checks.

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
        """Load a plug-in and register it, unless its name is blocked."""
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
        """Forget a plug-in; blocked ones are ignored."""
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


# Errors of plug-ins: one line, and the plug-in's own traceback.

# Frames of these files lead to a plug-in, and are left out of its traceback.
OUTSIDE = (str(Path(__file__).parents[1]), str(Path(importlib.__file__).parent), "<frozen importlib")


def plugin_failure(what: str, error: BaseException) -> PluginError:
    """One line about an exception that a plug-in did not expect, with the place in it; to be raised from it."""
    if isinstance(error, TaichisoftError):
        return PluginError(f"{what}: {error}")
    message = " ".join(str(error).split())
    if isinstance(error, AttributeError) and "did you mean" not in message:
        near = difflib.get_close_matches(error.name or "", dir(error.obj), n=1)
        message += f"; did you mean '{near[0]}'?" if near else ""
    return PluginFailed(f"{what}: {type(error).__name__}{': ' if message else ''}{message}{_place(error)}")


@contextmanager
def failures_of(what: str) -> Iterator[None]:
    """Turn unexpected exceptions of a plug-in into a `PluginFailed` that begins with `what`.

    sys.exit() in a plug-in is one, too, so that a run ends with complete outputs; Ctrl and c passes, and so do
    warnings that the user makes errors.
    """
    try:
        yield
    except (TaichisoftError, KeyboardInterrupt, Warning):
        raise
    except BaseException as error:
        raise plugin_failure(what, error) from error


def plugin_traceback(error: TaichisoftError) -> str:
    """The traceback of an exception of a plug-in, from its entry on, or empty."""
    cause = error.__cause__
    if not isinstance(error, PluginError) or cause is None:
        return ""
    own = _own_part(cause)
    if own is None and not isinstance(cause, SyntaxError):
        return ""
    return "".join(traceback.format_exception(type(cause), cause, own))


def _place(error: BaseException) -> str:
    """The innermost line of the file in which the plug-in was entered: libraries that it calls are not to blame."""
    frames = traceback.extract_tb(_own_part(error))
    if not frames or isinstance(error, SyntaxError):  # which has the place in its message
        return ""
    own = [frame for frame in frames if frame.filename == frames[0].filename]
    return f" ({Path(own[-1].filename).name}, line {own[-1].lineno})"


def _own_part(error: BaseException) -> TracebackType | None:
    """The traceback without the frames that lead to the plug-in; or None.

    The first frame is that of the function which called the plug-in and caught the error, under `failures_of` if it did
    so through that.
    """
    entered = error.__traceback__
    if entered is not None and entered.tb_frame.f_code is failures_of.__wrapped__.__code__:  # type: ignore[attr-defined]
        entered = entered.tb_next
    entered = entered and entered.tb_next
    while entered is not None and entered.tb_frame.f_code.co_filename.startswith(OUTSIDE):
        entered = entered.tb_next
    return entered


PACKAGE_FILE = "__init__.py"

_loaded: Registry | None = None


def plugin_registry() -> Registry:
    """The plug-ins of this process; plug-ins of installed distributions are loaded at the first call.

    Raises:
        PluginError: a plug-in cannot be imported, two have one name, or one implements a hook that does not exist.
    """
    global _loaded
    if _loaded is None:
        registry = Registry()
        _add_installed(registry)
        _loaded = registry
    return _loaded


@contextmanager
def separate_registry() -> Iterator[Registry]:
    """A registry with the installed plug-ins alone, for as long as it lasts; for tests."""
    global _loaded
    before, _loaded = _loaded, None
    try:
        yield plugin_registry()
    finally:
        _loaded = before


def load_plugin(path: str | Path) -> None:
    """Load a file, or a package by its folder, as `--plugin` does; one that is loaded already stays.

    Args:
        path: Python file or folder; the plug-in is called like it, without the suffix.

    Raises:
        PluginError: the path is not a Python file, or cannot be imported or registered, or its name is taken.
    """
    path = from_home(path).resolve()
    code = path / PACKAGE_FILE if is_folder(path) else path
    if is_folder(path) and not is_file(code):
        raise PluginError(f"--plugin {path}: is a folder without {PACKAGE_FILE}; a file (.py) or a package is needed")
    if not is_file(code):
        raise PluginError(f"--plugin {path}: no such file")
    if code.suffix != ".py":
        raise PluginError(f"--plugin {path}: '{code.suffix}' is not Python; a file (.py) is needed")
    registry, origin = plugin_registry(), Origin("file", str(path))
    if all((known.kind, known.place) != (origin.kind, origin.place) for known in registry.origins.values()):
        registry.add(path.stem, origin, _loading(path.stem, origin, lambda: _import_file(path.stem, code)))


def register_plugin(plugin: Any, name: str | None = None) -> str:
    """Make a plug-in of a module, or of an object whose methods are marked with `hookimpl`.

    Args:
        plugin: anything with hooks.
        name: name under which it is listed; that of its module or class when it is not given.

    Returns:
        Its name, for `unregister_plugin`.

    Raises:
        PluginError: its hooks are not valid, or its name is taken.
    """
    caller = sys._getframe(1)
    chosen: str = name or getattr(plugin, "__name__", None) or type(plugin).__name__
    origin = Origin("code", f"{caller.f_code.co_filename}, line {caller.f_lineno}")
    plugin_registry().add(chosen, origin, lambda: plugin)
    return chosen


def unregister_plugin(name: str) -> None:
    """Forget a plug-in, so that another one may take its name.

    Args:
        name: what `register_plugin` returned, or the name of a file.

    Raises:
        PluginError: no plug-in has that name.
    """
    plugin_registry().remove(name)


def _add_installed(registry: Registry) -> None:
    """Add what installed distributions announce in the entry-point group `taichisoft`, the built-in ones first."""
    for entry_point in sorted(entry_points(group=hookspecs.PROJECT), key=_builtin_first):
        distribution = entry_point.dist
        made_by = {"distribution": distribution.name, "version": distribution.version} if distribution else {}
        origin = Origin("distribution", entry_point.value, **made_by)
        registry.add(entry_point.name, origin, _loading(entry_point.name, origin, entry_point.load))


def _builtin_first(entry_point: EntryPoint) -> tuple[bool, str]:
    distribution = entry_point.dist
    return distribution is None or distribution.name != hookspecs.PROJECT, entry_point.name


def _import_file(name: str, path: Path) -> ModuleType:
    """Import a file as a module that hides none of another name."""
    module_name = f"taichisoft_plugin_{name.replace('.', '_')}"
    package = [str(path.parent)] if path.name == PACKAGE_FILE else None
    spec = importlib.util.spec_from_file_location(module_name, path, submodule_search_locations=package)
    assert spec is not None and spec.loader is not None  # the suffix has been checked
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # where dataclasses, pickle and relative imports look for it
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


def _loading(name: str, origin: Origin, load: Callable[[], Any]) -> Callable[[], Any]:
    """`load`, whose failures name the plug-in, and how to leave it out."""

    def loaded() -> Any:
        try:
            return load()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            failure = plugin_failure(f"plug-in '{name}' ({origin}) cannot be imported", error)
            hint = f"; {DISABLE}={name} leaves it out" if origin.kind == "distribution" else ""
            raise type(failure)(f"{failure}{hint}") from error

    return loaded
