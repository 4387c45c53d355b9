"""What a controller sees, worked out from a state."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from taichisoft.bodies.cavities import CavityVolumes
from taichisoft.control.contact_summary import ContactSummary, summarise_contacts
from taichisoft.control.fingertips import Fingertips
from taichisoft.control.limits import clipped
from taichisoft.control.observation import Observation
from taichisoft.model import Model
from taichisoft.state import State


class Observer:
    """Makes observations of a model's states; they depend on the state alone, so that a restored run is seen alike."""

    def __init__(self, model: Model, volumes: CavityVolumes):
        """Find the fingertips; `volumes` are those of the model's cavities.

        Raises:
            SceneError: a tip cannot show a rotation.
        """
        self._model, self._volumes = model, volumes
        self._fingertips = Fingertips(model.soft_bodies)
        self._object_names = tuple(body.name for body in model.rigid_bodies)
        self._summarised: State | None = None
        self._contacts = ContactSummary()

    def contacts(self, state: State) -> ContactSummary:
        """The contacts of the step that led to `state`; worked out once."""
        if state is not self._summarised:
            self._summarised, self._contacts = state, summarise_contacts(self._model, state)
        return self._contacts

    def observe(self, state: State) -> Observation:
        """What a controller sees before the step that follows `state`."""
        model, tips, contacts = self._model, self._fingertips, self.contacts(state)
        cavities = model.cavities
        tip_positions, tip_velocities, bending_angles = tips.observe(state)
        return Observation(
            time=state.time,
            step=state.step,
            pressures=_numbers(cavities.names, state.cavity_pressure),
            volumes=_numbers(cavities.names, state.cavity_volume),
            flows=_numbers(cavities.names, self._volumes.flows(state.position, state.velocity)),
            tip_positions=_by_name(tips.names, tip_positions),
            tip_velocities=_by_name(tips.names, tip_velocities),
            bending_angles=_numbers(tips.names, bending_angles),
            base_translation=_read_only(state.base_translation),
            base_rotation=_read_only(state.base_rotation),
            object_positions=_by_name(self._object_names, state.rigid_position),
            object_rotations=_by_name(self._object_names, state.rigid_rotation),
            object_velocities=_by_name(self._object_names, state.rigid_velocity),
            object_angular_velocities=_by_name(self._object_names, state.rigid_angular_velocity),
            contact_counts=MappingProxyType(contacts.counts),
            normal_forces=MappingProxyType(contacts.normal_forces),
            friction_forces=MappingProxyType(contacts.friction_forces),
            slip_speeds=MappingProxyType(contacts.slip_speeds),
            clipped=clipped(model, state),
        )


def _read_only(values: np.ndarray) -> np.ndarray:
    view = values.view()
    view.flags.writeable = False
    return view


def _by_name(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, np.ndarray]:
    return MappingProxyType(dict(zip(names, _read_only(values), strict=True)))


def _numbers(names: tuple[str, ...], values: np.ndarray) -> Mapping[str, float]:
    return MappingProxyType(dict(zip(names, values.tolist(), strict=True)))
