"""Carry-v0: a gripper carries an object to another place on the floor and releases it."""

from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.state import State
from taichisoft_gym.actuation import Travel
from taichisoft_gym.arguments import numbers, positive
from taichisoft_gym.channels import symmetric
from taichisoft_gym.grasp import STILL, GripperEnvironment

PLACED = 2.0
"""Height over the floor up to which an object stands on it [mm]."""
LIFTED = 1.0
"""Height over the start from which an object no longer drags along the floor [mm]."""


class Carry(GripperEnvironment):
    """Carry-v0; docs/environments.md describes it."""

    observations = (*GripperEnvironment.observations, "way to the target")
    goal_channels = symmetric("object", "mm", 200.0, ("right", "front"))
    goal_options = ("target",)

    def __init__(
        self,
        distance: tuple[float, float] = (20.0, 50.0),
        tolerance: float = 5.0,
        longest_drag: float = 10.0,
        **common: Any,
    ):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            distance: shortest and longest horizontal distance to the target [mm], in any direction.
            tolerance: distance to the target within which the object has arrived [mm].
            longest_drag: way on the floor after which the object is pushed and not carried, and the task has failed
                [mm].
            common: see above; the scene has a gripper and an object.

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self._distance = distances(distance)
        self.tolerance = positive("tolerance", tolerance)
        self._longest_drag = positive("longest_drag", longest_drag)
        reach = self._distance[1] + 20.0
        self.travel = Travel((-reach, -reach, 0.0), (reach, reach, 60.0))
        super().__init__(**common)

    def begin(self, start: State, options: dict[str, Any]) -> None:
        """Draw a target, or take that of the option "target"."""
        target = options.pop("target", None)
        if target is None:
            shortest, longest = self._distance
            longest = shortest + self.difficulty * (longest - shortest)
            distance, angle = self.np_random.uniform(shortest, longest), self.np_random.uniform(0.0, 2.0 * np.pi)
            target = distance * np.array([np.cos(angle), np.sin(angle)])
        self.desired_goal = numbers(target)
        if self.desired_goal.shape != (2,) or not np.isfinite(self.desired_goal).all() or not self.desired_goal.any():
            raise SceneError(
                f"options['target'] = {target!r}: must be a way to the right and to the front [mm], not zero"
            )
        self._way, self._dragged = np.zeros(3), 0.0

    def update(self, seen: Observation) -> None:
        """Measure how far the object has gone on the floor."""
        before, self._way = self._way, self.way_of_object(seen)
        if max(before[2], self._way[2]) < LIFTED:
            self._dragged += float(np.linalg.norm((self._way - before)[:2]))

    def terminated(self, seen: Observation) -> bool:
        """Whether the object is lost, or was dragged."""
        return super().terminated(seen) or self._dragged > self._longest_drag

    def achieved_goal(self, seen: Observation) -> np.ndarray:
        """Displacement of the object to the right and to the front [mm], shape (2,)."""
        return self.way_of_object(seen)[:2]

    def reward(self, seen: Observation) -> float:
        """Grip, progress, and 1 once it is placed."""
        left, touching = self._left(seen), self.touching(seen)
        progress = float(np.clip(1.0 - left / np.linalg.norm(self.desired_goal), -1.0, 1.0))
        # After arrival, releasing is worth more than holding, so that the policy does not hold the object for ever.
        grip = 1.0 - touching if left < self.tolerance else touching
        return 0.2 * grip + 0.8 * progress + float(self._placed(seen))

    def information(self, seen: Observation) -> dict[str, Any]:
        """Success, distance, lift and way on the floor [mm], and the share of fingers that touch."""
        return {
            "is_success": self._placed(seen) and not self.terminated(seen),
            "distance": self._left(seen),
            "lift": float(self.way_of_object(seen)[2]),
            "dragged": self._dragged,
            "touching": self.touching(seen),
        }

    def marks(self) -> np.ndarray:
        """The target."""
        place: np.ndarray = self.start_of_object + self.desired_goal @ self.axes[:2]
        return place[None]

    def _left(self, seen: Observation) -> float:
        return float(np.linalg.norm(self.desired_goal - self.achieved_goal(seen)))

    def _placed(self, seen: Observation) -> bool:
        is_down = self.way_of_object(seen)[2] < PLACED and self.touching(seen) == 0.0
        return bool(self._left(seen) < self.tolerance and is_down and self.speed(seen) < STILL)


def distances(given: Any) -> tuple[float, float]:
    """Shortest and longest distance of a target [mm].

    Raises:
        SceneError: they are none.
    """
    both = numbers(given)
    if both.shape != (2,) or not 0.0 < both[0] <= both[1] < np.inf:
        raise SceneError(f"distance = {given!r}: must be a shortest and a longest distance [mm], above 0")
    return float(both[0]), float(both[1])
