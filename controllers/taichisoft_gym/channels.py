"""What an entry of an action or an observation means: its name, unit and range."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from taichisoft.control.observation import Observation


@dataclass(frozen=True)
class Channel:
    """One number.

    Attributes:
        name: what it is, such as "pressure finger1.cavity".
        unit: its unit; "1" for none.
        low, high: its range; what is measured beyond is told as the end of the range, as sensors do that saturate.
    """

    name: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Quantity:
    """Several channels that are read together.

    Attributes:
        channels: the channels.
        read: gives their values, shape (channel_count,).
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
    """The values as numbers of a space, those beyond its range at the end of it."""
    return np.clip(values, space.low, space.high).astype(np.float32)
