"""Channels: name, unit and range of each number of an action or an observation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from taichisoft.control import Observation
from taichisoft.errors import SceneError

# What users give to environments, checked: numbers, actions, shares, periods.


def numbers(value: Any) -> np.ndarray:
    """Copy an argument to an array of numbers; a single NaN if it cannot be converted."""
    try:
        given = np.asarray(value)
    except ValueError:  # rows of unequal lengths
        return np.array(np.nan)
    return given.astype(np.float64) if given.dtype.kind in "iuf" else np.array(np.nan)


def action_values(action: Any, count: int) -> np.ndarray:
    """Copy an action to numbers from -1 to 1, shape (count,)."""
    request = numbers(action)
    if request.shape != (count,) or not np.isfinite(request).all():
        raise SceneError(f"action {action!r}: must be {count} finite numbers from -1 to 1")
    return np.minimum(np.maximum(request, -1.0), 1.0)


def whole_steps(period: float, time_step: float) -> int:
    """Time steps in a control period [s]."""
    steps = round(period / time_step)
    if steps < 1 or abs(steps * time_step - period) > 1e-9:
        raise SceneError(f"control_period = {period:g} s: must be a whole multiple of the time step, {time_step:g} s")
    return steps


def finite(name: str, value: Any, what: str = "a finite number", low: float = -np.inf, high: float = np.inf) -> float:
    """A finite number from `low` to `high`; `name` begins the error, which says `what` it must be."""
    number = numbers(value)
    if number.shape != () or not (np.isfinite(number) and low <= number <= high):
        raise SceneError(f"{name} = {value!r}: must be {what}")
    return float(number)


def positive(name: str, value: Any) -> float:
    """A finite number above zero; `name` begins the error."""
    number = finite(name, value)
    if number <= 0.0:
        raise SceneError(f"{name} = {value!r}: must be above 0")
    return number


def share(name: str, value: Any) -> float:
    """A number from 0 to 1; `name` begins the error."""
    return finite(name, value, "a number from 0 to 1", 0.0, 1.0)


@dataclass(frozen=True)
class Channel:
    """One number of an action or an observation.

    Attributes:
        name: name, such as "pressure finger1.cavity".
        unit: unit; "1" for none.
        low, high: range; values beyond saturate at its ends, as with real sensors.
    """

    name: str
    unit: str
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the range."""
        if not self.low <= self.high:
            raise SceneError(f"channel '{self.name}': low = {self.low!r} must not be above high = {self.high!r}")


@dataclass(frozen=True)
class ChannelGroup:
    """A group of channels with a common reading.

    Attributes:
        channels: the channels.
        read: returns the values of an observation, shape (channel_count,).
    """

    channels: tuple[Channel, ...]
    read: Callable[[Observation], Sequence[float] | np.ndarray]


def symmetric(name: str, unit: str, reach: float, parts: Iterable[str]) -> tuple[Channel, ...]:
    """Channels "NAME PART" from -reach to reach."""
    return tuple(Channel(f"{name} {part}", unit, -reach, reach) for part in parts)


def box_of(channels: Sequence[Channel]) -> Box:
    """The space of the channels' values."""
    low, high = (np.array([getattr(channel, end) for channel in channels], np.float32) for end in ("low", "high"))
    return Box(low, high, dtype=np.float32)


def read_groups(groups: Sequence[ChannelGroup], seen: Observation) -> np.ndarray:
    """The readings of all groups, one after the other."""
    readings = [numbers(group.read(seen)) for group in groups]
    for group, values in zip(groups, readings, strict=True):
        if values.shape != (len(group.channels),) or not np.isfinite(values).all():
            name, count = group.channels[0].name if group.channels else "", len(group.channels)
            raise SceneError(f"observations: the group of '{name}' reads {values}: must be {count} finite numbers")
    return np.concatenate(readings)


def saturated(values: np.ndarray, space: Box, name: str = "readings") -> np.ndarray:
    """Clip values to the range of a space; `name` begins the error."""
    if np.shape(values) != space.shape:
        raise SceneError(f"{name} = {values!r}: must be an array of shape {space.shape}")
    return np.minimum(np.maximum(values, space.low), space.high).astype(np.float32)
