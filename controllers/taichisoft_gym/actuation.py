"""What an action means: pressures of cavities, pulls of cables, and velocities of the base."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft.bodies.rotations import right_of
from taichisoft.control.control import Control
from taichisoft.errors import SceneError
from taichisoft.scenes.scene import Scene
from taichisoft.state import State
from taichisoft_gym.channels import Channel

AXES = ("right", "front", "up")
"""Directions of the base, the object and targets, as in pictures: up is against gravity."""
USUAL_PULL = 20.0
"""Longest pull of a cable without a stop [mm]."""
USUAL_SPEED = 100.0
"""Highest speed of the base, if the scene's limit is not lower [mm/s]."""


def scene_axes(scene: Scene) -> np.ndarray:
    """The unit vectors right, front and up of a scene as rows, shape (3, 3)."""
    right = right_of(scene.up)
    return np.array([right, np.cross(right, scene.up), scene.up])


@dataclass(frozen=True)
class Travel:
    """How far the base can go from its start [mm], in the directions of AXES, and how fast [mm/s]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    speed: float


class Actuation:
    """Turns actions, of numbers from -1 to 1, into requests.

    Attributes:
        channels: what the ends -1 and 1 of each number stand for.
    """

    def __init__(self, scene: Scene, pressure: tuple[float, float], travel: Travel | None):
        """Find the actuators.

        Args:
            scene: scene with cavities, cables or both.
            pressure: lowest and highest pressure [kPa].
            travel: how far the base can go; None where it stands still.

        Raises:
            SceneError: there is neither cavity nor cable.
        """
        bodies = scene.soft_bodies.items()
        self.cavities = tuple(f"{name}.{cavity}" for name, body in bodies for cavity in body.cavities)
        cables = {f"{name}.{cable}": told for name, body in bodies for cable, told in body.cables.items()}
        if not self.cavities and not cables:
            raise SceneError("an environment needs a soft body with a cavity or a cable; the scene has none")
        self.cables = tuple(cables)
        self._axes, self._travel = scene_axes(scene), travel
        channels = [Channel(f"pressure {name}", "kPa", *pressure) for name in self.cavities]
        channels += [
            Channel(f"pull {name}", "mm", 0.0, told.highest_pull or USUAL_PULL) for name, told in cables.items()
        ]
        self.actuator_channels = tuple(channels)
        self._moves = [axis for axis in range(3) if travel is not None and travel.low[axis] < travel.high[axis]]
        if travel is not None:
            speed = min(travel.speed, math.inf if scene.limits.base_speed is None else scene.limits.base_speed)
            channels += [Channel(f"base velocity {AXES[axis]}", "mm/s", -speed, speed) for axis in self._moves]
        self.channels = tuple(channels)
        self._low, self._high = (np.array([getattr(one, end) for one in channels]) for end in ("low", "high"))

    def control(self, action: np.ndarray, state: State, period: float) -> Control:
        """What an action asks for during the control period [s] that begins at `state`."""
        values = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        pressed, pulled = len(self.cavities), len(self.cavities) + len(self.cables)
        asked: dict[str, Any] = {
            "pressure": dict(zip(self.cavities, values[:pressed].tolist(), strict=True)),
            "cable_pull": dict(zip(self.cables, values[pressed:pulled].tolist(), strict=True)),
        }
        if self._travel is not None:
            velocity = np.zeros(3)
            velocity[self._moves] = values[pulled:]
            place = self._axes @ state.base_translation
            reached = np.clip(place + period * velocity, self._travel.low, self._travel.high)
            asked["base_velocity"] = (reached - place) / period @ self._axes
        return Control(**asked)
