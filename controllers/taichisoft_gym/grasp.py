"""Grasp-v0: a gripper closes on an object, lifts it and holds it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.scenes import Scene
from taichisoft.state import State
from taichisoft_gym.actuation import AXES, USUAL_SPEED, Travel
from taichisoft_gym.channels import Channel, ChannelGroup, symmetric
from taichisoft_gym.environment import SoftRobotEnvironment
from taichisoft_gym.task import Judgement

LOST = 80.0
"""Horizontal distance of the object beyond the range of the base, after which it is lost [mm]."""
FALLEN = -20.0
"""Height relative to its start below which the object has fallen off its support [mm]."""
STILL = 10.0
"""Speed below which an object is at rest [mm/s]."""
STICKING = 1.0
"""Speed of sliding below which a finger holds [mm/s]."""


class GripperEnvironment(SoftRobotEnvironment):
    """Base class of tasks with a gripper and an object."""

    def _observed(self) -> Sequence[ChannelGroup]:
        self._start = np.zeros(3)
        name, axes = self.object, self._axes
        base = tuple(
            Channel(f"base {axis}", "mm", low - 1.0, high + 1.0)
            for axis, low, high in zip(AXES, self._travel.low, self._travel.high, strict=True)
        )
        return [
            ChannelGroup(self._actuation.actuator_channels, self._actuation.read),
            ChannelGroup(base, lambda seen: axes @ seen.base_translation),
            ChannelGroup(symmetric("object", "mm", 200.0, AXES), lambda seen: self._way(seen)),
            ChannelGroup(
                symmetric("object velocity", "mm/s", 1000.0, AXES), lambda seen: axes @ seen.object_velocities[name]
            ),
        ]

    def __init__(self, travel: Travel, **common: Any):
        self._travel = travel
        super().__init__(travel, **common)

    def _begin_task(self, start: State, options: dict[str, Any]) -> None:
        self._start = start.rigid_position[list(self.scene.rigid_bodies).index(self.object)].copy()
        self._held_for = 0.0

    def _way(self, seen: Observation) -> np.ndarray:
        """Displacement of the object since the start in the directions of AXES [mm], shape (3,)."""
        way: np.ndarray = self._axes @ (seen.object_positions[self.object] - self._start)
        return way

    def _touching(self, seen: Observation) -> float:
        """Share of the fingers that press the object [-]."""
        return float(np.mean([seen.normal_forces.get((finger, self.object), 0.0) > 0.0 for finger in self.fingers]))

    def _speed(self, seen: Observation) -> float:
        return float(np.linalg.norm(seen.object_velocities[self.object]))

    def _is_lost(self, way: np.ndarray) -> bool:
        reach = max(map(abs, (*self._travel.low[:2], *self._travel.high[:2])))
        return bool(np.linalg.norm(way[:2]) > reach + LOST or way[2] < FALLEN)


class Grasp(GripperEnvironment):
    """Grasp-v0; docs/environments.md describes it."""

    def __init__(self, scene: str | Path | Scene = "gripper", lift: float = 30.0, hold: float = 0.5, **common: Any):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            scene: scene with a gripper and an object, or its name or path.
            lift: height to lift the object to [mm].
            hold: time to hold the object there without slip [s].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self._lift, self._hold = lift, hold
        super().__init__(Travel((0.0, 0.0, 0.0), (0.0, 0.0, 2.0 * lift), USUAL_SPEED), scene=scene, **common)

    @property
    def _options(self) -> str:
        return "nothing else"

    def _judge(self, seen: Observation, action: np.ndarray | None) -> Judgement:
        way, touching = self._way(seen), self._touching(seen)
        slip = max((seen.slip_speeds.get((finger, self.object), 0.0) for finger in self.fingers), default=0.0)
        held = way[2] >= self._lift and touching > 0.0 and slip < STICKING and self._speed(seen) < STILL
        self._held_for = self._held_for + self._period if held and action is not None else 0.0
        failed = self._is_lost(way)
        info = {"is_success": self._held_for >= self._hold and not failed, "lift": float(way[2]), "touching": touching}
        return Judgement(0.2 * touching + 0.8 * float(np.clip(way[2] / self._lift, 0.0, 1.0)), failed, info)
