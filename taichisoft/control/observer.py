"""What a controller sees, worked out from a state."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from threading import Lock
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.actuators.cavities import CAVITIES
from taichisoft.actuators.kind import ActuatorFigure
from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.control.contact_patches import ContactPatches, LazyMapping
from taichisoft.control.contact_summary import summarise_contacts
from taichisoft.control.fingertips import Fingertips
from taichisoft.control.frame_motion import observed_frames
from taichisoft.control.lazy_values import LazyValues
from taichisoft.control.limits import clipped
from taichisoft.control.observation import Observation
from taichisoft.control.sensor_chain import Sensors
from taichisoft.model import Model
from taichisoft.state import State

ARRAYS_BY_NAME = (
    "tip_positions",
    "tip_velocities",
    "object_positions",
    "object_rotations",
    "object_velocities",
    "object_angular_velocities",
    "contact_points",
    "contact_forces",
    "tactile",
    "frame_translations",
    "frame_rotations",
    "frame_forces",
    "frame_torques",
)
"""Fields of an observation that hold arrays by name."""
ARRAYS_OF_BASE = (
    "base_translation",
    "base_rotation",
    "base_force",
    "base_torque",
    "base_force_in_base",
    "base_torque_in_base",
)
"""Fields that hold an array."""


class Observer:
    """Makes observations of a model's states; they depend on the state alone, so that a restored run is seen alike.

    Displays and pages observe from threads of their own while the simulation steps: the work space is the observer's,
    and one thread at a time uses it.
    """

    def __init__(self, model: Model):
        """Find the fingertips.

        Raises:
            SceneError: a tip cannot show a rotation.
        """
        self._model = model
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        self._fingertips = Fingertips(model.soft_bodies, model.frames)
        self._object_names = tuple(body.name for body in model.rigid_bodies)
        self._patches, self._sensors = ContactPatches(model), Sensors(model.scene)
        self.look: Callable[[State, str], Any] | None = None
        self._working = Lock()
        self._last: tuple[State, Observation] | None = None

    def observe(self, state: State) -> Observation:
        """What a controller sees before the step that follows `state`, through the scene's sensors."""
        truth = self.truth(state)
        if not self._model.scene.sensors:
            return truth
        shown = self._sensors.readings(self._sensors.begin(state.sensor_memory, truth), truth)
        return replace(truth, **shown, exact=truth)

    def truth(self, state: State) -> Observation:
        """The exact observation of a state; worked out once, copied for who asks."""
        with self._working:
            if self._last is None or self._last[0] is not state:
                self._last = state, self._work_out(state)
            return _copied(self._last[1])

    def with_samples(self, state: State, start: State | None = None) -> State:
        """The state with what its sensors remember: from the one before the step, or as they begin without one."""
        if not self._model.scene.sensors:
            return state
        truth = self.truth(state)
        if start is None:
            return state.changed(sensor_memory=self._sensors.begin(state.sensor_memory, truth))
        return state.changed(sensor_memory=self._sensors.after(start.sensor_memory, truth))

    def _work_out(self, state: State) -> Observation:
        model, tips, contacts = self._model, self._fingertips, summarise_contacts(self._model, state)
        tip_positions, tip_velocities, bending_angles = tips.observe(state)
        patches = LazyMapping(lambda: self._patches.patches(state))
        return Observation(
            time=state.time,
            step=state.step,
            control_period=model.control_period,
            **self._actuators(state),
            tip_positions=_by_name(tips.names, tip_positions),
            tip_velocities=_by_name(tips.names, tip_velocities),
            bending_angles=_numbers(tips.names, bending_angles),
            **observed_frames(model, state),
            object_positions=_by_name(self._object_names, state.rigid_position),
            object_rotations=_by_name(self._object_names, state.rigid_rotation),
            object_velocities=_by_name(self._object_names, state.rigid_velocity),
            object_angular_velocities=_by_name(self._object_names, state.rigid_angular_velocity),
            contact_counts=MappingProxyType(contacts.counts),
            normal_forces=MappingProxyType(contacts.normal_forces),
            friction_forces=MappingProxyType(contacts.friction_forces),
            slip_speeds=MappingProxyType(contacts.slip_speeds),
            contact_points=contacts.points,
            contact_forces=contacts.forces,
            contact_areas=LazyMapping(lambda: {pair: patch.area for pair, patch in patches.items()}),
            peak_pressures=LazyMapping(lambda: {pair: patch.peak for pair, patch in patches.items()}),
            tactile=LazyMapping(lambda: self._patches.tactile(state)) if model.scene.tactile_arrays else {},
            cameras={} if self.look is None else LazyValues(model.scene.cameras, partial(self.look, state)),
            clipped=clipped(model, state),
            state=state,
        )

    def _actuators(self, state: State) -> dict[str, Any]:
        """The fields of an observation that say how actuators are."""
        actuators = self._model.actuators
        coordinates, found = actuators.own_coordinates(state), {}
        for kind in ACTUATOR_KINDS:
            names = actuators.names_of(kind)
            figures: list[tuple[ActuatorFigure, np.ndarray]] = [
                (kind.effort, state.actuator_effort),
                (kind.coordinate, coordinates),
                (kind.value, state.actuator_value),
            ]
            if kind.rate is not None:
                figures.append((kind.rate, self._rates(state) if names else coordinates))
            for figure, values in figures:
                if figure.observed:
                    found[figure.observed] = _numbers(names, actuators.of(kind, values))
            for further in kind.figures:
                found[further.observed] = _numbers(names, getattr(state, further.field))
        found["pressure_targets"] = self._pressure_targets(state)
        return found

    def _pressure_targets(self, state: State) -> Mapping[str, float]:
        actuators = self._model.actuators
        is_driven = actuators.takes_effort & ~state.actuator_imposed
        targets = zip(self._model.cavities.names, actuators.of(CAVITIES, state.actuator_target).tolist(), strict=True)
        driven = actuators.of(CAVITIES, is_driven).tolist()
        return MappingProxyType(dict(one for one, is_one in zip(targets, driven, strict=True) if is_one))

    def _rates(self, state: State) -> np.ndarray:
        """Rates of all actuators' values [mm^3/s] or [mm/s], shape (actuator_count,)."""
        model, actuators = self._model, self._model.actuators
        self._geometry.update(state, model.placed_pull_points(state))
        rigid_velocity = np.concatenate([state.rigid_velocity, state.rigid_angular_velocity], axis=1)
        rates = self._geometry.rates(state.velocity, rigid_velocity)
        return actuators.sign * rates[actuators.first_coordinate[:-1]]


def _copied(seen: Observation) -> Observation:
    """An observation with arrays of its own: compiled functions, such as scipy's of rotations, need writable ones."""
    own: dict[str, Any] = {
        name: MappingProxyType({key: values.copy() for key, values in getattr(seen, name).items()})
        for name in ARRAYS_BY_NAME
        if name != "tactile"
    }
    own["tactile"] = LazyMapping(lambda: {name: values.copy() for name, values in seen.tactile.items()})
    own |= {name: getattr(seen, name).copy() for name in ARRAYS_OF_BASE}
    return replace(seen, **own)


def _by_name(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, np.ndarray]:
    return dict(zip(names, values, strict=True))


def _numbers(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, float]:
    return MappingProxyType(dict(zip(names, values.tolist(), strict=True)))
