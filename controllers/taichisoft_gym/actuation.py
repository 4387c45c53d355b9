"""Actions: pressures of cavities and regulators, valves, pulls of cables, and velocities of the base."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft import Scene
from taichisoft.base import right_of
from taichisoft.control import Control, Observation
from taichisoft.errors import SceneError, nearest
from taichisoft.mechanics import ACTUATOR_KINDS, CAVITIES, ActuatorKind, Drive, State, network_drives
from taichisoft_gym.channels import Channel, numbers

if TYPE_CHECKING:
    from taichisoft.running import Simulation

# Joints of an arm as actions: the base of the gripper goes where they bring it.


@dataclass(frozen=True)
class ArmTravel:
    """Motion of the base by the arm of the scene's controller "arm"; each joint is an action.

    Attributes:
        share: of a joint's highest speed, which the actions -1 and 1 stand for, above 0 and up to 1.
    """

    share: float = 1.0


class ArmMotion:
    """The joints of a scene's arm, and the velocities of the base that they make.

    Attributes:
        channels: of the joints' speeds at the actions -1 and 1.
        positions: of the joints themselves.
    """

    def __init__(self, scene: Scene, travel: ArmTravel):
        """Read the arm."""
        from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm

        if scene.controller is None or scene.controller.name != "arm":
            raise SceneError('travel = ArmTravel(): needs a scene whose controller is "arm", with the settings of one')
        if not 0.0 < travel.share <= 1.0:
            raise SceneError(f"ArmTravel(share={travel.share:g}): must be above 0 and at most 1")
        settings = {key: value for key, value in scene.controller.settings.items() if key in ArmPlacement.model_fields}
        self._arm = MountedArm(ArmPlacement.model_validate(settings))
        self._values, self._links = self._arm.start, [name for name in self._arm.frame_names() if name in scene.frames]
        joints, self._fastest = self._arm.chain.joints, travel.share * self._arm.chain.speed
        units = ["mm" if joint.slides else "rad" for joint in joints]
        self.channels = tuple(
            Channel(f"speed of {joint.name}", f"{unit}/s", -speed, speed)
            for joint, unit, speed in zip(joints, units, self._fastest.tolist(), strict=True)
        )
        ends = np.clip([self._arm.chain.lowest, self._arm.chain.highest], -1e3, 1e3).T
        self.positions = tuple(
            Channel(f"joint {joint.name}", unit, *end)
            for joint, unit, end in zip(joints, units, ends.tolist(), strict=True)
        )

    def values(self, translation: np.ndarray, rotation: np.ndarray, pivot: np.ndarray) -> np.ndarray:
        """The joints that have brought the base to a pose: those of the last call if they have, else the nearest.

        Args:
            translation: of the base [mm], shape (3,).
            rotation: its rotation vector [rad], shape (3,).
            pivot: the base's pivot [mm], shape (3,).
        """
        from taichisoft_arm.kinematics import solve
        from taichisoft_arm.mounted_arm import motion_of_base

        motion = motion_of_base(translation, rotation, pivot)
        if not np.allclose(self._arm.motions(self._values)[-1], motion, rtol=0.0, atol=1e-7):
            found = solve(self._arm.chain, self._arm.link_pose(motion), self._values)
            if found is None:
                raise SceneError("the base is where the arm cannot bring it; begin at a state that it can reach")
            self._values = found
        return self._values

    def control(self, speeds: np.ndarray, state: State, pivot: np.ndarray, period: float) -> dict[str, Any]:
        """Arguments of the `Control` that moves base and links for a period [s]; joints end at their limits.

        Args:
            speeds: of the joints [rad/s], [mm/s], shape (joint_count,).
            state: at the start of the period.
            pivot: the base's pivot [mm], shape (3,).
            period: control period [s].
        """
        chain = self._arm.chain
        before = self.values(state.base_translation, state.base_rotation, pivot)
        after = np.clip(before + period * speeds, chain.lowest, chain.highest)
        self._values = after
        now, then = (self._arm.control(values, pivot, self._links) for values in (before, after))
        asked: dict[str, Any] = {
            "base_velocity": (then["base_translation"] - state.base_translation) / period,
            "base_angular_velocity": _turning(state.base_rotation, then["base_rotation"]) / period,
        }
        if self._links:
            names = self._links
            way = {name: then["frame_translation"][name] - now["frame_translation"][name] for name in names}
            turn = {name: _turning(now["frame_rotation"][name], then["frame_rotation"][name]) for name in names}
            asked["frame_velocity"] = {name: way[name] / period for name in names}
            asked["frame_angular_velocity"] = {name: turn[name] / period for name in names}
        return asked


def _turning(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation vector that turns one rotation vector into another [rad]."""
    from scipy.spatial.transform import Rotation  # a tenth of a start, for arms alone

    first, last = (Rotation.from_rotvec(np.array(one)) for one in (before, after))  # SciPy takes no read-only arrays
    vector: np.ndarray = (last * first.inv()).as_rotvec()
    return vector


AXES = ("right", "front", "up")
"""Directions of base, object and targets, as in pictures: up is against gravity."""
USUAL_PULL = 20.0
"""Longest pull of a cable without a stop [mm]."""
USUAL_SPEED = 100.0
"""Highest speed of the base, unless the scene's limit is lower [mm/s]."""


def scene_axes(scene: Scene) -> np.ndarray:
    """Unit vectors right, front and up of a scene as rows, shape (3, 3)."""
    right = right_of(scene.up)
    return np.array([right, np.cross(right, scene.up), scene.up])


@dataclass(frozen=True)
class Travel:
    """Range of the base.

    Attributes:
        low, high: ends of its way from the start in the directions of AXES [mm].
        speed: its speed [mm/s].
        turn: largest angle about the direction up, either way [rad].
        turning_speed: angular speed [rad/s].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    speed: float = USUAL_SPEED
    turn: float = 0.0
    turning_speed: float = 1.0

    def __post_init__(self) -> None:
        """Check the range."""
        low, high = numbers(self.low), numbers(self.high)
        if low.shape != (3,) or high.shape != (3,) or not (low <= high).all() or not np.isfinite(high - low).all():
            raise SceneError(f"travel: low = {self.low} and high = {self.high} must be 3 numbers each, low below high")
        if not (self.speed > 0.0 and self.turn >= 0.0 and self.turning_speed > 0.0):
            raise SceneError("travel: speed and turning_speed must be above 0, and turn must not be negative")


class Actuation:
    """Converts actions, numbers from -1 to 1, to requests.

    Attributes:
        channels: name, unit, and values at -1 and 1 of each number.
        arm: what moves the base by joints; None without.
    """

    def __init__(
        self,
        scene: Scene,
        pressure: tuple[float, float],
        travel: Travel | ArmTravel | None,
        drives: Sequence[str] = (),
    ):
        """Find the actuators.

        Args:
            scene: scene with actuators.
            pressure: lowest and highest pressure [kPa].
            travel: range of the base, or the joints of its arm; None: the base stands still.
            drives: keys of `Control` that actions ask for, such as "cable_tension"; an actuator is driven by the first
                of them that fits it, and by none if none does. Empty: the usual one of each.
        """
        valid = [drive.request for kind in ACTUATOR_KINDS for drive in kind.drives]
        for one in drives:
            if one not in valid:
                raise SceneError(f"actions: there is no '{one}'; {nearest(one, valid, 'there are')}")
        tables = [(kind, *one) for kind in ACTUATOR_KINDS for one in scene.actuators(kind.plural).items()]
        # The first way to drive an actuator; sealed air has none.
        self._driven = [
            (drive, name, table)
            for kind, name, table in tables
            for drive in [one for one in _ranked(kind, drives) if one.fits(table)][:1]
        ]
        self._readers = [(attrgetter(drive.observed), name) for drive, name, _ in self._driven]
        network = [
            (drive, name, scene.air.valves.get(name, scene.air.sources.get(name)))
            for name, drive in network_drives(scene.air).items()
            if not drives or drive.request in drives
        ]
        self._readers += [(attrgetter(drive.elsewhere), name) for drive, name, _ in network]
        self._driven += network
        idle = next((one for one in drives if all(drive.request != one for drive, *_ in self._driven)), None)
        if self._driven and idle is not None:
            raise SceneError(f"actions: no actuator of the scene is driven by '{idle}'")
        if not self._driven:
            raise SceneError("an environment needs a soft body with a cavity or a cable; the scene has none")
        self.cavities = tuple(scene.actuators(CAVITIES.plural))
        self.arm = ArmMotion(scene, travel) if isinstance(travel, ArmTravel) else None
        travel = travel if isinstance(travel, Travel) else None
        self._axes, self._travel = scene_axes(scene), travel
        channels = [
            Channel(f"{drive.name} {name}", drive.unit, *_range(drive, table, pressure))
            for drive, name, table in self._driven
        ]
        self.actuator_channels = tuple(channels)
        self._moves = [axis for axis in range(3) if travel is not None and travel.low[axis] < travel.high[axis]]
        if travel is not None:
            speed = min(travel.speed, math.inf if scene.limits.base_speed is None else scene.limits.base_speed)
            channels += [Channel(f"base velocity {AXES[axis]}", "mm/s", -speed, speed) for axis in self._moves]
            if travel.turn:
                limit = scene.limits.base_turning_speed
                fastest = min(travel.turning_speed, math.inf if limit is None else math.radians(limit))
                channels.append(Channel("base turning speed", "rad/s", -fastest, fastest))
        if self.arm is not None:
            channels += self.arm.channels
        self.channels = tuple(channels)
        self._low, self._high = (np.array([getattr(one, end) for one in channels]) for end in ("low", "high"))

    def control(self, action: np.ndarray, simulation: "Simulation", period: float) -> Control:
        """Request of an action for the control period `period` [s] that begins now."""
        state = simulation.state
        values = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        asked: dict[str, Any] = {}
        for (drive, name, _), value in zip(self._driven, values.tolist(), strict=False):
            asked.setdefault(drive.request, {})[name] = value
        if self.arm is not None:
            asked |= self.arm.control(values[len(self._driven) :], state, simulation.model.base_pivot, period)
        if self._travel is not None:
            velocity = np.zeros(3)
            velocity[self._moves] = values[len(self._driven) :][: len(self._moves)]
            place = self._axes @ state.base_translation
            reached = np.minimum(np.maximum(place + period * velocity, self._travel.low), self._travel.high)
            asked["base_velocity"] = (reached - place) / period @ self._axes
            if self._travel.turn:
                up, furthest = self._axes[2], self._travel.turn
                angle = float(up @ state.base_rotation)
                asked["base_angular_velocity"] = (
                    (np.clip(angle + period * values[-1], -furthest, furthest) - angle) / period * up
                )
        return Control(**asked)

    def read(self, seen: Observation) -> list[float]:
        """What the actuators are driven by in an observation, in the order of `actuator_channels`."""
        return [values_of(seen)[name] for values_of, name in self._readers]


def _ranked(kind: ActuatorKind, drives: Sequence[str]) -> list[Drive]:
    """The drives of a kind that are asked for, in that order; all if none is named."""
    return [one for name in drives for one in kind.drives if one.request == name] if drives else list(kind.drives)


def _range(drive: Drive, table: Any, pressure: tuple[float, float]) -> tuple[float, float]:
    """The given pressures; of other drives from their lowest to the highest value that an actuator's table allows."""
    if drive is CAVITIES.effort:
        return pressure
    usual = USUAL_PULL if drive.relative else drive.furthest
    is_two_way = getattr(table, "exhaust", 0.0) is None  # a valve of a network that only opens
    return 0.0 if is_two_way else drive.nearest, getattr(table, f"highest_{drive.name}", None) or usual
