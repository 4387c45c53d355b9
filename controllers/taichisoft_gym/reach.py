"""Reach-v0: a fingertip moves to a target and stays there."""

from functools import lru_cache
from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.scenes import scene_to_toml
from taichisoft.state import State
from taichisoft_gym.actuation import AXES, Actuation
from taichisoft_gym.arguments import numbers, positive
from taichisoft_gym.channels import symmetric
from taichisoft_gym.environment import SoftRobotEnvironment

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
    from taichisoft.building import Simulation
    from taichisoft_gym.episode_start import SETTLING_TIME
    from taichisoft_gym.prepared import prepared

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
