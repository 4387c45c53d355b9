"""Quantities by name, of which the observations of environments consist.

Each function takes a `SoftRobotEnvironment`, or an environment around it.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import SceneError, nearest
from taichisoft_gym.actuation import AXES, Travel
from taichisoft_gym.channels import Channel, ChannelGroup, symmetric

ARM_REACH = 1000.0
"""Way of a base that an arm carries, in each direction [mm]."""


def by_finger(env: Any, name: str, unit: str, high: float, read: Callable[[Observation, str], float]) -> ChannelGroup:
    """A channel "NAME FINGER" from 0 to `high` for each finger."""
    fingers: tuple[str, ...] = env.get_wrapper_attr("fingers")
    channels = tuple(Channel(f"{name} {finger}", unit, 0.0, high) for finger in fingers)
    return ChannelGroup(channels, lambda seen: [read(seen, finger) for finger in fingers])


def contact_force(env: Any, highest: float = 5000.0) -> ChannelGroup:
    """Normal force of each finger on the object [mN]."""
    name = env.get_wrapper_attr("object")
    return by_finger(
        env, "contact force", "mN", highest, lambda seen, finger: seen.normal_forces.get((finger, name), 0.0)
    )


def slip(env: Any, highest: float = 100.0) -> ChannelGroup:
    """Speed at which the object slides on each finger [mm/s]."""
    name = env.get_wrapper_attr("object")
    return by_finger(env, "slip", "mm/s", highest, lambda seen, finger: seen.slip_speeds.get((finger, name), 0.0))


def contact_pressure(env: Any, highest: float = 200.0) -> ChannelGroup:
    """Highest pressure in the contact of each finger with the object [kPa]."""
    name = env.get_wrapper_attr("object")
    return by_finger(
        env, "contact pressure", "kPa", highest, lambda seen, finger: seen.peak_pressures.get((finger, name), 0.0)
    )


def bending(env: Any) -> ChannelGroup:
    """Bending angle of each finger [rad]."""
    return by_finger(env, "bending", "rad", np.pi, lambda seen, finger: seen.bending_angles[finger])


def flow(env: Any, highest: float = 200e3) -> ChannelGroup:
    """Flow of air into each cavity [mm^3/s]."""
    cavities = env.get_wrapper_attr("cavities")
    channels = tuple(Channel(f"flow {cavity}", "mm^3/s", -highest, highest) for cavity in cavities)
    return ChannelGroup(channels, lambda seen: [seen.flows[cavity] for cavity in cavities])


def tactile(env: Any, highest: float = 1000.0) -> ChannelGroup:
    """Force on each patch of all tactile arrays [mN]."""
    sizes = {name: table.patch_count for name, table in env.get_wrapper_attr("scene").tactile_arrays.items()}
    channels = [Channel(f"tactile {name} {i}", "mN", 0.0, highest) for name, n in sizes.items() for i in range(n)]
    return ChannelGroup(
        tuple(channels), lambda seen: np.concatenate([seen.tactile[name].ravel() for name in sizes] or [np.zeros(0)])
    )


def _of_base(env: Any) -> ChannelGroup:
    reach = np.full(3, 0.0 if env.travel is None else ARM_REACH)
    low, high = (env.travel.low, env.travel.high) if isinstance(env.travel, Travel) else (-reach, reach)
    channels = [Channel(f"base {axis}", "mm", a - 1.0, b + 1.0) for axis, a, b in zip(AXES, low, high, strict=True)]
    return ChannelGroup(tuple(channels), lambda seen: env.axes @ seen.base_translation)


def _joints(env: Any) -> ChannelGroup:
    arm = env.actuation.arm
    if arm is None:
        raise SceneError("observations: 'joints' needs travel = ArmTravel()")

    def read(seen: Observation) -> np.ndarray:
        values: np.ndarray = arm.values(seen.base_translation, seen.base_rotation, env.simulation.model.base_pivot)
        return values

    return ChannelGroup(arm.positions, read)


def _of_object(env: Any) -> ChannelGroup:
    return ChannelGroup(symmetric("object", "mm", 200.0, AXES), env.way_of_object)


def _object_velocity(env: Any) -> ChannelGroup:
    name = env.object
    return ChannelGroup(
        symmetric("object velocity", "mm/s", 1000.0, AXES), lambda seen: env.axes @ seen.object_velocities[name]
    )


def _tip(env: Any) -> ChannelGroup:
    finger = env.finger
    return ChannelGroup(symmetric("tip", "mm", 200.0, AXES), lambda seen: env.axes @ seen.tip_positions[finger])


def _tip_velocity(env: Any) -> ChannelGroup:
    finger = env.finger
    return ChannelGroup(
        symmetric("tip velocity", "mm/s", 1000.0, AXES), lambda seen: env.axes @ seen.tip_velocities[finger]
    )


def _way_to_goal(env: Any) -> ChannelGroup:
    channels = tuple(
        Channel(f"way to the target {one.name.rpartition(' ')[2]}", one.unit, -env.goal_reach, env.goal_reach)
        for one in env.goal_channels
    )
    return ChannelGroup(channels, lambda seen: env.desired_goal - env.achieved_goal(seen))


QUANTITIES: dict[str, Callable[[Any], ChannelGroup]] = {
    "actuators": lambda env: ChannelGroup(env.actuation.actuator_channels, env.actuation.read),
    "tip": _tip,
    "tip velocity": _tip_velocity,
    "bending": bending,
    "flow": flow,
    "base": _of_base,
    "joints": _joints,
    "wrist force": lambda env: ChannelGroup(
        symmetric("wrist force", "mN", 1e4, "xyz"), lambda seen: seen.base_force_in_base
    ),
    "wrist torque": lambda env: ChannelGroup(
        symmetric("wrist torque", "mN mm", 1e6, "xyz"), lambda seen: seen.base_torque_in_base
    ),
    "object": _of_object,
    "object velocity": _object_velocity,
    "contact force": contact_force,
    "contact pressure": contact_pressure,
    "slip": slip,
    "tactile": tactile,
    "way to the target": _way_to_goal,
}
"""Quantities by name; docs/environments.md lists them with units and ranges."""


def named_quantities(
    env: Any, observations: Sequence[str | Callable[[Any], ChannelGroup]], goals: bool
) -> list[ChannelGroup]:
    """The channels of an environment by names in QUANTITIES, or functions of one's own.

    With `goals` without the way to the target: hindsight would change the goal, but not this.

    Raises:
        SceneError: a name is unknown, or a function makes something else.
    """
    makers = []
    for what in observations:
        if isinstance(what, str) and what not in QUANTITIES:
            raise SceneError(f"observations: there is no '{what}'; {nearest(what, list(QUANTITIES), 'there are')}")
        if not (goals and what == "way to the target"):
            makers.append(QUANTITIES[what] if isinstance(what, str) else what)
    groups = [make(env) for make in makers]
    for group in groups:
        if not isinstance(group, ChannelGroup):
            raise SceneError(f"observations: a function returned {group!r}: must be a ChannelGroup")
    return groups
