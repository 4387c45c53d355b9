"""Scenes from tables and as TOML: files found, inheritance, errors that point at the key, the resolved scene."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from taichisoft.errors import SceneError
from taichisoft.meshes.files import VOLUME_SUFFIXES
from taichisoft.meshes.surface_files import SURFACE_SUFFIXES
from taichisoft.scenes.overrides import change_scene
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.shipped import find_file
from taichisoft.scenes.validation_errors import first_problem

GEOMETRY_SUFFIX = ".toml"
# Keys that name a file, the shipped folder in which it is looked for, and the suffixes that it may go without.
FILE_KEYS = {
    "surface": ("meshes", SURFACE_SUFFIXES),
    "collision_surface": ("meshes", SURFACE_SUFFIXES),
    "script": ("scripts", (".toml", ".csv")),
}


def scene_from_dict(document: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Make a scene from plain tables, as TOML gives them.

    Args:
        document: tables of the scene by key; files that it names become absolute paths.
        source: text that begins every error.
        folder: folder in which the files are looked for first; the current one when it is not given.

    Raises:
        SceneError: something is not valid, with its key, value and what would be.
    """
    tables = {**document}
    if isinstance(tables.get("soft_bodies"), dict):
        tables["soft_bodies"] = _inherit(tables["soft_bodies"], source)
    return _validated(_with_absolute_files(tables, folder or Path(), source), source)


def scene_from_toml(text: str, source: str, overrides: Sequence[str] = (), controller: str | None = None) -> Scene:
    """Read what `scene_to_toml` wrote, with changes as in `load_scene`; files that it names need no longer exist.

    Raises:
        SceneError: something is not valid; begins with `source`.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{source}: not readable as TOML: {error}") from error
    change_scene(document, overrides, controller)
    return _validated(document, source)


def scene_to_toml(scene: Scene) -> str:
    """The scene with every default and inherited value written out; `load_scene` reads it back equal."""
    return tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True))


def _validated(document: Any, source: str) -> Scene:
    try:
        return Scene.model_validate(document)
    except ValidationError as error:
        raise SceneError(f"{source}: {first_problem(error, Scene)}") from error


def _inherit(bodies: dict[str, Any], source: str) -> dict[str, Any]:
    """Fill in what a soft body takes over from the one that its key `like` names."""
    resolved: dict[str, Any] = {}
    for name, table in bodies.items():
        if isinstance(table, dict) and "like" in table:
            # Compared as text, since TOML may give a list or a table.
            if str(table["like"]) not in resolved:
                raise SceneError(
                    f"{source}: soft_bodies.{name}.like = '{table['like']}': must be a soft body above it; "
                    f"there are: {', '.join(resolved) or 'none'}"
                )
            own = {key: value for key, value in table.items() if key != "like"}
            table = {**resolved[str(table["like"])], **own}
        resolved[name] = table
    return resolved


def _with_absolute_files(value: Any, folder: Path, source: str, key: str = "") -> Any:
    """The tables with every file found; `source` and `key`, the place of `value`, begin the error."""
    if isinstance(value, dict):
        return {name: _with_absolute_file(name, item, folder, source, f"{key}{name}") for name, item in value.items()}
    if isinstance(value, list):
        return [_with_absolute_files(item, folder, source, f"{key}{index}.") for index, item in enumerate(value)]
    return value


def _with_absolute_file(name: str, value: Any, folder: Path, source: str, key: str) -> Any:
    """The value of one key, which may name a file."""
    if name in FILE_KEYS and isinstance(value, str):
        return _absolute_file(value, *FILE_KEYS[name], folder, f"{source}: {key}")
    if name == "mesh" and isinstance(value, str):
        return _absolute_mesh(value, folder, f"{source}: {key}")
    if name == "mesh" and isinstance(value, dict) and isinstance(value.get("file"), str):
        return {**value, "file": _absolute_mesh(value["file"], folder, f"{source}: {key}.file")}
    return _with_absolute_files(value, folder, source, f"{key}.")


def _absolute_mesh(name: str, folder: Path, key: str) -> str:
    """A mesh, or by its suffix a geometry."""
    is_geometry = name.lower().endswith(GEOMETRY_SUFFIX)
    kind, suffixes = ("fingers", (GEOMETRY_SUFFIX,)) if is_geometry else ("meshes", VOLUME_SUFFIXES)
    return _absolute_file(name, kind, suffixes, folder, key)


def _absolute_file(name: str, kind: str, suffixes: tuple[str, ...], folder: Path, key: str) -> str:
    try:
        return str(find_file(name, kind, suffixes, folder, SceneError))
    except SceneError as error:
        raise SceneError(f"{key}: {error}") from error
