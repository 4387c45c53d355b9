"""Wrappers of environments: further readings, pictures, and the disturbances of real sensors."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs
from pydantic import ValidationError

from taichisoft.control import SensorChain
from taichisoft.errors import SceneError
from taichisoft.scene import SensorSettings, first_problem
from taichisoft_gym.channels import Channel, ChannelGroup, box_of, saturated
from taichisoft_gym.observed_quantities import make_group

Readings = np.ndarray


class Observed(gymnasium.ObservationWrapper[Readings, np.ndarray, Readings], RecordConstructorArgs):
    """Adds channels to the readings.

    Attributes:
        channels: name, unit and range of each number of an observation, the new ones last.
    """

    def __init__(self, env: Any, quantity: str | Callable[[Any], ChannelGroup], highest: float | None = None):
        """Add a quantity.

        Args:
            env: environment whose observations are readings.
            quantity: one that the attribute `observations` of an environment could name as well.
            highest: end of the channels' range, for figures; None for the usual one.

        Raises:
            SceneError: there is no such quantity, or the scene has nothing of the kind.
        """
        RecordConstructorArgs.__init__(self, quantity=quantity, highest=highest)
        super().__init__(env)
        self._group = make_group(env.unwrapped, quantity, highest)
        self._space = box_of(self._group.channels)
        self.channels: tuple[Channel, ...] = (*env.get_wrapper_attr("channels"), *self._group.channels)
        self.observation_space = box_of(self.channels)

    def observation(self, observation: Readings) -> Readings:
        """Append the values to the readings."""
        values = np.asarray(self._group.read(self.get_wrapper_attr("simulation").observe()), np.float64)
        return np.concatenate([observation, saturated(values, self._space)])


class Disturbed(gymnasium.Wrapper[Readings, np.ndarray, Readings, np.ndarray], RecordConstructorArgs):
    """Disturbs chosen readings once in a control period, as a scene's `[sensors]` disturb what controllers see.

    Its random numbers are its own and seeded by `reset`, so that the episode is the same with and without it.
    """

    def __init__(
        self,
        env: gymnasium.Env[Readings, np.ndarray],
        channels: Sequence[str] | None = None,
        *,
        bias: float = 0.0,
        noise: float = 0.0,
        resolution: float = 0.0,
        period: int = 1,
        delay: int = 0,
        dropout: float = 0.0,
    ):
        """Choose the channels, and what is done to each, in this order.

        Args:
            env: environment whose observations are readings, one per entry of its `channels`.
            channels: beginnings of the names of the disturbed channels, such as "pressure"; None: all.
            bias: largest offset [unit of the channel], drawn evenly for each channel at every reset.
            noise: standard deviation of independent normal noise [unit of the channel].
            resolution: readings are rounded to whole multiples of it [unit of the channel]; 0: not at all.
            period: control periods from one reading to the next; it is held in between.
            delay: age of what is seen, in control periods; at first, the first readings.
            dropout: probability with which a reading is lost; the one before is seen instead.

        Raises:
            SceneError: no channel has a name with such a beginning, a number makes no sense, or the observations are
                dictionaries.
        """
        amounts: dict[str, Any] = {"noise": noise, "bias": bias, "resolution": resolution, "dropout": dropout}
        RecordConstructorArgs.__init__(self, channels=channels, period=period, delay=delay, **amounts)
        super().__init__(env)
        if not isinstance(env.observation_space, Box):
            raise SceneError("Disturbed needs plain readings: put it inside Camera, and without goals=True")
        known: tuple[Channel, ...] = env.get_wrapper_attr("channels")
        beginnings = tuple(channels) if channels is not None else ("",)
        for beginning in beginnings:
            if not any(channel.name.startswith(beginning) for channel in known):
                names = ", ".join(channel.name for channel in known)
                raise SceneError(f"channels: no name begins with '{beginning}'; there are: {names}")
        for name, count, least in (("period", period, 1), ("delay", delay, 0)):
            if count != int(count) or count < least:
                raise SceneError(f"{name} = {count!r}: must be a whole number of control periods, {least} or more")
        try:
            sensor = SensorSettings.model_validate(amounts)
        except ValidationError as error:
            raise SceneError(first_problem(error, SensorSettings)) from error
        # Control periods may exceed what is possible in seconds.
        sensor = sensor.model_copy(update={"period": float(period), "delay": float(delay)})
        self.chosen = np.array([channel.name.startswith(beginnings) for channel in known])
        # The name contains all inner wrappers, so that two of them draw different numbers.
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


class Camera(gymnasium.ObservationWrapper[dict[str, np.ndarray], np.ndarray, np.ndarray], RecordConstructorArgs):
    """Makes observations dictionaries of "readings" and "picture": (height, width, 3), dtype uint8.

    It must be the outermost wrapper, since the others need plain readings.
    """

    def __init__(self, env: Any, camera: str | Sequence[Sequence[float]] = "iso", size: tuple[int, int] = (160, 120)):
        """Add a camera.

        Args:
            env: environment whose observations are readings.
            camera: camera, see `Simulation.render`.
            size: width and height [pixels].
        """
        RecordConstructorArgs.__init__(self, camera=camera, size=size)
        super().__init__(env)
        self._camera, self._size = camera, size
        picture = Box(0, 255, (size[1], size[0], 3), np.uint8)
        self.observation_space = Dict({"readings": env.observation_space, "picture": picture})  # type: ignore[assignment]

    def observation(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        """Readings and picture."""
        return {"readings": observation, "picture": self.get_wrapper_attr("picture")(self._camera, self._size)}
