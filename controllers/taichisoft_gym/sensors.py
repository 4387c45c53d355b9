"""Wrappers that add sensors: contact forces, bending, flows, a camera."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.utils import RecordConstructorArgs

from taichisoft_gym import observed_quantities
from taichisoft_gym.channels import Channel, ChannelGroup, box_of, saturated


class Sensor(gymnasium.ObservationWrapper[np.ndarray, np.ndarray, np.ndarray], RecordConstructorArgs):
    """Base class of the wrappers that add channels to the readings.

    Attributes:
        channels: name, unit and range of each number of an observation, the new ones last.
    """

    def __init__(self, env: gymnasium.Env[np.ndarray, np.ndarray], quantity: ChannelGroup, **arguments: Any):
        RecordConstructorArgs.__init__(self, **arguments)
        super().__init__(env)
        self._quantity, self._space = quantity, box_of(quantity.channels)
        self.channels: tuple[Channel, ...] = (*env.get_wrapper_attr("channels"), *quantity.channels)
        self.observation_space = box_of(self.channels)

    def observation(self, observation: np.ndarray) -> np.ndarray:
        """Append the sensor's values to the readings."""
        values = np.asarray(self._quantity.read(self.get_wrapper_attr("simulation").observe()), np.float64)
        return np.concatenate([observation, saturated(values, self._space)])


class ContactForces(Sensor):
    """Adds the normal force of each finger on the object [mN], up to `highest`."""

    def __init__(self, env: Any, highest: float = 5000.0):
        super().__init__(env, observed_quantities.contact_force(env, highest), highest=highest)


class Bending(Sensor):
    """Adds the bending angle of each finger [rad], from 0 to pi."""

    def __init__(self, env: Any):
        super().__init__(env, observed_quantities.bending(env))


class Flows(Sensor):
    """Adds the flow of air into each cavity [mm^3/s], from -`highest` to `highest`."""

    def __init__(self, env: Any, highest: float = 200e3):
        super().__init__(env, observed_quantities.flow(env, highest), highest=highest)


class Camera(gymnasium.ObservationWrapper[dict[str, np.ndarray], np.ndarray, np.ndarray], RecordConstructorArgs):
    """Makes observations dictionaries of "readings" and "picture": (height, width, 3), dtype uint8.

    It must be the outermost sensor, since the others need plain readings.
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
