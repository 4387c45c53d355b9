"""What a controller sees."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.base.text import brief
from taichisoft.control.figures import FIGURES, PAIRS, Pair
from taichisoft.errors import TaichisoftError, nearest
from taichisoft.mechanics.state import State

# Values by name: whose errors name the nearest, and that are made when somebody looks.


class Named(dict[Any, Any]):
    """A dictionary whose error about a missing name has the nearest one."""

    def __missing__(self, name: Any) -> Any:
        raise KeyError(f"'{name}'; {nearest(name, list(self), 'there are')}" if isinstance(name, str) else name)


class LazyValues(Mapping[str, Any]):
    """A mapping whose names are known, and whose values are made one by one, each once."""

    def __init__(self, names: Iterable[str], make: Callable[[str], Any]):
        self._names, self._make = tuple(names), make
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """The value of a name."""
        if name not in self._names:
            raise KeyError(name)
        if name not in self._made:
            self._made[name] = self._make(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        """The names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Number of names."""
        return len(self._names)

    def __reduce__(self) -> tuple[Any, ...]:
        """Other processes get what was made: they have no renderer."""
        return dict, (dict(self._made),)


@dataclass(frozen=True)
class Observation:
    """What a controller sees before a step; it depends on the state alone.

    Angles are in radians, as in `Control`; scenes, scripts and results for people to read have degrees and say so. The
    arrays belong to this observation: who writes to them changes neither the simulation nor what others see.

    A finger is a soft body with anchors: its tip is what its `tip` in the scene selects. Pairs of bodies stand in the
    scene's order, ("finger1", "cube"); those further apart than `contact.alarm_distance` are left out.

    Attributes:
        time: simulated time at the start of the step [s].
        step: index of the step about to be made.
        control_period: time between two calls of the controller [s]; 0 in an observation that was made up without it.
        pressures: pressures in the last step [kPa], by cavity name.
        pressure_targets: pressures that regulators are driven for, within limits [kPa], by the names of the cavities
            that have one; behind a line the cavity's pressure comes later.
        volumes: volumes of the cavities [mm^3], by cavity name.
        flows: rates of change of the volumes [mm^3/s], by cavity name.
        air_masses: air in the cavities and their lines [kg], by cavity name; with regulated air as much as was let in
            for its pressure.
        air_flows: flows of air into the cavities and their lines in the last step [kg/s], by cavity name.
        valve_openings: openings of the valves in the last step, from -1 to 1, after delay and response, by cavity name.
        network_pressures: pressures in tanks, tubes and sources of the scene's air network in the last step [kPa].
        network_flows: flows of air through its tubes, orifices and valves in the last step [kg/s], from inlet to outlet
            positive, of a valve's exhaust as well.
        network_openings: openings of its valves in the last step, from -1 to 1, after delay and response.
        cable_tensions: tensions at the pulled ends in the last step [mN], by cable name.
        cable_lengths: lengths of the cables [mm], by cable name.
        cable_pulls: how far the cables are pulled in [mm], by cable name.
        tip_positions: mean position of the tip's nodes [mm], shape (3,), by finger.
        tip_velocities: mean velocity of the tip's nodes [mm/s], shape (3,), by finger.
        bending_angles: turn of the tip against the frame that the finger follows [rad], from 0 to pi, by finger.
        base_translation: shift of the base from rest [mm], shape (3,).
        base_rotation: rotation vector of the base about its pivot [rad], shape (3,).
        base_force: force on the base in the last step, by anchors, by bodies that it carries, and by cables that are
            pulled from it [mN], shape (3,).
        base_torque: torque of it about the base's pivot, which moves with the base [mN mm], shape (3,).
        base_force_in_base, base_torque_in_base: the same in axes that turn with the base, as a sensor on it has them.
        frame_translations, frame_rotations: poses of the scene's frames, as `Control` asks for them [mm] and [rad],
            shape (3,), by name.
        frame_forces, frame_torques: force [mN] on each of them in the last step, and torque [mN mm] about its pivot, by
            all that it carries, in world axes, shape (3,), by name.
        frame_angles: angles of the frames with a hinge [rad], by name.
        frame_moments: moments about the axes of these hinges [mN mm], by name.
        object_positions: centre of mass of each rigid body [mm], shape (3,), by name.
        object_rotations: rotation of each rigid body, a unit quaternion (w, x, y, z), shape (4,), by name.
        object_velocities: velocity of the centre of mass of each rigid body [mm/s], shape (3,), by name.
        object_angular_velocities: angular velocity of each rigid body in world axes [rad/s], shape (3,), by name.
        external_forces: force from outside in the last step, by the controller or the scene, in world axes [mN], shape
            (3,), by soft body, rigid body and frame.
        contact_counts: number of contacts that press, by pair.
        normal_forces: sum of the normal forces in the last step [mN], by pair.
        friction_forces: sum of the magnitudes of the friction forces in the last step [mN], by pair.
        slip_speeds: fastest sliding of a contact that presses [mm/s], by pair.
        contact_points: middles of the contacts, the open ones too, as in `StepReport` [mm], shape (count, 3), by pair.
        contact_forces: force on the second body in each of these [mN], shape (count, 3), by pair.
        contact_areas: area in contact [mm^2], by pair of which one is soft and presses the other.
        contact_area_errors: how far the mesh may be wrong about that [mm^2], likewise.
        peak_pressures: highest pressure in the contact [kPa], likewise; the mesh limits how narrow a peak it shows.
        peak_pressure_errors: how far the mesh may be wrong about that [kPa], likewise.
        tactile: normal force on each patch of the scene's tactile arrays [mN], of the shape of their `patches`, by
            "body.array".
        clipped: parts of the last request that the scene's limits held back: names of cavities, of
            cables, and of valves and regulators of the air network, "base_translation" and "base_rotation", and so on
            for other frames.
        cameras: what the scene's cameras see, a `CameraFrame` by name, drawn when it is looked at; empty in an
            observation of a `TimeStepper` alone.
        exact: the same without the scene's `[sensors]`, which disturb the fields above; None where there are none, or
            in an exact observation. `truth` is one of both.
        state: the complete state that all the above was worked out from, read-only, for controllers that need every
            node or every contact; None in an observation that was made up without one.
    """

    time: float
    step: int
    control_period: float = 0.0
    pressures: Mapping[str, float] = field(default_factory=dict)
    pressure_targets: Mapping[str, float] = field(default_factory=dict)
    volumes: Mapping[str, float] = field(default_factory=dict)
    flows: Mapping[str, float] = field(default_factory=dict)
    air_masses: Mapping[str, float] = field(default_factory=dict)
    air_flows: Mapping[str, float] = field(default_factory=dict)
    valve_openings: Mapping[str, float] = field(default_factory=dict)
    network_pressures: Mapping[str, float] = field(default_factory=dict)
    network_flows: Mapping[str, float] = field(default_factory=dict)
    network_openings: Mapping[str, float] = field(default_factory=dict)
    cable_tensions: Mapping[str, float] = field(default_factory=dict)
    cable_lengths: Mapping[str, float] = field(default_factory=dict)
    cable_pulls: Mapping[str, float] = field(default_factory=dict)
    tip_positions: Mapping[str, np.ndarray] = field(default_factory=dict)
    tip_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    bending_angles: Mapping[str, float] = field(default_factory=dict)
    base_translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_rotation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_torque: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_force_in_base: np.ndarray = field(default_factory=lambda: np.zeros(3))
    base_torque_in_base: np.ndarray = field(default_factory=lambda: np.zeros(3))
    frame_translations: Mapping[str, np.ndarray] = field(default_factory=dict)
    frame_rotations: Mapping[str, np.ndarray] = field(default_factory=dict)
    frame_forces: Mapping[str, np.ndarray] = field(default_factory=dict)
    frame_torques: Mapping[str, np.ndarray] = field(default_factory=dict)
    frame_angles: Mapping[str, float] = field(default_factory=dict)
    frame_moments: Mapping[str, float] = field(default_factory=dict)
    object_positions: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_rotations: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    object_angular_velocities: Mapping[str, np.ndarray] = field(default_factory=dict)
    external_forces: Mapping[str, np.ndarray] = field(default_factory=dict)
    contact_counts: Mapping[Pair, int] = field(default_factory=dict)
    normal_forces: Mapping[Pair, float] = field(default_factory=dict)
    friction_forces: Mapping[Pair, float] = field(default_factory=dict)
    slip_speeds: Mapping[Pair, float] = field(default_factory=dict)
    contact_points: Mapping[Pair, np.ndarray] = field(default_factory=dict)
    contact_forces: Mapping[Pair, np.ndarray] = field(default_factory=dict)
    contact_areas: Mapping[Pair, float] = field(default_factory=dict)
    contact_area_errors: Mapping[Pair, float] = field(default_factory=dict)
    peak_pressures: Mapping[Pair, float] = field(default_factory=dict)
    peak_pressure_errors: Mapping[Pair, float] = field(default_factory=dict)
    tactile: Mapping[str, np.ndarray] = field(default_factory=dict)
    clipped: tuple[str, ...] = field(default_factory=tuple)
    cameras: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)
    exact: "Observation | None" = field(default=None, repr=False)
    state: State | None = field(default=None, repr=False, compare=False)

    @property
    def truth(self) -> "Observation":
        """The observation without the disturbances of the scene's sensors."""
        return self if self.exact is None else self.exact

    def __getattr__(self, name: str) -> Any:
        """A figure that is worked out of others, or a field that is computed when it is first read.

        `Observer` gives an observation the function `_work_out`, which finds a field and others that come with it.
        """
        figure, work_out = DERIVED.get(name), vars(self).get("_work_out")
        if figure is not None:
            return figure.values(self)
        if work_out is not None and not name.startswith("_"):
            vars(self).update({**work_out(name), **vars(self)})
        if name not in vars(self):
            valid = [*(one.name for one in fields(self)), *DERIVED]
            raise AttributeError(f"an Observation has no '{name}'; {nearest(name, valid, 'there are')}")
        return vars(self)[name]

    def __repr__(self) -> str:
        """Its fields, but for those that are empty, in at most ten lines."""
        return brief("Observation", {one.name: getattr(self, one.name) for one in fields(self) if one.repr})

    def __getstate__(self) -> dict[str, Any]:
        """All fields, for copies and other processes, which know dictionaries alone."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: Named(value) if isinstance(value, MappingProxyType) else value for name, value in values.items()}

    def __setstate__(self, values: dict[str, Any]) -> None:
        """Take over the fields of another observation, with dictionaries that cannot be written to."""
        frozen = {name: MappingProxyType(value) for name, value in values.items() if isinstance(value, Named)}
        vars(self).update(values | frozen)


# Figures by name for rollouts, derivatives and targets: parts of an observation, such as "object_positions.cube".

DERIVED = {figure.field: figure for figure in FIGURES if figure.of is not None}
"""Figures that are worked out of fields of an observation."""
BY_PAIR = {figure.field for figure in FIGURES if figure.per is PAIRS}
"""Bodies that are far apart are not in an observation: nothing presses, nothing slides."""
OF_ANY_LENGTH = ("contact_points", "contact_forces", "clipped", "exact")
KNOWN = (*(one.name for one in fields(Observation) if one.name not in OF_ANY_LENGTH), *DERIVED)
OF_STATE = tuple(one.name for one in fields(State) if not one.name.startswith("contact_"))


@dataclass(frozen=True)
class ObservedFigure:
    """A part of an observation.

    Attributes:
        name: as the user wrote it.
        field: field of `Observation`.
        key: entry of that field, a pair of bodies, or a field of `State`; "" for all of it.
    """

    name: str
    field: str
    key: str | tuple[str, str] = ""

    def of(self, observation: Observation) -> np.ndarray:
        """Its present value without sensors; all entries of a field in the order of the scene, shape (count, ...)."""
        observation = observation.truth
        value = getattr(observation, self.field)
        if self.field == "state":
            value = getattr(value, str(self.key))
        elif isinstance(self.key, tuple):
            value = value.get(self.key, 0.0)
        elif self.key:
            value = value[self.key]
        elif isinstance(value, Mapping):
            value = list(value.values())
        return np.asarray(value, dtype=np.float64)


def find_figure(name: str, observation: Observation, bodies: tuple[str, ...]) -> ObservedFigure:
    """The figure that a name means.

    Args:
        name: "base_translation", "tip_positions", "tip_positions.finger1", "normal_forces.finger1|cube",
            "state.position".
        observation: one of the simulation, which shows the names of cavities and so on.
        bodies: names of all bodies in the order of the scene.

    Raises:
        TaichisoftError: there is no such figure, or it has no fixed shape.
    """
    field, _, key = name.partition(".")
    if field in OF_ANY_LENGTH or field not in KNOWN:
        hint = nearest(field, KNOWN, "there are")
        raise TaichisoftError(f"figures: '{name}': not a field of an observation with a fixed shape; {hint}")
    if field in BY_PAIR:
        return ObservedFigure(name, field, _pair(name, key, bodies))
    value = getattr(observation, field)
    valid = OF_STATE if field == "state" else tuple(value) if isinstance(value, Mapping) else ()
    if key not in valid and (key or field == "state"):
        hint = nearest(key, valid, "there are") if valid else f"leave out what follows {field}"
        raise TaichisoftError(f"figures: '{name}': {field} has no '{key}'; {hint}")
    return ObservedFigure(name, field, key)


def _pair(name: str, key: str, bodies: tuple[str, ...]) -> tuple[str, str]:
    """Two bodies in the order of the scene."""
    first, separator, second = key.partition("|")
    for body in (first, second) if separator else ():
        if body not in bodies:
            raise TaichisoftError(
                f"figures: '{name}': no body is called '{body}'; {nearest(body, bodies, 'there are')}"
            )
    if not separator:
        raise TaichisoftError(f"figures: '{name}': name two bodies, as in normal_forces.finger1|cube")
    return (first, second) if bodies.index(first) <= bodies.index(second) else (second, first)
