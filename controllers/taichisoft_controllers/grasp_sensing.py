"""Settings of the grasping controller, and the grasp as it is felt and seen in an observation."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft.mechanics import CAVITIES, Drive, kind_of
from taichisoft.scene import NotNegative, Positive
from taichisoft_controllers.model_names import actuators_called, fingers_called, object_called
from taichisoft_controllers.settings import PRESSURE, PULL, ControllerSettings, driven_by, read_drive

if TYPE_CHECKING:
    from taichisoft.contact import Model

# The tuning of the controller "closed-loop": docs/notes/experiments.md says how the gains were found.


class GraspSettings(ControllerSettings):
    """Settings of the controller "closed-loop"."""

    set_point: Positive = 800.0
    """Sum of the normal forces of the fingers on the object, to begin with [mN]."""
    margin: Annotated[float, Field(strict=True, gt=1)] = 1.7
    """Factor over the force at which the object slips, to which the set point is then raised [-]."""
    slip_speed: Positive = 1.0
    """Speed of the lifted object on the fingers, mean weighted by force, from which it slips [mm/s]."""
    highest_pressure: Positive = 105.0
    """Highest pressure that is asked for, if the scene's limit is not lower [kPa]."""
    approach_rate: Positive = 30.0
    """Rate of the pressure until all fingers touch, and when they open [kPa/s]."""
    touch_force: Positive = 5.0
    """Normal force from which a finger counts as touching [mN]."""
    proportional_gain: NotNegative = 0.005
    """Proportional gain of the force regulator [kPa/mN]."""
    integral_gain: Positive = 0.16
    """Integral gain of the force regulator [kPa/(mN s)]."""
    tracking_time: Positive = 0.03
    """Time constant with which the regulator's integral is led back to what was applied [s]."""
    pressure_rate: Positive = 60.0
    """Fastest change of the pressure that the force regulator asks for, up or down [kPa/s]."""
    highest_pull: Positive = 15.0
    """Farthest that cables are pulled in, where there are no cavities, if their stops are not nearer [mm]."""
    pull_approach_speed: Positive = 4.0
    """Speed of the cables until all fingers touch, and when they open [mm/s]."""
    pull_proportional_gain: NotNegative = 0.00012
    """Proportional gain of the force regulator that pulls cables [mm/mN]."""
    pull_integral_gain: Positive = 0.004
    """Integral gain of the force regulator that pulls cables [mm/(mN s)]."""
    pull_speed: Positive = 1.5
    """Fastest motion of the cables that the force regulator asks for, in or out [mm/s]."""
    lift: Positive = 30.0
    """Height by which the base rises [mm]."""
    lift_time: Positive = 2.0
    """Lift duration while nothing slips [s]."""
    hold: Positive = 2.0
    """Duration for which the object must keep its place between the fingers to count as held [s]."""
    stillness: Positive = 1.0
    """Largest motion of an object that keeps its place [mm]."""
    longest_slip: Positive = 20.0
    """Height by which an object may sink between the fingers before it is given up as dropped [mm]."""
    patience: Positive = 15.0
    """Duration after which a grip, a lift or a hold has failed [s]."""
    grasps: Annotated[int, Field(strict=True, gt=0)] = 1
    """Number of grasps: between two it puts the object down and opens, and after the last it goes on holding."""


# The grasp of an object as it is felt and seen in an observation.

SLIDING = 0.95
"""Share of the largest friction over normal force that was seen, from which a finger slides as a whole [-]."""


@dataclass(frozen=True)
class SensedGrasp:
    """The object between the fingers, as it is sensed.

    Attributes:
        time: time of the observation [s].
        applied: mean pressure of the cavities [kPa], or mean pull of the cables [mm], as it was applied.
        force: sum of the normal forces of the fingers on the object [mN].
        missing: fingers that do not touch the object.
        slip_speed: sliding speed of the fingers on the object, mean weighted by their forces [mm/s]; a finger counts
            when it slides as a whole, not when it rolls or sways and slides at an edge.
        base_held_back: whether the scene's limits keep the base from where it was asked to be.
        offset: height of the object's centre of mass less that of the base [mm]; falls when the object slips out.
        object_speed: speed of the object's centre of mass [mm/s].
    """

    time: float
    applied: float
    force: float
    missing: tuple[str, ...]
    slip_speed: float
    base_held_back: bool
    offset: float
    object_speed: float


class GraspSensing:
    """Takes from observations what matters for a grasp of the goal's object; knows neither its mass nor the friction.

    Attributes:
        object: name of the rigid body.
        actuators: names of all cavities, or of all cables.
        up: unit vector against gravity, shape (3,).
    """

    def __init__(self, model: "Model", drive: Drive, touch_force: float):
        """Look up names and the direction of gravity.

        Args:
            model: the model of the run.
            drive: the way in which its actuators are driven.
            touch_force: normal force from which a finger counts as touching [mN].
        """
        if not any(model.scene.gravity):
            raise SceneError("gravity = [0, 0, 0]: the controller 'closed-loop' lifts against it; give it a direction")
        self.object = object_called(None, model)
        self.actuators = actuators_called(None, driven_by(drive, model), kind_of(drive).name)
        self._drive = drive
        cavities = model.scene.actuators(CAVITIES.plural) if drive is PRESSURE else {}
        self._behind_line = {name for name, cavity in cavities.items() if cavity.line is not None}
        self.up = model.scene.up
        self._pairs = {finger: (finger, self.object) for finger in fingers_called(None, model)}
        self._most_used = dict.fromkeys(self._pairs, 0.0)
        self._touch_force = touch_force

    def sense(self, observation: Observation, asked: float) -> SensedGrasp:
        """The grasp in an observation; `asked` is what was asked of the actuators before [kPa] or [mm]."""
        # Bodies that are far apart are not in an observation: nothing presses, nothing slides.
        forces = {finger: observation.normal_forces.get(pair, 0.0) for finger, pair in self._pairs.items()}
        touching = [finger for finger, force in forces.items() if force >= self._touch_force]
        sliding = sum(forces[finger] * self._slip_speed(finger, observation) for finger in touching)
        base_height = float(observation.base_translation @ self.up)
        return SensedGrasp(
            time=observation.time,
            applied=sum(self._applied(name, observation, asked) for name in self.actuators) / len(self.actuators),
            force=sum(forces.values()),
            missing=tuple(finger for finger in self._pairs if finger not in touching),
            slip_speed=sliding / sum(forces.values()) if touching else 0.0,
            base_held_back="base_translation" in observation.clipped,
            offset=float(observation.object_positions[self.object] @ self.up) - base_height,
            object_speed=float(np.linalg.norm(observation.object_velocities[self.object])),
        )

    def save(self) -> dict[str, float]:
        """The largest friction over normal force that each finger has shown [-]."""
        return dict(self._most_used)

    def restore(self, saved: Mapping[str, float]) -> None:
        """Go on with what the fingers have shown before."""
        self._most_used.update(saved)

    def _applied(self, actuator: str, observation: Observation, asked: float) -> float:
        """What an actuator was driven with; a slack cable is paid out as was asked, wherever its finger may stick.

        Behind an air line that is the pressure that its regulator was driven for, not that in the cavity, which follows
        later: from there, a rate would begin again and again.
        """
        if actuator in self._behind_line:
            return observation.pressure_targets[actuator]
        is_slack = self._drive is PULL and observation.cable_tensions[actuator] <= 0.0
        return asked if is_slack else read_drive(self._drive, observation, actuator)

    def _slip_speed(self, finger: str, observation: Observation) -> float:
        """Speed of a finger that slides as a whole [mm/s], else 0.

        Friction over normal force is largest where all contacts slide; each finger does as it closes on the object.
        """
        pair = self._pairs[finger]
        used = observation.friction_forces[pair] / observation.normal_forces[pair]
        self._most_used[finger] = max(self._most_used[finger], used)
        return observation.slip_speeds[pair] if used > SLIDING * self._most_used[finger] else 0.0
