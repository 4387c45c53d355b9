"""The complete state of a run: a run continued from a saved state is reproduced bit for bit."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base.files import read_arrays
from taichisoft.base.text import brief
from taichisoft.errors import StateError, nearest


@dataclass(frozen=True)
class State:
    """The state between two steps in read-only arrays; `Simulation.step` makes a new state.

    Attributes:
        time: simulated time [s].
        step: number of steps made.
        position: positions of the soft nodes [mm], shape (node_count, 3).
        velocity: velocities of the soft nodes [mm/s], shape (node_count, 3).
        rigid_position: centres of mass of the rigid bodies [mm], shape (rigid_count, 3).
        rigid_rotation: rotations of the rigid bodies, unit quaternions (w, x, y, z), shape (rigid_count, 4).
        rigid_velocity: velocities of the centres of mass [mm/s], shape (rigid_count, 3).
        rigid_angular_velocity: angular velocities of the rigid bodies in world axes [rad/s], shape (rigid_count, 3).
        frame_pose: shift of the pivot from rest [mm] and rotation vector about it [rad] of each frame, in the axes of
            the frame that carries it; the base is the first frame, shape (frame_count, 2, 3).
        frame_request: requested poses, before limits, shape (frame_count, 2, 3).
        frame_velocity: requested linear [mm/s] and angular velocity [rad/s], 0 if a pose was requested, shape
            (frame_count, 2, 3).
        frame_wrench: force [mN] and torque about the frame's pivot [mN mm] on each frame in the last step, in world
            axes, shape (frame_count, 2, 3).
        external_force: forces from outside [mN], torques [mN mm] and the points at rest on which they act [mm], of the
            soft bodies, rigid bodies and frames, shape (soft_count + rigid_count + frame_count, 3, 3).
        external_force_steps: number of steps for which each acts, with the last one; negative: until another is
            requested; 0: it does not act.
        external_force_own_axes: whether it is in axes that turn with what it acts on, else in those of the world.
        anchor_position: positions of the anchors' springs, before their frames move them [mm], (anchor_count, 3).
        gravity: acceleration of gravity [mm/s^2], shape (3,).
        young_modulus: Young's moduli of the materials [kPa], shape (material_count,).
        actuator_imposed: whether an actuator is driven by its coordinate (volume growth, pull), else by its effort
            (pressure, tension); this and the next four in the order of the model's actuators, (actuator_count,).
        actuator_request: requested pressure [kPa], tension [mN], volume growth [mm^3] or pull [mm], before limits,
            shape (actuator_count,).
        actuator_target: the part of the request within the limits, shape (actuator_count,).
        actuator_effort: pressure [kPa] or tension [mN] in the last step, imposed or computed, shape (actuator_count,).
        actuator_value: volume [mm^3] or length [mm], shape (actuator_count,).
        actuator_loss: tension lost to friction at each inner point in the last step, negative for a cable paid out
            [mN], in the order of the cables with friction, shape (loss_count,).
        air_mass: mass of the air in each cavity and its line [kg], shape (cavity_count,).
        tube_air_mass: the part of it in the tube of the line [kg], shape (cavity_count,).
        warm_air_space: space in which the air of each cavity has room temperature [mm^3]: that of the cavity and what
            is shut in with it as a regulator last filled it, else at rest, shape (cavity_count,).
        air_flow: flow of air into cavity and line in the last step [kg/s], shape (cavity_count,).
        valve_request: requested openings of the valves, from -1 (to the exhaust) to 1, shape (cavity_count,).
        valve_opening: openings in the last step, after delay and response, shape (cavity_count,).
        supply_pressure: pressures of the lines' sources in the last step [kPa], shape (cavity_count,).
        delayed_requests: requested openings or pressures [kPa] that have had no effect yet, the oldest first,
            shape (cavity_count, longest delay in steps).
        network_air_mass: air in the tanks and tubes of the scene's table `air` [kg], shape (volume_count,).
        network_pressure: pressures of these and of its sources in the last step [kPa], (volume_count + source_count,).
        network_flow: flows through its tubes, orifices and valves in the last step [kg/s], shape (part_count,).
        network_request: requests for its valves [-] and regulators [kPa], shape (drive_count,).
        network_target: what limits leave of them, shape (drive_count,).
        network_drive: openings and pressures in the last step, after delay and response, shape (drive_count,).
        network_delayed: targets that have had no effect yet, the oldest first, (drive_count, longest delay in steps).
        pull_point: positions of the pull points before their frames moved them [mm], shape (cable_count, 3).
        sensor_memory: seed of the scene's sensors, 1 once they have samples, and these, sensor by sensor, the oldest
            first; empty without sensors.
        contact_body_pair: numbers of the two bodies of each contact of the last step, shape (contact_count, 2).
        contact_point: midpoint of each contact at its detection [mm], shape (contact_count, 3).
        contact_normal: unit vector from the first body to the second, shape (contact_count, 3).
        contact_impulse: impulse on the second body [mN s], shape (contact_count, 3).
        contact_slip: sliding velocity of the second body of each contact on the first, 0 if not pressed [mm/s], shape
            (contact_count, 3).
    """

    time: float
    step: int
    position: np.ndarray
    velocity: np.ndarray
    rigid_position: np.ndarray
    rigid_rotation: np.ndarray
    rigid_velocity: np.ndarray
    rigid_angular_velocity: np.ndarray
    frame_pose: np.ndarray
    frame_request: np.ndarray
    frame_velocity: np.ndarray
    frame_wrench: np.ndarray
    external_force: np.ndarray
    external_force_steps: np.ndarray
    external_force_own_axes: np.ndarray
    anchor_position: np.ndarray
    gravity: np.ndarray
    young_modulus: np.ndarray
    actuator_imposed: np.ndarray
    actuator_request: np.ndarray
    actuator_target: np.ndarray
    actuator_effort: np.ndarray
    actuator_value: np.ndarray
    actuator_loss: np.ndarray
    air_mass: np.ndarray
    tube_air_mass: np.ndarray
    warm_air_space: np.ndarray
    air_flow: np.ndarray
    valve_request: np.ndarray
    valve_opening: np.ndarray
    supply_pressure: np.ndarray
    delayed_requests: np.ndarray
    network_air_mass: np.ndarray
    network_pressure: np.ndarray
    network_flow: np.ndarray
    network_request: np.ndarray
    network_target: np.ndarray
    network_drive: np.ndarray
    network_delayed: np.ndarray
    pull_point: np.ndarray
    sensor_memory: np.ndarray
    contact_body_pair: np.ndarray
    contact_point: np.ndarray
    contact_normal: np.ndarray
    contact_impulse: np.ndarray
    contact_slip: np.ndarray

    def __post_init__(self) -> None:
        """Make the arrays read-only, so that data computed from a state stay valid."""
        _make_read_only(vars(self))

    def __getattr__(self, name: str) -> Any:
        """Say what there is instead of a missing attribute."""
        hint = nearest(name, [one.name for one in dataclasses.fields(self)], "it has")
        raise AttributeError(f"a State has no '{name}': simulation.observe() has figures by name; {hint}")

    def __repr__(self) -> str:
        """Its fields, but for those that are empty, in at most ten lines."""
        return brief("State", dict(_items(self)))

    @property
    def base_translation(self) -> np.ndarray:
        """Shift of the base from rest [mm], shape (3,)."""
        shift: np.ndarray = self.frame_pose[0, 0]
        return shift

    @property
    def base_rotation(self) -> np.ndarray:
        """Rotation vector of the base about its pivot [rad], shape (3,)."""
        vector: np.ndarray = self.frame_pose[0, 1]
        return vector

    def changed(self, **changes: Any) -> "State":
        """Copy with other values of some fields; as `dataclasses.replace`, but fast enough for every step."""
        state = object.__new__(State)
        vars(state).update(vars(self), **changes)
        _make_read_only(changes)
        return state

    def copy(self) -> "State":
        """Copy without shared arrays."""
        arrays: dict[str, Any] = {name: value.copy() for name, value in _items(self) if isinstance(value, np.ndarray)}
        return self.changed(**arrays)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, State) and all(
            np.shape(value) == np.shape(getattr(other, name))
            and np.asarray(value).tobytes() == np.asarray(getattr(other, name)).tobytes()
            for name, value in _items(self)
        )

    def problem(self) -> str:
        """First field that is not an array of finite numbers, as part of a message; empty for a valid state."""
        for name, value in _items(self):
            is_array = name not in ("time", "step")
            kind = np.asarray(value).dtype.kind
            if is_array != isinstance(value, np.ndarray) or kind not in ("biuf" if is_array else "iuf"):
                return f"its {name} is {'not an array of numbers' if is_array else 'not a number'}"
            if kind == "f" and not np.isfinite(value).all():
                return f"its {name} has a number that is not finite"
        return ""

    def save(self, path: str | Path) -> None:
        """Write the whole state to an .npz file."""
        arrays: dict[str, Any] = dict(_items(self))
        with Path(path).open("wb") as file:
            np.savez(file, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> "State":
        """Read a state that `save` wrote.

        Raises:
            StateError: the file is missing, damaged, or not a state.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        try:
            arrays: dict[str, Any] = read_arrays(path)
            if set(arrays) != names:
                wrong = ", ".join(sorted(set(arrays) ^ names))
                raise StateError(f"{path}: not a state of this version of taichisoft; it differs in: {wrong}")
            return cls(**{**arrays, "time": float(arrays["time"]), "step": int(arrays["step"])})
        except (OSError, ValueError, TypeError) as error:
            raise StateError(f"{path}: cannot be read as a state: {error}") from error


def _make_read_only(values: Mapping[str, Any]) -> None:
    for value in values.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)


def _items(state: State) -> list[tuple[str, Any]]:
    return [(field.name, getattr(state, field.name)) for field in dataclasses.fields(state)]
