"""Scenes from tables and as TOML: files found, inheritance, errors that point at the key, the resolved scene."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field, ValidationError

from taichisoft.base.files import DEEPEST, parse_toml
from taichisoft.errors import SceneError, nearest
from taichisoft.mesh.mesh_files import POINT_SUFFIXES, SURFACE_SUFFIXES, VOLUME_SUFFIXES
from taichisoft.scene.scene import Scene
from taichisoft.scene.shipped import find_file
from taichisoft.scene.table import Number, Table, Vector, first_problem

# Changes of a scene from the command line: another controller, and values such as --set contact.friction=0.3.

NO_GOAL = "none"
# Tables whose keys are names that the user gave: a new one here is a misspelt one, not a default to be replaced.
NAMED_TABLES = ("soft_bodies", "rigid_bodies", "obstacles")


def change_scene(
    document: dict[str, Any], overrides: Sequence[str], controller: str | None, goal: str | None = None
) -> None:
    """Change the tables of a scene, before they are inherited and checked.

    Args:
        document: tables of a scene, changed in place.
        overrides: "key.key=value" each.
        controller: name of a controller to take instead of the scene's own, whose settings are then dropped, while
            its period and time limit stay; None for the scene's own.
        goal: kind of goal to take instead of the scene's own, of the same object or else of the first rigid body;
            "none" for none at all, None for the scene's own.
    """
    table = document.setdefault("controller", {}) if controller is not None else None
    if isinstance(table, dict) and table.get("name") != controller:
        table.pop("settings", None)
        table["name"] = controller
    if goal is not None:
        _change_goal(document, goal)
    for override in overrides:
        apply_override(document, override)


def _change_goal(document: dict[str, Any], kind: str) -> None:
    table, bodies = document.get("goal"), document.get("rigid_bodies")
    if kind == NO_GOAL:
        document.pop("goal", None)
        return
    table = dict(table) if isinstance(table, dict) else {}
    if table.get("kind", "held") != kind:
        table = {key: value for key, value in table.items() if key not in ("position", "height")}
    first = next(iter(bodies), None) if isinstance(bodies, dict) else None
    document["goal"] = ({"object": first} if first is not None else {}) | table | {"kind": kind}


def apply_override(
    document: dict[str, Any], override: str, example: str = "contact.friction=0.3", whole: str = "the scene"
) -> None:
    """Put the value of "key.key=value" into tables, before they are checked.

    The value is read as TOML, and as plain text when it is none. Tables that the scene leaves out are made;
    entries of lists are given by their index, from 0.

    Args:
        document: tables of a scene, or of any other TOML file, changed in place.
        override: text from the command line.
        example: valid override, for the error.
        whole: name of the document, for the error.

    Raises:
        SceneError: it has no "=", or leads to no place in the document.
    """
    key, separator, text = override.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not separator or not all(names):
        raise SceneError(f"--set {override}: must look like {example}")
    if len(names) > DEEPEST:
        raise SceneError(
            f"--set {names[0]}.{names[1]}...: has {len(names)} keys; nothing is nested deeper than {DEEPEST}"
        )
    place: Any = document
    for depth, name in enumerate(names):
        where = ".".join(names[:depth]) or whole
        problem = _why_not(place, name, where, names[depth + 1 :])
        if problem:
            raise SceneError(f"--set {override}: {problem}")
        index: Any = int(name) if isinstance(place, list) else name
        if depth == len(names) - 1:
            place[index] = _value(text)
        else:
            place = place[index] if isinstance(place, list) else place.setdefault(name, {})


def _why_not(place: Any, name: str, where: str, rest: list[str]) -> str:
    """What is wrong with going from `place` on to `name` and then to `rest`; empty when nothing is."""
    if isinstance(place, list):
        valid = name.isdecimal() and int(name) < len(place)
        return "" if valid else f"{where} has no entry '{name}'; it has {len(place)}, counted from 0"
    if not isinstance(place, dict):
        return f"{where} is not a table: it has no '{name}'"
    if name not in place and rest:
        if where in NAMED_TABLES:
            return f"{where} has no '{name}'; {nearest(name, list(place), 'there are')}"
        if rest[0].isdecimal():
            return f"{where} has no list '{name}' of its own"
    return ""


def _value(text: str) -> Any:
    try:
        document = parse_toml(f"value = {text}")
    except ValueError:
        return text.strip()
    return document["value"] if len(document) == 1 else text.strip()


# Bodies in a circle: one table becomes several, turned about an axis.

PATTERN = "pattern"
PLACES = {"soft_bodies": "translation", "rigid_bodies": "position"}
"""Bodies that may have a pattern, and the key of their place."""
DIRECTIONS = ("velocity", "angular_velocity")
"""Keys of bodies that turn with them. Forces on nodes and directions of anchors stay in the axes of space."""


class CircularPattern(Table):
    """Copies of a body in a circle: "finger" becomes "finger1", "finger2" and so on, the first where the body is."""

    count: Annotated[int, Field(strict=True, ge=1, le=100)]
    """Number of bodies."""
    axis: Literal["x", "y", "z", "-x", "-y", "-z"]
    """Direction of the axis; the copies follow each other anticlockwise about it."""
    centre: Vector = (0.0, 0.0, 0.0)
    """A point of the axis [mm]."""
    angle: Number = 360.0
    """Angle that all together take [degrees]: from one body to the next it is angle / count."""


def with_patterns(bodies: Mapping[str, Any], key: str, source: str) -> dict[str, Any]:
    """Tables of bodies, with the copies of their key `pattern`; `key` is that of the tables in the scene."""
    expanded: dict[str, Any] = {}
    for name, table in bodies.items():
        copies = {name: table}
        if isinstance(table, Mapping) and PATTERN in table:
            copies = _copies(name, table, PLACES[key], f"{source}: {key}.{name}.{PATTERN}")
        for copy in copies:
            if copy in expanded or (copy != name and copy in bodies):
                raise SceneError(
                    f"{source}: {key}.{name}.{PATTERN} makes a body called '{copy}', which is there already"
                )
        expanded |= copies
    return expanded


def _copies(name: str, table: Mapping[str, Any], place: str, where: str) -> dict[str, Any]:
    try:
        pattern = CircularPattern.model_validate(table[PATTERN])
    except ValidationError as error:
        raise SceneError(first_problem(error, CircularPattern, where)) from error
    own = {key: value for key, value in table.items() if key != PATTERN}
    turned = (_turned(own, pattern, place, number) for number in range(pattern.count))
    return {f"{name}{number}": one for number, one in enumerate(turned, 1)}


def _turned(table: dict[str, Any], pattern: CircularPattern, place: str, number: int) -> dict[str, Any]:
    """The table of a copy; the values of the first are those of the body, to the bit."""
    vectors = [table[key] for key in ("rotation", place, *DIRECTIONS) if key in table]
    if number == 0 or not all(map(_is_vector, vectors)):
        return table  # what is not a vector is refused later, with the key
    import numpy as np

    from taichisoft.base.rotations import degrees_from_rotation, rotation_from_degrees, rotation_from_vector

    axis = np.eye(3)["xyz".index(pattern.axis[-1])] * (-1.0 if pattern.axis.startswith("-") else 1.0)
    turn = rotation_from_vector(np.radians(number * pattern.angle / pattern.count) * axis)
    centre = np.array(pattern.centre)
    before = rotation_from_degrees(table.get("rotation", (0.0, 0.0, 0.0)))
    moved = centre + turn @ (np.array(table.get(place, (0.0, 0.0, 0.0)), float) - centre)
    changed = {"rotation": degrees_from_rotation(turn @ before), place: moved.tolist()}
    for key in DIRECTIONS:
        if key in table:
            changed[key] = (turn @ table[key]).tolist()
    return {**table, **changed}


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) == 3 and all(type(part) in (int, float) for part in value)


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
    resolved = {key: _with_files(value, folder or Path(), f"{source}: {key}", key) for key, value in tables.items()}
    return _validated(resolved, source)


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
