"""Scenes as TOML: reading with overrides, errors that point at the key, writing the resolved scene."""

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import tomli_w
from pydantic import BaseModel, ValidationError

from taichisoft.errors import SceneError
from taichisoft.scene import Scene
from taichisoft.shipped import find_file

# Keys that name a file, and the shipped folder in which it is looked for.
FILE_KEYS = {"mesh": "meshes", "surface": "meshes", "collision_surface": "meshes", "script": "scripts"}
FILE_SUFFIXES = (".msh", ".vtu", ".vtk", ".stl", ".obj", ".ply", ".toml")


def load_scene(name: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene by path or by the name of a shipped one; files that it names become absolute paths.

    `overrides` are "key.key=value" with TOML values, applied before anything is inherited or checked.

    Raises:
        SceneError: the file is missing or no TOML, or something in it is not valid.
    """
    path = find_file(name, "scenes", (".toml",), error=SceneError)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise SceneError(f"{path}: not readable as TOML: {error}") from error
    for override in overrides:
        _apply(document, override)
    return scene_from_dict(document, source=str(path), folder=path.parent)


def scene_from_dict(document: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Make a scene from plain tables, as TOML gives them; `source` begins every error.

    Raises:
        SceneError: something is not valid, with its key, value and what would be.
    """
    tables = {**document}
    if isinstance(tables.get("soft_bodies"), dict):
        tables["soft_bodies"] = _inherit(tables["soft_bodies"], source)
    try:
        return Scene.model_validate(_with_absolute_files(tables, folder or Path()))
    except ValidationError as error:
        raise SceneError(f"{source}: {_first_problem(error)}") from error


def scene_to_toml(scene: Scene) -> str:
    """The scene with every default and inherited value written out; `load_scene` reads it back equal."""
    return tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True))


def _apply(document: dict[str, Any], override: str) -> None:
    key, separator, text = override.partition("=")
    if not separator or not key.strip():
        raise SceneError(f"--set {override}: must look like contact.friction=0.3")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    *path, last = key.strip().split(".")
    table: Any = document
    try:
        for name in path:
            table = table[int(name)] if isinstance(table, list) else table.setdefault(name, {})
        table[int(last) if isinstance(table, list) else last] = value
    except (ValueError, IndexError, TypeError, AttributeError) as error:
        raise SceneError(f"--set {override}: the scene has no place called '{key.strip()}'") from error


def _inherit(bodies: dict[str, Any], source: str) -> dict[str, Any]:
    """Fill in what a soft body takes over from the one that its key `like` names."""
    resolved: dict[str, Any] = {}
    for name, table in bodies.items():
        if isinstance(table, dict) and "like" in table:
            if table["like"] not in resolved:
                raise SceneError(
                    f"{source}: soft_bodies.{name}.like = '{table['like']}': must be a soft body above it; "
                    f"there are: {', '.join(resolved) or 'none'}"
                )
            own = {key: value for key, value in table.items() if key != "like"}
            table = {**resolved[table["like"]], **own}
        resolved[name] = table
    return resolved


def _with_absolute_files(value: Any, folder: Path) -> Any:
    if isinstance(value, dict):
        return {
            key: str(find_file(item, FILE_KEYS[key], FILE_SUFFIXES, folder, SceneError))
            if key in FILE_KEYS and isinstance(item, str)
            else _with_absolute_files(item, folder)
            for key, item in value.items()
        }
    if isinstance(value, list):
        return [_with_absolute_files(item, folder) for item in value]
    return value


def _first_problem(error: ValidationError) -> str:
    """One line for the first problem, and how many more there are."""
    problem = error.errors()[0]
    key = ".".join(str(part) for part in problem["loc"])
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if problem["type"] == "extra_forbidden":
        *path, last = problem["loc"]
        valid = _valid_keys(Scene, path)
        near = difflib.get_close_matches(str(last), valid, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"valid keys: {', '.join(valid)}"
        return f"{key}: unknown key; {hint}{more}"
    if problem["type"] == "missing":
        return f"{key}: this key is missing{more}"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "value_error":  # a rule of ours between several keys: the message names the values
        return f"{key + ': ' if key else ''}{message}{more}"
    return f"{key} = {problem['input']!r}: {message[0].lower()}{message[1:]}{more}"


def _valid_keys(table: Any, path: Sequence[Any]) -> list[str]:
    """The keys of the table that `path` leads to, going through dictionaries, lists and optional tables."""
    for part in path:
        field = table.model_fields.get(part) if _is_table(table) else None
        table = _table_inside(field.annotation) if field is not None else table
    return sorted(table.model_fields) if _is_table(table) else []


def _table_inside(annotation: Any) -> Any:
    if _is_table(annotation):
        return annotation
    return next((found for inner in get_args(annotation) if (found := _table_inside(inner)) is not None), None)


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
