"""Carry-v0: a gripper carries an object to another place on the floor and releases it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.scenes import Scene
from taichisoft.state import State
from taichisoft_gym.actuation import USUAL_SPEED, Travel
from taichisoft_gym.channels import ChannelGroup, symmetric
from taichisoft_gym.grasp import STILL, GripperEnvironment
from taichisoft_gym.task import Judgement

PLACED = 2.0
"""Height over the floor up to which an object stands on it [mm]."""


class Carry(GripperEnvironment):
    """Carry-v0; docs/environments.md describes it."""

    def __init__(
        self,
        scene: str | Path | Scene = "gripper",
        distance: tuple[float, float] = (20.0, 50.0),
        tolerance: float = 5.0,
        **common: Any,
    ):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            scene: scene with a gripper and an object, or its name or path.
            distance: shortest and longest horizontal distance to the target [mm], in any direction.
            tolerance: distance to the target within which the object has arrived [mm].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self._distance, self._tolerance = distance, tolerance
        reach = distance[1] + 20.0
        super().__init__(Travel((-reach, -reach, 0.0), (reach, reach, 60.0), USUAL_SPEED), scene=scene, **common)

    def _observed(self) -> Sequence[ChannelGroup]:
        self._target = np.zeros(2)
        way = ChannelGroup(
            symmetric("way to the target", "mm", 200.0, ("right", "front")),
            lambda seen: self._target - self._way(seen)[:2],
        )
        return [*super()._observed(), way]

    def _begin_task(self, start: State, options: dict[str, Any]) -> None:
        super()._begin_task(start, options)
        target = options.pop("target", None)
        if target is None:
            distance, angle = self.np_random.uniform(*self._distance), self.np_random.uniform(0.0, 2.0 * np.pi)
            target = distance * np.array([np.cos(angle), np.sin(angle)])
        self._target = self._numbers(target)
        if self._target.shape != (2,) or not np.isfinite(self._target).all() or not self._target.any():
            raise SceneError(
                f"options['target'] = {target!r}: must be a way to the right and to the front [mm], not zero"
            )

    def _marks(self) -> np.ndarray:
        place: np.ndarray = self._start + self._target @ self._axes[:2]
        return place[None]

    def _judge(self, seen: Observation, action: np.ndarray | None) -> Judgement:
        way, touching = self._way(seen), self._touching(seen)
        left = float(np.linalg.norm(self._target - way[:2]))
        progress = float(np.clip(1.0 - left / np.linalg.norm(self._target), -1.0, 1.0))
        arrived = left < self._tolerance
        placed = arrived and way[2] < PLACED and touching == 0.0 and self._speed(seen) < STILL
        failed = self._is_lost(way)
        info = {
            "is_success": bool(placed) and not failed,
            "distance": left,
            "lift": float(way[2]),
            "touching": touching,
        }
        # After arrival, releasing is worth more than holding, so that the policy does not hold the object for ever.
        grip = 1.0 - touching if arrived else touching
        return Judgement(0.2 * grip + 0.8 * progress + float(placed), failed, info)
