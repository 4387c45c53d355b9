"""Scenes in the formats that plug-ins read; TOML is the engine's own."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichisoft import plugins
from taichisoft.errors import PluginError, SceneError
from taichisoft.plugin_system.failure import failures_of
from taichisoft.scenes.shipped import find_file

TOML = ".toml"


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
    readers = plugins.provided("scene reader")
    for suffix in readers:
        if suffix == TOML or suffix != f".{suffix.strip('.').lower()}":
            problem = "TOML is read without a plug-in" if suffix == TOML else "must look like '.yaml', in small letters"
            raise PluginError(f"scene reader '{suffix}': {problem}")
    return readers
