"""Grasp-v0: a gripper closes on an object, lifts it and holds it."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from taichisoft.control import Observation
from taichisoft.state import State
from taichisoft_gym.actuation import Travel
from taichisoft_gym.arguments import positive
from taichisoft_gym.environment import Quantity, SoftRobotEnvironment

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

    travel: Travel
    observations: ClassVar[Sequence[Quantity]] = ("actuators", "base", "object", "object velocity")

    def touching(self, seen: Observation) -> float:
        """Share of the fingers that press the object [-]."""
        return float(np.mean([seen.normal_forces.get((finger, self.object), 0.0) > 0.0 for finger in self.fingers]))

    def speed(self, seen: Observation) -> float:
        """Speed of the object [mm/s]."""
        return float(np.linalg.norm(seen.object_velocities[self.object]))

    def terminated(self, seen: Observation) -> bool:
        """Whether the object is lost."""
        way, reach = self.way_of_object(seen), max(map(abs, (*self.travel.low[:2], *self.travel.high[:2])))
        return bool(np.linalg.norm(way[:2]) > reach + LOST or way[2] < FALLEN)


class Grasp(GripperEnvironment):
    """Grasp-v0; docs/environments.md describes it."""

    def __init__(self, lift: float = 30.0, hold: float = 0.5, **common: Any):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            lift: height to lift the object to [mm].
            hold: time to hold the object there without slip [s].
            common: see above; the scene has a gripper and an object.

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self._lift, self._hold = positive("lift", lift), positive("hold", hold)
        self.travel = Travel((0.0, 0.0, 0.0), (0.0, 0.0, 2.0 * self._lift))
        super().__init__(**common)

    def begin(self, start: State, options: dict[str, Any]) -> None:
        """Nothing has been held yet."""
        self._held_for = 0.0

    def update(self, seen: Observation) -> None:
        """Count for how long the object has been held."""
        slip = max((seen.slip_speeds.get((finger, self.object), 0.0) for finger in self.fingers), default=0.0)
        is_up = self.way_of_object(seen)[2] >= self._lift
        held = is_up and self.touching(seen) > 0.0 and slip < STICKING and self.speed(seen) < STILL
        self._held_for = self._held_for + self.control_period if held else 0.0

    def reward(self, seen: Observation) -> float:
        """Touching, and more for lifting."""
        return 0.2 * self.touching(seen) + 0.8 * float(np.clip(self.way_of_object(seen)[2] / self._lift, 0.0, 1.0))

    def information(self, seen: Observation) -> dict[str, Any]:
        """Success, lift [mm] and the share of fingers that touch."""
        success = self._held_for >= self._hold and not self.terminated(seen)
        lift = float(self.way_of_object(seen)[2])
        return {"is_success": success, "lift": lift, "touching": self.touching(seen)}
