"""Channels: name, unit and range of each number of an action or an observation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft_gym.arguments import numbers


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
        """Check the range.

        Raises:
            SceneError: it ends before it begins.
        """
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
    """The readings of all groups, one after the other.

    Raises:
        SceneError: a group reads something else than a finite number for each of its channels.
    """
    readings = [numbers(group.read(seen)) for group in groups]
    for group, values in zip(groups, readings, strict=True):
        if values.shape != (len(group.channels),) or not np.isfinite(values).all():
            name, count = group.channels[0].name if group.channels else "", len(group.channels)
            raise SceneError(f"observations: the group of '{name}' reads {values}: must be {count} finite numbers")
    return np.concatenate(readings)


def saturated(values: np.ndarray, space: Box, name: str = "readings") -> np.ndarray:
    """Clip values to the range of a space; `name` begins the error.

    Raises:
        SceneError: they are not as many as the space has.
    """
    if np.shape(values) != space.shape:
        raise SceneError(f"{name} = {values!r}: must be an array of shape {space.shape}")
    return np.clip(values, space.low, space.high).astype(np.float32)
