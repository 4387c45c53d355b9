"""Channels: name, unit and range of each number of an action or an observation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from taichisoft.control import Observation


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


def saturated(values: np.ndarray, space: Box) -> np.ndarray:
    """Clip values to the range of a space."""
    return np.clip(values, space.low, space.high).astype(np.float32)
