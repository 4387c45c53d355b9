"""What a controller sees, worked out from a state."""

from collections.abc import Callable, Mapping
from functools import partial
from threading import Lock
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.actuators.cavities import CAVITIES
from taichisoft.actuators.kind import ActuatorFigure
from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.control.contact_patches import ContactPatches
from taichisoft.control.contact_summary import summarise_contacts
from taichisoft.control.fingertips import Fingertips
from taichisoft.control.frame_motion import observed_frames
from taichisoft.control.lazy_values import LazyValues
from taichisoft.control.limits import clipped
from taichisoft.control.observation import Observation
from taichisoft.control.sensor_chain import Sensors
from taichisoft.model import Model
from taichisoft.state import State

PARTS = {
    "tips": ("tip_positions", "tip_velocities", "bending_angles"),
    "objects": tuple(f"object_{kind}" for kind in ("positions", "rotations", "velocities", "angular_velocities")),
    "contacts": (
        *("contact_counts", "contact_points", "contact_forces"),
        *("normal_forces", "friction_forces", "slip_speeds"),
    ),
    "patches": ("contact_areas", "contact_area_errors", "peak_pressures", "peak_pressure_errors"),
    "tactile": ("tactile",),
    "clipped": ("clipped",),
    "rates": tuple(kind.rate.observed for kind in ACTUATOR_KINDS if kind.rate is not None),
}
"""Fields that are worked out together, by the part of an observation; all others are those of actuators and frames."""
PART_OF = {field: part for part, names in PARTS.items() for field in names}


class Observer:
    """Makes observations of a model's states; they depend on the state alone, so that a restored run is seen alike.

    Displays and pages observe from threads of their own while the simulation steps: the work space is the observer's,
    and one thread at a time uses it.
    """

    def __init__(self, model: Model):
        """Find the fingertips.

        Raises:
            SceneError: a tip cannot show a rotation, or a tactile array lies beside the surface of its body.
        """
        self._model = model
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        self._fingertips = Fingertips(model.soft_bodies, model.frames)
        self._object_names = tuple(body.name for body in model.rigid_bodies)
        self._contact_patches, self._sensors = ContactPatches(model), Sensors(model.scene)
        self._contact_patches.check_tactile_arrays()
        self.look: Callable[[State, str], Any] | None = None
        self._working = Lock()
        self._last: tuple[State, dict[str, dict[str, Any]]] | None = None

    def observe(self, state: State) -> Observation:
        """What a controller sees before the step that follows `state`, through the scene's sensors."""
        truth = self.truth(state)
        if not self._model.scene.sensors:
            return truth
        shown = self._sensors.readings(self._sensors.begin(state.sensor_memory, truth), truth)
        return _made_up({**vars(truth), **shown, "exact": truth})

    def truth(self, state: State) -> Observation:
        """The exact observation of a state; each part is worked out once, when somebody looks, and copied."""
        cameras = {} if self.look is None else LazyValues(self._model.scene.cameras, partial(self.look, state))
        period, work_out = self._model.control_period, partial(self._work_out, state)
        known = {"time": state.time, "step": state.step, "control_period": period, "exact": None, "state": state}
        return _made_up({**known, "cameras": cameras, "_work_out": work_out})

    def with_samples(self, state: State, start: State | None = None) -> State:
        """The state with what its sensors remember: from the one before the step, or as they begin without one."""
        if not self._model.scene.sensors:
            return state
        truth = self.truth(state)
        if start is None:
            return state.changed(sensor_memory=self._sensors.begin(state.sensor_memory, truth))
        return state.changed(sensor_memory=self._sensors.after(start.sensor_memory, truth))

    def _work_out(self, state: State, field: str) -> dict[str, Any]:
        """A field of an observation, with those of its part; arrays are the caller's own, who may write to them."""
        part = PART_OF.get(field, "frames" if field.startswith(("base_", "frame_")) else "actuators")
        with self._working:
            if self._last is None or self._last[0] is not state:
                self._last = state, {}
            known = self._last[1]
            if part not in known:
                known[part] = getattr(self, f"_{part}")(state)
            return {name: _own(value) for name, value in known[part].items()}

    def _tips(self, state: State) -> dict[str, Any]:
        tips = self._fingertips
        positions, velocities, angles = tips.observe(state)
        return {
            "tip_positions": _by_name(tips.names, positions),
            "tip_velocities": _by_name(tips.names, velocities),
            "bending_angles": _numbers(tips.names, angles),
        }

    def _frames(self, state: State) -> dict[str, Any]:
        return observed_frames(self._model, state)

    def _objects(self, state: State) -> dict[str, Any]:
        return {
            "object_positions": _by_name(self._object_names, state.rigid_position),
            "object_rotations": _by_name(self._object_names, state.rigid_rotation),
            "object_velocities": _by_name(self._object_names, state.rigid_velocity),
            "object_angular_velocities": _by_name(self._object_names, state.rigid_angular_velocity),
        }

    def _contacts(self, state: State) -> dict[str, Any]:
        contacts = summarise_contacts(self._model, state)
        return {
            "contact_counts": MappingProxyType(contacts.counts),
            "normal_forces": MappingProxyType(contacts.normal_forces),
            "friction_forces": MappingProxyType(contacts.friction_forces),
            "slip_speeds": MappingProxyType(contacts.slip_speeds),
            "contact_points": contacts.points,
            "contact_forces": contacts.forces,
        }

    def _patches(self, state: State) -> dict[str, Any]:
        patches = self._contact_patches.patches(state)
        figures = zip(PARTS["patches"], ("area", "area_error", "peak", "peak_error"), strict=True)
        return {
            field: MappingProxyType({pair: getattr(patch, figure) for pair, patch in patches.items()})
            for field, figure in figures
        }

    def _tactile(self, state: State) -> dict[str, Any]:
        return {"tactile": self._contact_patches.tactile(state) if self._model.scene.tactile_arrays else {}}

    def _clipped(self, state: State) -> dict[str, Any]:
        return {"clipped": clipped(self._model, state)}

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

    def _rates(self, state: State) -> dict[str, Any]:
        """Rates of the actuators' values [mm^3/s] or [mm/s], of the kinds that show them."""
        model, actuators = self._model, self._model.actuators
        self._geometry.update(state, model.placed_pull_points(state))
        rigid_velocity = np.concatenate([state.rigid_velocity, state.rigid_angular_velocity], axis=1)
        rates = self._geometry.rates(state.velocity, rigid_velocity)
        rates = actuators.sign * rates[actuators.first_coordinate[:-1]]
        shown = [(kind, kind.rate) for kind in ACTUATOR_KINDS if kind.rate is not None]
        return {rate.observed: _numbers(actuators.names_of(kind), actuators.of(kind, rates)) for kind, rate in shown}


def _made_up(known: dict[str, Any]) -> Observation:
    """An observation that works out all fields but those that are known when somebody looks at them."""
    seen = object.__new__(Observation)
    vars(seen).update(known)
    return seen


def _own(value: Any) -> Any:
    """A copy with arrays of its own: compiled functions, such as scipy's of rotations, need writable ones."""
    if isinstance(value, dict):
        return MappingProxyType({key: one.copy() for key, one in value.items()})
    return value.copy() if isinstance(value, np.ndarray) else value


def _by_name(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, np.ndarray]:
    return dict(zip(names, values, strict=True))


def _numbers(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, float]:
    return MappingProxyType(dict(zip(names, values.tolist(), strict=True)))
