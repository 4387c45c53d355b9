"""Scenes in the formats that plug-ins read; TOML is the engine's own."""

import copy
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.errors import PluginError, SceneError
from taichisoft.plugin_system import hooks
from taichisoft.plugin_system.failure import failures_of
from taichisoft.scenes.file import choose_controller, scene_from_dict
from taichisoft.scenes.overrides import apply_override
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.shipped import find_file

TOML = ".toml"


def load_scene(name: str | Path, overrides: Sequence[str] = (), controller: str | None = None) -> Scene:
    """Read a scene by path or by the name of a shipped one; files that it names become absolute paths.

    It is TOML unless a plug-in reads files of its suffix.

    Args:
        name: path or name.
        overrides: "key.key=value" with TOML values, applied before anything is inherited or checked.
        controller: name of a controller to take instead of the scene's own, whose settings are then dropped.

    Raises:
        SceneError: the file is missing or cannot be read, or something in it is not valid.
        PluginError: the plug-in that reads its format failed.
    """
    path = find_scene(name)
    document = read_with_plugin(path)
    if document is None:
        document = _read_toml(path)
    if controller is not None:
        choose_controller(document, controller)
    for override in overrides:
        apply_override(document, override)
    source = " with --set ".join([str(path), *overrides])  # the error may be in either
    return scene_from_dict(document, source, folder=path.parent)


def find_scene(name: str | Path) -> Path:
    """A scene by path or by the name of a shipped one, in any format that can be read.

    Raises:
        SceneError: nothing is there.
        PluginError: a plug-in's readers are not valid.
    """
    try:
        return find_file(name, "scenes", (TOML,), error=SceneError)
    except SceneError:
        suffixes = list(scene_readers())  # asked for only now: a TOML file needs no plug-in
        if not suffixes:
            raise
        return find_file(name, "scenes", (TOML, *suffixes), error=SceneError)


def read_with_plugin(path: Path) -> dict[str, Any] | None:
    """The tables of a scene; None when no plug-in reads files of its suffix, so that it must be TOML.

    Raises:
        SceneError: the file cannot be read, says its reader.
        PluginError: the reader failed, or gave something else than tables.
    """
    suffix = path.suffix.lower()
    reader = scene_readers().get(suffix) if suffix != TOML else None
    if reader is None:
        return None
    with failures_of(f"{path}: scene reader '{suffix}' failed"):
        tables = reader(path)
    if not isinstance(tables, Mapping):
        raise PluginError(f"{path}: scene reader '{suffix}' gave {tables!r}; must be a mapping of tables")
    return copy.deepcopy(dict(tables))  # overrides change them


def scene_readers() -> dict[str, Any]:
    """What reads scenes, by suffix.

    Raises:
        PluginError: one is not valid, or two have the same suffix.
    """
    readers = hooks.provided("scene reader")
    for suffix in readers:
        if suffix == TOML or suffix != f".{suffix.strip('.').lower()}":
            problem = "TOML is read without a plug-in" if suffix == TOML else "must look like '.yaml', in small letters"
            raise PluginError(f"scene reader '{suffix}': {problem}")
    return readers


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise SceneError(f"{path}: not readable as TOML: {error}") from error
