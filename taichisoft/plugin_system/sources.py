"""Where plug-ins come from: installed distributions first, then files and folders, then objects registered in code."""

import importlib.util
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from taichisoft.errors import PluginError
from taichisoft.plugin_system import hookspecs
from taichisoft.plugin_system.failure import plugin_failure
from taichisoft.plugin_system.registry import DISABLE, Origin, Registry

PACKAGE_FILE = "__init__.py"


def add_installed(registry: Registry) -> None:
    """Add what installed distributions announce in the entry-point group `taichisoft`, the built-in ones first.

    Raises:
        PluginError: one cannot be imported or registered, or two have one name.
    """
    for entry_point in sorted(entry_points(group=hookspecs.PROJECT), key=_builtin_first):
        distribution = entry_point.dist
        made_by = {"distribution": distribution.name, "version": distribution.version} if distribution else {}
        origin = Origin("distribution", entry_point.value, **made_by)
        registry.add(entry_point.name, origin, _loading(entry_point.name, origin, entry_point.load))


def add_file(registry: Registry, path: Path) -> None:
    """Add a file, or a folder that is a package, as a plug-in called like it; one that is there already stays.

    Raises:
        PluginError: it is no Python file, cannot be imported or registered, or its name is taken.
    """
    path = path.expanduser().resolve()
    code = path / PACKAGE_FILE if path.is_dir() else path
    if path.is_dir() and not code.is_file():
        raise PluginError(
            f"--plugin {path}: is a folder; a file (.py) is needed, or --plugins-dir for all in the folder"
        )
    if not code.is_file():
        raise PluginError(f"--plugin {path}: no such file")
    if code.suffix != ".py":
        raise PluginError(f"--plugin {path}: '{code.suffix}' is not Python; a file (.py) is needed")
    origin = Origin("file", str(path))
    if all((known.kind, known.place) != (origin.kind, origin.place) for known in registry.origins.values()):
        registry.add(path.stem, origin, _loading(path.stem, origin, lambda: _import_file(path.stem, code)))


def add_folder(registry: Registry, folder: Path) -> None:
    """Add every file and package of a folder, in the order of their names, but none whose name begins with "_" or ".".

    Raises:
        PluginError: there is no such folder, nothing is in it, or something in it is not valid.
    """
    if not folder.expanduser().is_dir():
        raise PluginError(f"--plugins-dir {folder}: {'is a file' if folder.is_file() else 'no such folder'}")
    found = [path for path in sorted(folder.expanduser().iterdir()) if path.name[0] not in "_." and _is_code(path)]
    if not found:
        raise PluginError(f"--plugins-dir {folder}: has no plug-in in it; a plug-in is a file (.py) or a package")
    for path in found:
        add_file(registry, path)


def add_object(registry: Registry, plugin: Any, name: str | None, place: str) -> str:
    """Add a module or an object with hooks; its name, which is that of its module or class unless it is given.

    Raises:
        PluginError: its hooks are not valid, or its name is taken.
    """
    chosen = name or getattr(plugin, "__name__", None) or type(plugin).__name__
    registry.add(chosen, Origin("code", place), lambda: plugin)
    return chosen


def _builtin_first(entry_point: EntryPoint) -> tuple[bool, str]:
    distribution = entry_point.dist
    return distribution is None or distribution.name != hookspecs.PROJECT, entry_point.name


def _is_code(path: Path) -> bool:
    return (path / PACKAGE_FILE).is_file() if path.is_dir() else path.suffix == ".py"


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
    """`load`, whose failures have the plug-in's name, and a way out."""

    def loaded() -> Any:
        try:
            return load()
        except (Exception, SystemExit) as error:
            failure = plugin_failure(f"plug-in '{name}' ({origin}) cannot be imported", error)
            hint = f"; {DISABLE}={name} leaves it out" if origin.kind == "distribution" else ""
            raise PluginError(f"{failure}{hint}") from error

    return loaded
