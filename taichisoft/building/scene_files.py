"""Scenes in the formats that plug-ins read; TOML is the engine's own."""

import copy
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.building.named_materials import fill_in_materials
from taichisoft.building.scene_additions import add_what_controllers_bring
from taichisoft.errors import PluginError, SceneError, nearest
from taichisoft.input_file import read_toml
from taichisoft.plugin_system.failure import failures_of
from taichisoft.plugin_system.hooks import provided
from taichisoft.scenes import file as scene_tables
from taichisoft.scenes.overrides import change_scene
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.shipped import find_file

TOML = ".toml"


def load_scene(
    name: str | Path,
    overrides: Sequence[str] = (),
    controller: str | None = None,
    reader_settings: Mapping[str, Any] | None = None,
    goal: str | None = None,
) -> Scene:
    """Read a scene by path or by the name of a shipped scene; relative file names in it become absolute paths.

    The file is TOML unless a plug-in reads files with its suffix.

    Args:
        name: path or name.
        overrides: "key.key=value" with TOML values, applied before inheritance and validation.
        controller: name of a controller that replaces the scene's own and its settings.
        reader_settings: arguments of the plug-in's reader of this format, by name.
        goal: kind of goal that replaces the scene's own, or "none".

    Raises:
        SceneError: the file is missing or cannot be read, or the scene or a setting is not valid.
        PluginError: the plug-in that reads the format failed.
    """
    if isinstance(overrides, str) or not isinstance(overrides, Sequence):
        raise SceneError(f'overrides = {overrides!r}: must be a list of texts, such as ["contact.friction=0.3"]')
    path = _find_scene(name)
    document = _read_tables(path, reader_settings or {})
    change_scene(document, overrides, controller, goal)
    fill_in_materials(document)
    source = " with --set ".join([str(path), *overrides])  # the error may be in the file or in an override
    add_what_controllers_bring(document, source, path.parent)
    return scene_tables.scene_from_dict(document, source, folder=path.parent)


def scene_from_dict(document: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Make a scene from plain tables, as parsed from TOML; it may name materials of plug-ins, as in `load_scene`.

    Args:
        document: tables of the scene by key; relative file names in it become absolute paths.
        source: name of the document, with which every error message begins.
        folder: folder in which files are searched first; None: the current folder.

    Raises:
        SceneError: a value is not valid; the message has the key, the value and the valid values.
        PluginError: two plug-ins provide the same material, or a material is not valid.
    """
    tables = copy.deepcopy(dict(document))  # the caller's document is not changed
    fill_in_materials(tables)
    add_what_controllers_bring(tables, source, folder or Path())
    return scene_tables.scene_from_dict(tables, source, folder)


def _find_scene(name: str | Path) -> Path:
    try:
        return find_file(name, "scenes", (TOML,), error=SceneError)
    except SceneError:
        suffixes = list(_scene_readers())  # loaded only now: a TOML file needs no plug-in
        if not suffixes:
            raise
        return find_file(name, "scenes", (TOML, *suffixes), error=SceneError)


def _read_tables(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Read the tables of a scene by a plug-in for the file's suffix, or else as TOML."""
    suffix = path.suffix.lower()
    reader = _scene_readers().get(suffix) if suffix != TOML else None
    _check_settings(path, reader, settings)
    if reader is None:
        try:
            return read_toml(path)
        except (ValueError, OSError) as error:
            raise SceneError(f"{path}: not readable as TOML: {error}") from error
    with failures_of(f"{path}: scene reader '{suffix}' failed"):
        tables = reader(path, **settings)
    if not isinstance(tables, Mapping):
        raise PluginError(f"{path}: scene reader '{suffix}' returned {tables!r}; must be a mapping of tables")
    return copy.deepcopy(dict(tables))  # overrides change the tables


def _check_settings(path: Path, reader: Callable[..., Any] | None, settings: Mapping[str, Any]) -> None:
    """Refuse settings that the reader does not have; TOML has none."""
    valid = list(inspect.signature(reader).parameters)[1:] if reader is not None else []
    for name in settings:
        if name not in valid:
            raise SceneError(
                f"{path}: {name} has no effect on a {path.suffix} scene; {nearest(name, valid, 'settings')}"
            )


def _scene_readers() -> Mapping[str, Any]:
    """Readers of scenes by suffix."""
    readers = provided("scene reader")
    for suffix in readers:
        if suffix == TOML or suffix != f".{suffix.strip('.').lower()}":
            problem = "TOML is read without a plug-in" if suffix == TOML else "must look like '.yaml', in small letters"
            raise PluginError(f"scene reader '{suffix}': {problem}")
    return readers
