"""Typed access to the values of a component's data."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.value_kinds import FALSE, TRUE, WrongValue
from taichisoft_sofa.tree.value_kinds import numbers as parse_numbers

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component


def is_given(component: "Component", name: str) -> bool:
    """Whether the scene wrote to a data."""
    data = component.findData(name)
    return data is not None and data.is_set()


def value_of(component: "Component", *names: str) -> Any:
    """The value of the first of these data that the scene wrote, or None."""
    for name in names:
        data = component.findData(name)
        if data is not None and data.is_set():
            return data.given()
    return None


def numbers(component: "Component", *names: str, default: Sequence[float] = ()) -> np.ndarray:
    """Numbers of the first of these data that the scene wrote, else `default`, flattened, shape (n,).

    Raises:
        SceneError: the value is not a list of numbers.
    """
    value = value_of(component, *names)
    if value is None:
        return np.array(default, dtype=np.float64)
    try:
        return parse_numbers(value, bools=True)
    except WrongValue as error:
        raise SceneError(f"{described(component)}: {names[0]}: {error}") from error


def number(component: "Component", *names: str, default: float) -> float:
    """The first number of a data.

    Raises:
        SceneError: the data has no number.
    """
    found = numbers(component, *names, default=[default])
    if not len(found):
        raise SceneError(f"{described(component)}: {names[0]} is empty; a number is needed")
    return float(found[0])


def vector(component: "Component", *names: str, default: Sequence[float]) -> np.ndarray:
    """Numbers of a data, as many as in `default`.

    Raises:
        SceneError: the number of numbers differs.
    """
    found = numbers(component, *names, default=default)
    if len(found) != len(default):
        raise SceneError(f"{described(component)}: {names[0]} has {len(found)} numbers; {len(default)} are needed")
    return found


def flag(component: "Component", name: str, default: bool) -> bool:
    """A data that is true or false.

    Raises:
        SceneError: the value is neither.
    """
    value = value_of(component, name)
    if value is None:
        return default
    if isinstance(value, str):
        if value.strip().lower() not in TRUE | FALSE:
            raise SceneError(f"{described(component)}: {name} = '{value}'; must be true or false")
        return value.strip().lower() in TRUE
    return bool(np.ravel(value)[0])


def text(component: "Component", *names: str, default: str = "") -> str:
    """A data as text."""
    value = value_of(component, *names)
    return default if value is None else str(value).strip()


def computed(component: "Component", name: str, width: int) -> np.ndarray:
    """Rows of `width` numbers, written by the scene or computed; no rows if the component has no such data."""
    data = component.findData(name)
    value = None if data is None else data.read_value()
    dtype = np.float64 if name in ("position", "rest_position") else np.int64
    if value is None:
        return np.zeros((0, width), dtype=dtype)
    return parse_numbers(value).reshape(-1, width).astype(dtype)


def described(component: "Component") -> str:
    """Type, path and line of a component, for error messages."""
    return f"{component.type_name} '{component.getPathName()}' ({component.place})"
