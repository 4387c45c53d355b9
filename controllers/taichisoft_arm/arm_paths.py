"""Paths of an arm's joints, and how fast they are gone: all joints begin and end together, with trapezoidal speeds."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft.errors import ControllerFailed
from taichisoft_arm.kinematics import pose_of, solve, solve_near
from taichisoft_arm.mounted_arm import MountedArm

STRAIGHT_STEP = (2.0, math.radians(1.0))
"""Way [mm] and turn [rad] between two places of a straight way at which the joints are worked out beforehand."""
SAMPLES = 64
LEAP = math.radians(10.0)
"""Turn of a joint between two such places over which the way leads through a singularity."""
MARGIN = 0.99
"""Share of a limit that is used: rates may be largest between two samples."""


@dataclass(frozen=True)
class TrapezoidalProfile:
    """The share of a way that is gone: faster and faster, at a constant rate, and slower until it arrives at rest.

    Attributes:
        rate: highest rate [1/s]; it is not reached on a short way.
        ramp: time in which the rate rises from 0 to `rate` [s].
    """

    rate: float
    ramp: float

    @property
    def _ramp(self) -> float:
        """Time for which the rate rises [s]: that in which half of the way is gone, where this is less."""
        return min(self.ramp, math.sqrt(self.ramp / self.rate)) if self.rate > 0.0 else 0.0

    @property
    def length(self) -> float:
        """The time of the whole way [s]."""
        if self.rate <= 0.0:
            return 0.0
        peak = self.rate * self._ramp / self.ramp
        return 1.0 / peak + self._ramp

    def share(self, elapsed: float) -> float:
        """The share of the way that is gone after a time [s]."""
        length, ramp = self.length, self._ramp
        if elapsed >= length:
            return 1.0
        if elapsed > 0.5 * length:
            return 1.0 - self.share(length - elapsed)
        acceleration = self.rate / self.ramp
        if elapsed <= ramp:
            return 0.5 * acceleration * max(0.0, elapsed) ** 2
        return acceleration * ramp * (elapsed - 0.5 * ramp)


@dataclass(frozen=True)
class JointPath:
    """A way of the joints, as the `Way` of a script's step.

    Attributes:
        start, target: values of the joints at both ends [rad] or [mm], shape (joint_count,).
        profile: how fast it is gone.
        place: the joints after a share of the way.
    """

    start: np.ndarray
    target: np.ndarray
    profile: TrapezoidalProfile
    place: Callable[[float], np.ndarray]

    @property
    def length(self) -> float:
        """The time of the whole way [s]."""
        return self.profile.length

    def at(self, elapsed: float) -> np.ndarray:
        """The joints some time after the start [s], shape (joint_count,)."""
        share = self.profile.share(elapsed)
        return self.start if share <= 0.0 else self.target if share >= 1.0 else self.place(share)


@dataclass(frozen=True)
class PathLimits:
    """What no path exceeds beside the joints' own speeds.

    Attributes:
        ramp: time from rest to the highest speed [s].
        pivot: the base's pivot at the start [mm], shape (3,).
        base_speed, base_turning_speed: largest speed of the pivot [mm/s] and of the turn [rad/s].
    """

    ramp: float
    pivot: np.ndarray
    base_speed: float = math.inf
    base_turning_speed: float = math.inf


def joint_path(arm: MountedArm, limits: PathLimits, start: np.ndarray, target: np.ndarray) -> JointPath:
    """Every joint straight from one value to another, as fast as the slowest of them allows."""
    way = target - start
    shares = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    rate = _highest_rate(arm, limits, start + shares * way, np.broadcast_to(way, (SAMPLES, len(way))))
    return JointPath(start, target, TrapezoidalProfile(rate, limits.ramp), lambda share: start + share * way)


def straight_path(
    arm: MountedArm,
    limits: PathLimits,
    start: np.ndarray,
    motion: np.ndarray,
    tool: np.ndarray,
    speeds: tuple[float, float],
) -> JointPath:
    """The tool goes straight from where it is to where a motion of the gripper since the start brings it.

    Args:
        arm: the arm.
        limits: of the path.
        start: values of the joints at the beginning, shape (joint_count,).
        motion: of the gripper at the end, shape (4, 4).
        tool: point that goes straight, where it is at the start of the run [mm], shape (3,).
        speeds: largest speed of the tool [mm/s], and of its turn [rad/s].
    """
    first = arm.motions(start)[-1]
    tool_from, tool_to = (pose[:3, :3] @ tool + pose[:3, 3] for pose in (first, motion))
    turn = Rotation.from_matrix(motion[:3, :3] @ first[:3, :3].T).as_rotvec()
    length, angle = float(np.linalg.norm(tool_to - tool_from)), float(np.linalg.norm(turn))

    def link_pose(share: float) -> np.ndarray:
        turned = Rotation.from_rotvec(share * turn).as_matrix() @ first[:3, :3]
        place = tool_from + share * (tool_to - tool_from)
        return arm.link_pose(pose_of(place - turned @ tool, turned))

    count = max(2, *(math.ceil(way / step) for way, step in zip((length, angle), STRAIGHT_STEP, strict=True)))
    shares, table = np.linspace(0.0, 1.0, count + 1), [start]
    for share in shares[1:]:
        values = solve_near(arm.chain, link_pose(share), table[-1])
        if values is None or (np.abs(values - table[-1])[~arm.chain.slides] > LEAP).any():
            _refuse(arm, table[-1], tool_from + share * (tool_to - tool_from), motion, tool_to, values is None)
        table.append(values)
    joints = np.array(table)
    rate = _highest_rate(arm, limits, joints, arm.rates(joints, tool, tool_to - tool_from, turn))
    for way, speed in zip((length, angle), speeds, strict=True):
        rate = min(rate, speed / way) if way > 1e-9 else rate

    def place(share: float) -> np.ndarray:
        near = np.array([np.interp(share, shares, column) for column in joints.T])
        values = solve_near(arm.chain, link_pose(share), near)
        return near if values is None else values

    moves = length > 1e-9 or angle > 1e-12
    return JointPath(start, joints[-1], TrapezoidalProfile(rate if moves else 0.0, limits.ramp), place)


def unreachable(place: np.ndarray) -> ControllerFailed:
    """The error about a place of the tool [mm], shape (3,), that the arm does not reach."""
    return ControllerFailed(f"the arm does not reach {_shown(place)} with the gripper turned like this")


def _refuse(
    arm: MountedArm, joints: np.ndarray, place: np.ndarray, motion: np.ndarray, end: np.ndarray, unreached: bool
) -> NoReturn:
    """Say why a straight way ends at a place, and whether another way leads to its end."""
    if solve(arm.chain, arm.link_pose(motion), joints) is None:
        raise unreachable(end)
    why = "leaves the arm's reach" if unreached else "has joints that leap (a singularity)"
    raise ControllerFailed(f'the straight way {why} at {_shown(place)}; take by = "joints", or go round')


def _shown(place: np.ndarray) -> str:
    return str([round(x, 1) + 0.0 for x in place.tolist()])


def within(path: JointPath, duration: float) -> JointPath:
    """The same way in a given time [s]."""
    if duration < path.length:
        raise ControllerFailed(f"duration = {duration:g} s: the arm needs {path.length:.3g} s")
    if path.length == 0.0:
        return path
    slower = path.length / duration
    profile = TrapezoidalProfile(path.profile.rate * slower, path.profile.ramp / slower)
    return JointPath(path.start, path.target, profile, path.place)


def _highest_rate(arm: MountedArm, limits: PathLimits, joints: np.ndarray, rates: np.ndarray) -> float:
    """The rate [1/s] at which no speed is exceeded, 0 where nothing moves.

    Args:
        arm: the arm.
        limits: of the path.
        joints: the joints at samples of the way, shape (sample_count, joint_count).
        rates: their change for the whole way at the rates that they have there, likewise.
    """
    speeds = np.abs(rates) / (MARGIN * arm.chain.speed)
    slowest = float(speeds.max(initial=0.0))
    for speed, most in zip(
        arm.speeds(joints, rates, limits.pivot), (limits.base_speed, limits.base_turning_speed), strict=True
    ):
        slowest = max(slowest, float(speed.max(initial=0.0)) / (MARGIN * most))
    return 1.0 / slowest if slowest > 1e-12 else 0.0
