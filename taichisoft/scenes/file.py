"""Scenes from tables and as TOML: files found, inheritance, errors that point at the key, the resolved scene."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from taichisoft.errors import SceneError
from taichisoft.input_file import parse_toml
from taichisoft.meshes.files import VOLUME_SUFFIXES
from taichisoft.meshes.point_files import POINT_SUFFIXES
from taichisoft.meshes.surface_files import SURFACE_SUFFIXES
from taichisoft.scenes.overrides import change_scene
from taichisoft.scenes.pattern import KEY as PATTERN
from taichisoft.scenes.pattern import PLACES, with_patterns
from taichisoft.scenes.scene import Scene
from taichisoft.scenes.shipped import find_file
from taichisoft.scenes.validation_errors import first_problem

GEOMETRY_SUFFIX = ".toml"
GEOMETRIES = ("fingers", (GEOMETRY_SUFFIX,))
# Keys that name a file, the shipped folder in which it is looked for, and the suffixes that it may go without.
FILE_KEYS = {
    "mesh": ("meshes", VOLUME_SUFFIXES),
    "surface": ("meshes", SURFACE_SUFFIXES),
    "collision_surface": ("meshes", SURFACE_SUFFIXES),
    "points": ("meshes", POINT_SUFFIXES),
    "script": ("scripts", (".toml", ".csv")),
    "urdf": ("arms", (".urdf",)),
    "material": ("materials", (".toml",)),
    "reduced": ("reduced", (".npz",)),
}
# Keys whose value may also be a table with the key `file`, or a list of such tables.
FILE_TABLES = ("mesh", "collision_surface")


def scene_from_dict(document: Mapping[str, Any], source: str = "scene", folder: Path | None = None) -> Scene:
    """Make a scene from plain tables, as TOML gives them; of materials by name it knows those in files alone.

    Args:
        document: tables of the scene by key; files that it names become absolute paths.
        source: name of the document, which begins every error.
        folder: folder in which the files are looked for first; the current one when it is not given.

    Raises:
        SceneError: something is not valid, with its key, value and what would be.
    """
    tables = {**document}
    if isinstance(tables.get("soft_bodies"), dict):
        tables["soft_bodies"] = _inherit(tables["soft_bodies"], source)
    for key in PLACES:
        if isinstance(tables.get(key), dict):
            tables[key] = with_patterns(tables[key], key, source)
    found = {key: _with_files(value, folder or Path(), f"{source}: {key}", key) for key, value in tables.items()}
    return _validated(found, source)


def scene_from_toml(
    text: str, source: str, overrides: Sequence[str] = (), controller: str | None = None, goal: str | None = None
) -> Scene:
    """Read what `scene_to_toml` wrote, with changes as in `load_scene`; files that it names need no longer exist.

    Raises:
        SceneError: something is not valid; begins with `source`.
    """
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise SceneError(f"{source}: not readable as TOML: {error}") from error
    change_scene(document, overrides, controller, goal)
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
    """Fill in the keys that a soft body takes over from the one that its key `like` names."""
    resolved: dict[str, Any] = {}
    for name, table in bodies.items():
        if isinstance(table, dict) and "like" in table:
            # Compared as text, since TOML may give a list or a table.
            if str(table["like"]) not in resolved:
                raise SceneError(
                    f"{source}: soft_bodies.{name}.like = '{table['like']}': must be a soft body above it; "
                    f"there are: {', '.join(resolved) or 'none'}"
                )
            if not isinstance(resolved[str(table["like"])], dict):
                other = f"soft_bodies.{table['like']}"
                raise SceneError(f"{source}: soft_bodies.{name}.like = '{table['like']}': {other} must be a table")
            own = {key: value for key, value in table.items() if key != "like"}
            inherited = {key: value for key, value in resolved[str(table["like"])].items() if key != PATTERN}
            table = {**_without_material(inherited, own), **own}
        resolved[name] = table
    return resolved


def _without_material(inherited: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """What a body inherits beside a material, or a Young's modulus, of its own: these replace the other's material."""
    if "material" in own:
        left_out: tuple[str, ...] = ("material", "young_modulus", "poisson_ratio", "density")
    else:
        left_out = ("material",) if "young_modulus" in own else ()
    return {key: value for key, value in inherited.items() if key not in left_out}


def _with_files(value: Any, folder: Path, where: str, name: str = "") -> Any:
    """The value of the key `name`, in which every file is found; `where`, the place of the value, begins the error."""
    if name in FILE_TABLES and isinstance(value, dict):
        file = _with_files(value.get("file"), folder, f"{where}.file", name)
        return {**value, "file": file} if "file" in value else value
    if isinstance(value, dict):
        return {key: _with_files(item, folder, f"{where}.{key}", key) for key, item in value.items()}
    if isinstance(value, list):
        inner = name if name in FILE_TABLES else ""
        return [_with_files(item, folder, f"{where}.{index}", inner) for index, item in enumerate(value)]
    if name not in FILE_KEYS or not isinstance(value, str):
        return value
    is_geometry = name == "mesh" and value.lower().endswith(GEOMETRY_SUFFIX)
    kind, suffixes = GEOMETRIES if is_geometry else FILE_KEYS[name]
    try:
        also = (GEOMETRIES,) if name == "mesh" and not is_geometry else ()
        return str(find_file(value, kind, suffixes, folder, SceneError, also))
    except SceneError as error:
        raise SceneError(f"{where}: {error}") from error
