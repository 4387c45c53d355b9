"""Values in a control, checked: names that exist, numbers that are finite."""

import math

import numpy as np

from taichisoft.errors import ControlError, nearest


def index_of(name: str, names: tuple[str, ...], kind: str, key: str) -> int:
    """Number of what is named in a control's dictionary `key`; `kind` is a word for it.

    Raises:
        ControlError: it does not exist.
    """
    if name not in names:
        raise ControlError(
            f"control.{key}: no {kind} is called {str(name)!r}; {nearest(str(name), list(names), 'there are')}"
        )
    return names.index(name)


def finite(value: object, key: str, shape: tuple[int, ...]) -> np.ndarray | float:
    """A copy as finite floating-point numbers of a shape, () or (count,).

    Raises:
        ControlError: it is not.
    """
    if not shape and type(value) is float and math.isfinite(value):
        return value
    array = as_array(value, key)
    if array.shape != shape or not np.isfinite(array).all():
        wanted = f"{shape[0]} finite numbers" if shape else "one finite number"
        raise ControlError(f"{key} = {value!r}: must be {wanted}")
    return array


def as_array(value: object, key: str) -> np.ndarray:
    """A copy as floating-point numbers; text and truth values are none, though numpy would take them for some."""
    try:
        given = np.asarray(value)
        if given.dtype.kind in "iuf":
            return np.array(given, dtype=np.float64)
    except (TypeError, ValueError):  # rows of unequal lengths
        pass
    raise ControlError(f"{key} = {value!r}: must be a number or an array of numbers")
