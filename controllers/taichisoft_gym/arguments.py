"""What users give to environments, checked: numbers, actions, shares, periods."""

from typing import Any

import numpy as np

from taichisoft.errors import SceneError


def numbers(value: Any) -> np.ndarray:
    """Copy an argument to an array of numbers; a single NaN if it cannot be converted."""
    try:
        given = np.asarray(value)
    except ValueError:  # rows of unequal lengths
        return np.array(np.nan)
    return given.astype(np.float64) if given.dtype.kind in "iuf" else np.array(np.nan)


def action_values(action: Any, count: int) -> np.ndarray:
    """Copy an action to numbers from -1 to 1, shape (count,).

    Raises:
        SceneError: it has another number of entries, or a value that is not finite.
    """
    asked = numbers(action)
    if asked.shape != (count,) or not np.isfinite(asked).all():
        raise SceneError(f"action {action!r}: must be {count} finite numbers from -1 to 1")
    return np.clip(asked, -1.0, 1.0)


def whole_steps(period: float, time_step: float) -> int:
    """Time steps in a control period [s].

    Raises:
        SceneError: they are not a whole number, or none.
    """
    steps = round(period / time_step)
    if steps < 1 or abs(steps * time_step - period) > 1e-9:
        raise SceneError(f"control_period = {period:g} s: must be a whole multiple of the time step, {time_step:g} s")
    return steps


def share(name: str, value: Any) -> float:
    """A number from 0 to 1; `name` begins the error.

    Raises:
        SceneError: it is none.
    """
    if isinstance(value, int | float) and 0.0 <= value <= 1.0:
        return float(value)
    raise SceneError(f"{name} = {value!r}: must be a number from 0 to 1")


def finite(name: str, value: Any) -> float:
    """A finite number; `name` begins the error.

    Raises:
        SceneError: it is none.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise SceneError(f"{name} = {value!r}: must be a finite number")
    return number


def positive(name: str, value: Any) -> float:
    """A finite number above zero; `name` begins the error.

    Raises:
        SceneError: it is none.
    """
    number = finite(name, value)
    if number <= 0.0:
        raise SceneError(f"{name} = {value!r}: must be above 0")
    return number
