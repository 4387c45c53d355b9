"""Wrappers for disturbances of real sensors: those of a scene's `[sensors]`, for chosen channels of an environment.

Each acts on the channels whose names begin with given texts, once in a control period. Each has random numbers of its
own, seeded by `reset`, so that the episode itself is the same with and without it.
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from taichisoft.control import SensorChain
from taichisoft.errors import SceneError
from taichisoft.scene import SensorSettings
from taichisoft_gym.channels import Channel, saturated

Readings = np.ndarray
Wrapped = gymnasium.Wrapper[Readings, np.ndarray, Readings, np.ndarray]


class Disturbance(Wrapped, RecordConstructorArgs):
    """Base class of the wrappers."""

    def __init__(
        self,
        env: gymnasium.Env[Readings, np.ndarray],
        channels: Sequence[str] | None,
        sensor: SensorSettings,
        **arguments: Any,
    ):
        """Choose the channels.

        Args:
            env: environment whose observations are readings, one per entry of its `channels`.
            channels: beginnings of the names of the disturbed channels, such as "pressure"; None: all.
            sensor: what is done; its period and delay are in control periods.
            arguments: arguments of the wrapper.

        Raises:
            SceneError: no channel has a name with such a beginning, or the observations are dictionaries.
        """
        RecordConstructorArgs.__init__(self, channels=channels, **arguments)
        super().__init__(env)
        if not isinstance(env.observation_space, gymnasium.spaces.Box):
            raise SceneError(
                f"{type(self).__name__} needs plain readings: put it inside Camera, and without goals=True"
            )
        all_channels: tuple[Channel, ...] = env.get_wrapper_attr("channels")
        beginnings = tuple(channels) if channels is not None else ("",)
        for beginning in beginnings:
            if not any(channel.name.startswith(beginning) for channel in all_channels):
                names = ", ".join(channel.name for channel in all_channels)
                raise SceneError(f"channels: no name begins with '{beginning}'; there are: {names}")
        self.chosen = np.array([channel.name.startswith(beginnings) for channel in all_channels])
        # The name contains all inner wrappers, so that two wrappers of a kind draw different numbers.
        self._chain = SensorChain(sensor, 1.0, int(self.chosen.sum()), str(self))
        self._seeds = np.random.default_rng()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Readings, dict[str, Any]]:
        """Begin an episode."""
        readings, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._seeds = np.random.default_rng(seed)
        self._seed, self._step = int(self._seeds.integers(2**32)), 0
        self._samples = self._chain.begin(readings[self.chosen].astype(np.float64), 0, self._seed)
        return self._disturbed(readings), info

    def step(self, action: np.ndarray) -> tuple[Readings, Any, bool, bool, dict[str, Any]]:
        """Simulate one control period."""
        readings, *rest = self.env.step(action)
        self._step += 1
        values = readings[self.chosen].astype(np.float64)
        self._samples = self._chain.after(self._samples, values, self._step, self._seed)
        return self._disturbed(readings), *rest  # type: ignore[return-value]

    def _disturbed(self, readings: Readings) -> Readings:
        values = readings.astype(np.float64)
        values[self.chosen] = self._chain.reading(self._samples, self._step)
        return saturated(values, self.env.observation_space)  # type: ignore[arg-type]


class Noise(Disturbance):
    """Adds independent normal noise of a standard deviation, in the channels' unit."""

    def __init__(self, env: Any, deviation: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, _sensor(noise=_amount("deviation", deviation)), deviation=deviation)


class Bias(Disturbance):
    """Adds an offset of at most `largest`, in the channels' unit, drawn uniformly for each channel at every reset."""

    def __init__(self, env: Any, largest: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, _sensor(bias=_amount("largest", largest)), largest=largest)


class Quantised(Disturbance):
    """Rounds to whole multiples of `resolution`, in the channels' unit."""

    def __init__(self, env: Any, resolution: float, channels: Sequence[str] | None = None):
        super().__init__(env, channels, _sensor(resolution=_amount("resolution", resolution)), resolution=resolution)


class Sampled(Disturbance):
    """Updates the readings every `every` control periods, and holds them in between."""

    def __init__(self, env: Any, every: int, channels: Sequence[str] | None = None):
        every = _whole("every", every, 1)
        super().__init__(env, channels, _sensor(period=float(every)), every=every)


class Delayed(Disturbance):
    """Returns the readings of `steps` control periods before; at first, the first readings."""

    def __init__(self, env: Any, steps: int, channels: Sequence[str] | None = None):
        steps = _whole("steps", steps, 0)
        super().__init__(env, channels, _sensor(delay=float(steps)), steps=steps)


class Dropout(Disturbance):
    """Loses each reading with a probability; the one before is seen instead."""

    def __init__(self, env: Any, probability: float, channels: Sequence[str] | None = None):
        if not 0.0 <= probability <= 1.0:
            raise SceneError(f"probability = {probability!r}: must be from 0 to 1")
        super().__init__(env, channels, _sensor(dropout=float(probability)), probability=probability)


def _sensor(**settings: float) -> SensorSettings:
    """Settings in control periods, which may exceed what is possible in seconds."""
    return SensorSettings.model_construct(**settings)  # type: ignore[arg-type]


def _amount(name: str, value: float) -> float:
    if not 0.0 <= value < np.inf:
        raise SceneError(f"{name} = {value!r}: must be 0 or more")
    return float(value)


def _whole(name: str, value: int, least: int) -> int:
    """Check a number of control periods.

    Raises:
        SceneError: the number is not a whole number, or below `least`.
    """
    if value != int(value) or value < least:
        raise SceneError(f"{name} = {value!r}: must be a whole number of control periods, {least} or more")
    return int(value)
