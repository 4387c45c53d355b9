"""Wrappers for disturbances of real sensors: noise, bias, quantisation, sampling, delay.

Each acts on the channels whose names begin with given texts. Each has its own random generator, seeded by `reset`, so
that the episode itself is the same with and without it.
"""

import zlib
from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from taichisoft.errors import SceneError
from taichisoft_gym.channels import Channel, saturated

Readings = np.ndarray
Wrapped = gymnasium.Wrapper[Readings, np.ndarray, Readings, np.ndarray]


class Disturbance(Wrapped, RecordConstructorArgs):
    """Base class of the wrappers; only `disturb` is abstract."""

    def __init__(self, env: gymnasium.Env[Readings, np.ndarray], channels: Sequence[str] | None = None, **more: Any):
        """Choose the channels.

        Args:
            env: environment whose observations are readings, one per entry of its `channels`.
            channels: beginnings of the names of the disturbed channels, such as "pressure"; None: all.
            more: further arguments of the wrapper.

        Raises:
            SceneError: no channel has a name with such a beginning.
        """
        RecordConstructorArgs.__init__(self, channels=channels, **more)
        super().__init__(env)
        all_channels: tuple[Channel, ...] = env.get_wrapper_attr("channels")
        beginnings = tuple(channels) if channels is not None else ("",)
        for beginning in beginnings:
            if not any(channel.name.startswith(beginning) for channel in all_channels):
                names = ", ".join(channel.name for channel in all_channels)
                raise SceneError(f"channels: no name begins with '{beginning}'; there are: {names}")
        self.chosen = np.array([channel.name.startswith(beginnings) for channel in all_channels])
        self.random = np.random.default_rng()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Readings, dict[str, Any]]:
        """Begin an episode."""
        readings, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            # The seed depends on all inner wrappers, so that two wrappers of a kind draw different numbers.
            self.random = np.random.default_rng([seed, zlib.crc32(str(self).encode())])
        self.begin(readings[self.chosen].astype(np.float64))
        return self._disturbed(readings), info

    def step(self, action: np.ndarray) -> tuple[Readings, Any, bool, bool, dict[str, Any]]:
        """Simulate one control period."""
        readings, *rest = self.env.step(action)
        return self._disturbed(readings), *rest  # type: ignore[return-value]

    def begin(self, values: np.ndarray) -> None:
        """Begin an episode with these values of the chosen channels."""

    @abstractmethod
    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Return the readings for exact values of the chosen channels."""

    def _disturbed(self, readings: Readings) -> Readings:
        values = readings.astype(np.float64)
        values[self.chosen] = self.disturb(values[self.chosen])
        return saturated(values, self.env.observation_space)  # type: ignore[arg-type]


class Noise(Disturbance):
    """Adds independent normal noise of a standard deviation, in the channels' unit."""

    def __init__(self, env: Any, deviation: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, deviation=deviation)
        self._deviation = deviation

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Add noise."""
        return values + self._deviation * self.random.standard_normal(len(values))


class Bias(Disturbance):
    """Adds an offset of at most `largest`, in the channels' unit, drawn uniformly for each channel at every reset."""

    def __init__(self, env: Any, largest: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, largest=largest)
        self._largest = largest

    def begin(self, values: np.ndarray) -> None:
        """Draw the offsets."""
        self._offset = self.random.uniform(-self._largest, self._largest, len(values))

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Add the offsets."""
        return values + self._offset


class Quantised(Disturbance):
    """Rounds to whole multiples of `resolution`, in the channels' unit."""

    def __init__(self, env: Any, resolution: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, resolution=resolution)
        self._resolution = resolution

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Round the values."""
        rounded: np.ndarray = self._resolution * np.rint(values / self._resolution)
        return rounded


class Sampled(Disturbance):
    """Updates the readings every `every` control periods, and holds them in between."""

    def __init__(self, env: Any, every: int, channels: Sequence[str] | None = None):
        super().__init__(env, channels, every=_whole("every", every, 1))
        self._every = every

    def begin(self, values: np.ndarray) -> None:
        """Restart the count of periods."""
        self._count = 0

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Return the held values, updated when due."""
        if self._count % self._every == 0:
            self._held = values
        self._count += 1
        return self._held


class Delayed(Disturbance):
    """Returns the readings of `steps` control periods before; at first, the first readings."""

    def __init__(self, env: Any, steps: int, channels: Sequence[str] | None = None):
        super().__init__(env, channels, steps=_whole("steps", steps, 0))
        self._steps = steps

    def begin(self, values: np.ndarray) -> None:
        """Fill the delay line with the first values."""
        self._line = deque([values] * self._steps)

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """Append the values to the delay line, and return the oldest."""
        self._line.append(values)
        return self._line.popleft()


def _whole(name: str, value: int, least: int) -> int:
    """Check a number of control periods.

    Raises:
        SceneError: the number is not a whole number, or below `least`.
    """
    if value != int(value) or value < least:
        raise SceneError(f"{name} = {value!r}: must be a whole number of control periods, {least} or more")
    return int(value)
