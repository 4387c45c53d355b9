"""Reach-v0: a fingertip moves to a target and stays there."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.scenes import Scene
from taichisoft.state import State
from taichisoft_gym.actuation import AXES, Actuation
from taichisoft_gym.channels import ChannelGroup, symmetric
from taichisoft_gym.environment import SETTLING_TIME, SoftRobotEnvironment
from taichisoft_gym.task import Judgement

LARGEST = 0.8
"""Targets are rest positions of the tip up to this share of the range, so that a stiffer finger reaches them."""
ALONG_ONE, AT_RANDOM = 17, 48
"""Number of actuations at which the tip is measured: along the range of one actuator, or random for several."""
REST = 0.3
"""Settling time of the tip at each actuation [s]."""


class Reach(SoftRobotEnvironment):
    """Reach-v0; docs/environments.md describes it."""

    usual_pressure = (0.0, 60.0)

    def __init__(
        self,
        scene: str | Path | Scene = "finger-inflated",
        pressure: tuple[float, float] | None = None,
        tolerance: float = 3.0,
        **common: Any,
    ):
        """Make the environment; `common` are the arguments of `SoftRobotEnvironment`.

        Args:
            scene: scene, or its name or path; its first finger reaches.
            pressure: pressures of the actions -1 and 1 [kPa]; None: 0 to 60 within the scene's limits.
            tolerance: distance within which the target is reached [mm].

        Raises:
            SceneError: the scene or an argument is not valid.
        """
        self._tolerance = tolerance
        super().__init__(None, scene=scene, pressure=pressure, **common)

    @property
    def finger(self) -> str:
        """Name of the finger that reaches: the first with anchors.

        Raises:
            SceneError: no soft body has anchors.
        """
        if self.fingers:
            return self.fingers[0]
        raise SceneError("this needs a scene with a soft body that has anchors")

    def _observed(self) -> Sequence[ChannelGroup]:
        self._target = np.zeros(3)
        finger, axes = self.finger, self._axes
        return [
            ChannelGroup(self._actuation.actuator_channels, self._actuation.read),
            ChannelGroup(symmetric("tip", "mm", 200.0, AXES), lambda seen: axes @ seen.tip_positions[finger]),
            ChannelGroup(
                symmetric("tip velocity", "mm/s", 1000.0, AXES), lambda seen: axes @ seen.tip_velocities[finger]
            ),
            ChannelGroup(
                symmetric("way to the target", "mm", 100.0, AXES),
                lambda seen: axes @ (self._target - seen.tip_positions[finger]),
            ),
        ]

    def _begin_task(self, start: State, options: dict[str, Any]) -> None:
        target = options.pop("target", None)
        if target is None:
            low, high = self._actuation.actuator_channels[0].low, self._actuation.actuator_channels[0].high
            places = tip_places(self._scene_text, self.finger, low, high)
            share = self.np_random.uniform()
            if len(self._actuation.channels) == 1:
                along = np.linspace(0.0, 1.0, len(places))
                target = [np.interp(share, along, places[:, axis]) for axis in range(3)]
            else:
                target = places[int(share * len(places))]
        self._target = self._numbers(target)
        if self._target.shape != (3,) or not np.isfinite(self._target).all():
            raise SceneError(f"options['target'] = {target!r}: must be a point [mm], three finite numbers")
        self._last_action: np.ndarray | None = None

    def _marks(self) -> np.ndarray:
        return self._target[None]

    def _judge(self, seen: Observation, action: np.ndarray | None) -> Judgement:
        distance = float(np.linalg.norm(self._target - seen.tip_positions[self.finger]))
        change = 0.0
        if action is not None and self._last_action is not None:
            change = float(np.abs(action - self._last_action).mean())
        self._last_action = action
        info = {"is_success": distance < self._tolerance, "distance": distance, "target": self._target.copy()}
        return Judgement(-0.1 * distance - 0.1 * change, False, info)


@lru_cache(maxsize=8)
def tip_places(scene: str, finger: str, low: float, high: float) -> np.ndarray:
    """Rest positions of the tip for actuations from the lowest to LARGEST of the range [mm], shape (count, 3).

    Args:
        scene: the scene as TOML.
        finger: name of the finger.
        low, high: range of the first actuator, as a key of the cache.
    """
    from taichisoft.building import Simulation
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
        control = actuation.control(2.0 * share - 1.0, simulation.state, REST)
        for _ in range(round(REST / model.scene.time.step)):
            simulation.step(control)
        places.append(simulation.observe().tip_positions[finger])
    return np.array(places)
