"""The plug-ins of this process: installed distributions first, then files and folders, then objects of your code."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft.errors import PluginError
from taichisoft.input_file import from_home, is_file, is_folder
from taichisoft.plugin_system import hookspecs
from taichisoft.plugin_system.failure import plugin_failure
from taichisoft.plugin_system.registry import DISABLE, Origin, Registry

PACKAGE_FILE = "__init__.py"
TESTS = ("test_*.py", "*_test.py", "conftest.py")

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
    """Load a file, or a package by its folder, as `--plugin` does; one that is loaded already stays.

    Args:
        path: Python file or folder; the plug-in is called like it, without the suffix.

    Raises:
        PluginError: the path is not a Python file, or cannot be imported or registered, or its name is taken.
    """
    path = from_home(path).resolve()
    code = path / PACKAGE_FILE if is_folder(path) else path
    if is_folder(path) and not is_file(code):
        raise PluginError(
            f"--plugin {path}: is a folder; a file (.py) is needed, or --plugins-dir for all in the folder"
        )
    if not is_file(code):
        raise PluginError(f"--plugin {path}: no such file")
    if code.suffix != ".py":
        raise PluginError(f"--plugin {path}: '{code.suffix}' is not Python; a file (.py) is needed")
    registry, origin = plugin_registry(), Origin("file", str(path))
    if all((known.kind, known.place) != (origin.kind, origin.place) for known in registry.origins.values()):
        registry.add(path.stem, origin, _loading(path.stem, origin, lambda: _import_file(path.stem, code)))


def load_plugins_folder(folder: str | Path) -> None:
    """Load every file and package of a folder as a plug-in, as `--plugins-dir` does.

    Args:
        folder: loaded in the order of names, without those that begin with "_" or ".", tests, and files without hooks.

    Raises:
        PluginError: the folder is missing or empty, or a plug-in in it is not valid.
    """
    place = from_home(folder)
    if not is_folder(place):
        raise PluginError(f"--plugins-dir {folder}: {'is a file' if is_file(place) else 'no such folder'}")
    found = [path for path in sorted(place.iterdir()) if path.name[0] not in "_." and _is_code(path)]
    found = [path for path in found if _has_hooks(path)]
    if not found:
        raise PluginError(f"--plugins-dir {folder}: has no plug-in in it; a plug-in is a file (.py) or a package")
    for path in found:
        load_plugin(path)


def plugin_files() -> dict[str, Path]:
    """File or folder of each plug-in that `load_plugin` loaded, by its name."""
    return {name: Path(one.place) for name, one in plugin_registry().origins.items() if one.kind == "file"}


def reload_plugin(name: str) -> None:
    """Load a plug-in from its file again; the one that is loaded stays if that fails.

    Raises:
        PluginError: the file cannot be imported, or its hooks are not valid.
    """
    registry = plugin_registry()
    path, old = plugin_files()[name], registry.get_plugin(name)
    module_name = _module_name(name)
    modules = {one: sys.modules[one] for one in list(sys.modules) if f"{one}.".startswith(f"{module_name}.")}
    for one in modules:
        del sys.modules[one]
    for code in path.rglob("*.py") if path.is_dir() else [path]:
        # Byte code counts as that of a file of the same second and size.
        Path(importlib.util.cache_from_source(str(code))).unlink(missing_ok=True)
    importlib.invalidate_caches()
    origin = registry.origins[name]
    registry.remove(name)
    try:
        load_plugin(path)
    except PluginError:
        sys.modules.update(modules)
        registry.add(name, origin, lambda: old)
        raise


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


def _is_code(path: Path) -> bool:
    return (path / PACKAGE_FILE).is_file() if path.is_dir() else path.suffix == ".py"


def _has_hooks(path: Path) -> bool:
    """Whether a file or package marks a hook, as far as its text says: what else lies in a folder is not run."""
    if any(path.match(pattern) for pattern in TESTS):
        return False
    files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return any(b"hookimpl" in file.read_bytes() for file in files)


def _module_name(name: str) -> str:
    return f"taichisoft_plugin_{name.replace('.', '_')}"


def _import_file(name: str, path: Path) -> ModuleType:
    """Import a file as a module that hides none of another name."""
    module_name = _module_name(name)
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
    """`load`, whose failures have the plug-in's name, and a way out."""

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
