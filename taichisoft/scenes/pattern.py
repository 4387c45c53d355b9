"""Bodies in a circle: one table becomes several, turned about an axis."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from taichisoft.errors import SceneError
from taichisoft.scenes.table import Number, Table, Vector
from taichisoft.scenes.validation_errors import first_problem

KEY = "pattern"
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
    """Tables of bodies, with the copies that their key `pattern` asks for; `key` is that of the tables in the scene.

    Raises:
        SceneError: a pattern is not valid, or two bodies have the same name; begins with `source`.
    """
    expanded: dict[str, Any] = {}
    for name, table in bodies.items():
        copies = {name: table}
        if isinstance(table, Mapping) and KEY in table:
            copies = _copies(name, table, PLACES[key], f"{source}: {key}.{name}.{KEY}")
        for one in copies:
            if one in expanded or (one != name and one in bodies):
                raise SceneError(f"{source}: {key}.{name}.{KEY} makes a body called '{one}', which is there already")
        expanded |= copies
    return expanded


def _copies(name: str, table: Mapping[str, Any], place: str, where: str) -> dict[str, Any]:
    try:
        pattern = CircularPattern.model_validate(table[KEY])
    except ValidationError as error:
        raise SceneError(first_problem(error, CircularPattern, where)) from error
    own = {key: value for key, value in table.items() if key != KEY}
    turned = (_turned(own, pattern, place, number) for number in range(pattern.count))
    return {f"{name}{number}": one for number, one in enumerate(turned, 1)}


def _turned(table: dict[str, Any], pattern: CircularPattern, place: str, number: int) -> dict[str, Any]:
    """The table of a copy; the values of the first are those of the body, to the bit."""
    vectors = [table[key] for key in ("rotation", place, *DIRECTIONS) if key in table]
    if number == 0 or not all(map(_is_vector, vectors)):
        return table  # what is not a vector is refused later, with the key
    import numpy as np

    from taichisoft.rotation_angles import degrees_from_rotation, rotation_from_degrees, rotation_from_vector

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
    return isinstance(value, list | tuple) and len(value) == 3 and all(type(one) in (int, float) for one in value)
