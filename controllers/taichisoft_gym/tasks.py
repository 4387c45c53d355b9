"""The tasks that come with taichisoft: Grasp-v0, Reach-v0 and Carry-v0."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.mechanics import State
from taichisoft.scene import scene_to_toml
from taichisoft_gym.actuation import AXES, Actuation, Travel
from taichisoft_gym.channels import numbers, positive, symmetric
from taichisoft_gym.environment import SoftRobotEnvironment
from taichisoft_gym.observed_quantities import Quantity

# Reach-v0: a fingertip moves to a target and stays there.

LARGEST = 0.8
"""Targets are rest positions of the tip up to this share of the range, so that a stiffer finger reaches them."""
ALONG_ONE, AT_RANDOM = 17, 48
"""Number of actuations at which the tip is measured: along the range of one actuator, or random for several."""
REST = 0.3
"""Settling time of the tip at each actuation [s]."""


class Reach(SoftRobotEnvironment):
    """Reach-v0; docs/environments.md describes it."""

    usual_scene = "finger-inflated"
    usual_pressure = (0.0, 60.0)
    observations = ("actuators", "tip", "tip velocity", "way to the target")
    goal_channels = symmetric("tip", "mm", 200.0, AXES)
    goal_reach = 100.0
    goal_options = ("target",)

    def __init__(self, tolerance: float = 3.0, **common: Any):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            tolerance: distance within which the target is reached [mm].
            common: see above; the first finger of the scene reaches.

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self.tolerance = positive("tolerance", tolerance)
        super().__init__(**common)

    def begin(self, start: State, options: dict[str, Any]) -> None:
        """Draw a target where the tip has been, or take that of the option "target"."""
        target = options.pop("target", None)
        if target is None:
            places = self.tip_places()
            share = self.difficulty * self.np_random.uniform()
            if len(self.action_channels) == 1:
                along = np.linspace(0.0, 1.0, len(places))
                target = [np.interp(share, along, places[:, axis]) for axis in range(3)]
            else:
                target = places[int(share * len(places))]
        self.target = numbers(target)
        if self.target.shape != (3,) or not np.isfinite(self.target).all():
            raise SceneError(f"options['target'] = {target!r}: must be a point [mm], three finite numbers")
        self.desired_goal = self.axes @ self.target

    def achieved_goal(self, seen: Observation) -> np.ndarray:
        """The tip's position: right, front and up [mm], shape (3,)."""
        place: np.ndarray = self.axes @ seen.tip_positions[self.finger]
        return place

    def reward(self, seen: Observation) -> float:
        """Distance and changes of the action cost."""
        distance = float(np.linalg.norm(self.desired_goal - self.achieved_goal(seen)))
        return -0.1 * distance - 0.1 * self.action_change

    def information(self, seen: Observation) -> dict[str, Any]:
        """Success, distance [mm] and the target [mm]."""
        return {**super().information(seen), "target": self.target.copy()}

    def marks(self) -> np.ndarray:
        """The target."""
        return self.target[None]

    def tip_places(self) -> np.ndarray:
        """Rest positions of the tip for rising actuations [mm], shape (count, 3), see `tip_places`."""
        first = self.actuation.actuator_channels[0]
        return tip_places(scene_to_toml(self.scene), self.finger, first.low, first.high)


@lru_cache(maxsize=8)
def tip_places(scene: str, finger: str, low: float, high: float) -> np.ndarray:
    """Rest positions of the tip for actuations from the lowest to LARGEST of the range [mm], shape (count, 3).

    Args:
        scene: the scene as TOML.
        finger: name of the finger.
        low, high: range of the first actuator, as a key of the cache.
    """
    from taichisoft.running import Simulation
    from taichisoft_gym.episode_start import SETTLING_TIME, prepared

    model, start = prepared(scene, SETTLING_TIME)
    simulation = Simulation(model)
    simulation.restore(start)
    actuation = Actuation(model.scene, (low, high), None)
    count = len(actuation.channels)
    shares = np.linspace(0.0, LARGEST, ALONG_ONE)[:, None]
    if count > 1:
        shares = LARGEST * np.random.default_rng(0).uniform(size=(AT_RANDOM, count))
    places = []
    for share in shares:
        control = actuation.control(2.0 * share - 1.0, simulation, REST)
        for _ in range(round(REST / model.scene.time.step)):
            simulation.step(control)
        places.append(simulation.observe().truth.tip_positions[finger])
    return np.array(places)


# Grasp-v0: a gripper closes on an object, lifts it and holds it.

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
        forces, fingers = seen.normal_forces, self.fingers
        return sum(forces.get((finger, self.object), 0.0) > 0.0 for finger in fingers) / max(len(fingers), 1)

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
        is_up = self._lift_of(seen) >= self._lift
        held = is_up and self.touching(seen) > 0.0 and slip < STICKING and self.speed(seen) < STILL
        self._held_for = self._held_for + self.control_period if held else 0.0

    def reward(self, seen: Observation) -> float:
        """Touching, and more for lifting."""
        return 0.2 * self.touching(seen) + 0.8 * min(max(self._lift_of(seen) / self._lift, 0.0), 1.0)

    def information(self, seen: Observation) -> dict[str, Any]:
        """Success, lift [mm] and the share of fingers that touch."""
        success = self._held_for >= self._hold and not self.terminated(seen)
        return {"is_success": success, "lift": self._lift_of(seen), "touching": self.touching(seen)}

    def _lift_of(self, seen: Observation) -> float:
        return float(self.way_of_object(seen)[2])


# Carry-v0: a gripper carries an object to another place on the floor and releases it.

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
        progress = min(max(1.0 - left / float(np.linalg.norm(self.desired_goal)), -1.0), 1.0)
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
    """Shortest and longest distance of a target [mm]."""
    both = numbers(given)
    if both.shape != (2,) or not 0.0 < both[0] <= both[1] < np.inf:
        raise SceneError(f"distance = {given!r}: must be a shortest and a longest distance [mm], above 0")
    return float(both[0]), float(both[1])
