"""Values of a component's data, as the translation needs them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.kinds import FALSE, TRUE, WrongValue
from taichisoft_sofa.tree.kinds import numbers as parse_numbers

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component


def is_given(component: "Component", name: str) -> bool:
    """Whether the scene wrote a data."""
    data = component.findData(name)
    return data is not None and data.is_set()


def value_of(component: "Component", *names: str) -> Any:
    """The value of the first of these data that the scene wrote; None where it wrote none of them."""
    for name in names:
        data = component.findData(name)
        if data is not None and data.is_set():
            return data.given()
    return None


def numbers(component: "Component", *names: str, default: Sequence[float] = ()) -> np.ndarray:
    """All numbers of the first of these data that the scene wrote, in one row; `default` where it wrote none.

    Raises:
        SceneError: it is no list of numbers.
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
        SceneError: there is none.
    """
    found = numbers(component, *names, default=[default])
    if not len(found):
        raise SceneError(f"{described(component)}: {names[0]} is empty; a number is needed")
    return float(found[0])


def vector(component: "Component", *names: str, default: Sequence[float]) -> np.ndarray:
    """As many numbers as `default` has.

    Raises:
        SceneError: there are more or fewer.
    """
    found = numbers(component, *names, default=default)
    if len(found) != len(default):
        raise SceneError(f"{described(component)}: {names[0]} has {len(found)} numbers; {len(default)} are needed")
    return found


def flag(component: "Component", name: str, default: bool) -> bool:
    """True or false.

    Raises:
        SceneError: it is something else.
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
    """A text."""
    value = value_of(component, *names)
    return default if value is None else str(value).strip()


def computed(component: "Component", name: str, width: int) -> np.ndarray:
    """Rows of `width` numbers that the scene wrote or that the component computes; none where it has no such data."""
    data = component.findData(name)
    value = None if data is None else data.read_value()
    dtype = np.float64 if name in ("position", "rest_position") else np.int64
    if value is None:
        return np.zeros((0, width), dtype=dtype)
    return parse_numbers(value).reshape(-1, width).astype(dtype)


def described(component: "Component") -> str:
    """A component's type, path and line in the scene, as errors begin."""
    return f"{component.type_name} '{component.getPathName()}' ({component.place})"
