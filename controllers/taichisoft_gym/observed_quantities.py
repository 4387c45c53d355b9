"""Quantities by name, of which the observations of environments consist."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from taichisoft.control import BASE, FIGURES, OBJECTS, PAIRS, PUSHED, Figure, Observation
from taichisoft.errors import SceneError, nearest
from taichisoft_gym.actuation import AXES, Travel
from taichisoft_gym.channels import Channel, ChannelGroup, symmetric

ARM_REACH = 1000.0
"""Way of a base that an arm carries, in each direction [mm]."""

Quantity = str | Callable[[Any], ChannelGroup]
"""A name in QUANTITIES, or a function of an environment."""


def _of_figure(env: Any, figure: Figure, name: str, highest: float | None = None) -> ChannelGroup:
    """A figure of each finger, on the object if it is one of pairs, or of each actuator.

    A vector of the first finger or of the object, as forces from outside are, has the directions right, front and up,
    one of the base its axes.
    """
    reach, unit = figure.reach if highest is None else highest, "rad" if figure.unit == "degrees" else figure.unit
    if figure.per is BASE:
        return ChannelGroup(symmetric(name, unit, reach, figure.axes), lambda seen: figure.values(seen)[""])
    if figure.axes:
        owner = env.object if figure.per in (OBJECTS, PUSHED) else env.finger
        return ChannelGroup(symmetric(name, unit, reach, AXES), lambda seen: env.axes @ figure.values(seen)[owner])
    kind = figure.per.kind
    names: Sequence[str] = env.fingers if kind is None else tuple(env.scene.actuators(kind.plural))
    channels = tuple(Channel(f"{name} {one}", unit, 0.0 if kind is None else -reach, reach) for one in names)
    keys: Sequence[Any] = [(one, env.object) for one in names] if figure.per is PAIRS else names
    away = 0.0 if figure.per is PAIRS else np.nan

    def read(seen: Observation) -> list[float]:
        values = figure.values(seen)
        return [values.get(key, away) for key in keys]

    return ChannelGroup(channels, read)


def _tactile(env: Any) -> ChannelGroup:
    """Force on each patch of all tactile arrays [mN]."""
    sizes = {name: table.patch_count for name, table in env.scene.tactile_arrays.items()}
    channels = [Channel(f"tactile {name} {i}", "mN", 0.0, 1e3) for name, n in sizes.items() for i in range(n)]
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


def _way_to_goal(env: Any) -> ChannelGroup:
    channels = tuple(
        Channel(f"way to the target {one.name.rpartition(' ')[2]}", one.unit, -env.goal_reach, env.goal_reach)
        for one in env.goal_channels
    )
    return ChannelGroup(channels, lambda seen: env.desired_goal - env.achieved_goal(seen))


OTHER_NAMES = {
    "bending_angle": "bending",
    "base_force_in_base": "wrist force",
    "base_torque_in_base": "wrist torque",
    "normal_force": "contact force",
    "tip_position": "tip",
    "peak_pressure": "contact pressure",
    "slip_speed": "slip",
}
"""Names of figures that differ from their own."""
OF_FIGURES = {OTHER_NAMES.get(one.name, one.name.replace("_", " ")): one for one in FIGURES if one.reach}
QUANTITIES: dict[str, Callable[[Any], ChannelGroup]] = {
    "actuators": lambda env: ChannelGroup(env.actuation.actuator_channels, env.actuation.read),
    "base": _of_base,
    "joints": _joints,
    "object": lambda env: ChannelGroup(symmetric("object", "mm", 200.0, AXES), env.way_of_object),
    "tactile": _tactile,
    "way to the target": _way_to_goal,
}
"""Quantities by name beside figures; docs/environments.md lists them with units and ranges."""


def make_group(env: Any, quantity: Quantity, highest: float | None = None) -> ChannelGroup:
    """The channels of a quantity in an environment; `highest` is the end of their range, of a figure."""
    known = [*QUANTITIES, *OF_FIGURES]
    if isinstance(quantity, str) and quantity not in known:
        raise SceneError(f"observations: there is no '{quantity}'; {nearest(quantity, known, 'there are')}")
    if quantity in OF_FIGURES:
        return _of_figure(env, OF_FIGURES[str(quantity)], str(quantity), highest)
    if highest is not None:
        raise SceneError(f"highest = {highest!r}: '{quantity}' has its own range; there are: {', '.join(OF_FIGURES)}")
    group = QUANTITIES[quantity](env) if isinstance(quantity, str) else quantity(env)
    if not isinstance(group, ChannelGroup):
        raise SceneError(f"observations: a function returned {group!r}: must be a ChannelGroup")
    return group
