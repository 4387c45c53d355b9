"""Which contacts take part in the constraint problem of a step.

Most contacts found stay open: in a grasp five of six. Their rows of the compliance cost as much as those of the others,
and give nothing but an inequality that holds. So the problem is solved with those that are expected to push; then the
motion found is checked against all others, and if some would close after all, it is solved again with them. The answer
is the same as with all, to the tolerance of the solver.
"""

import numpy as np

from taichisoft.kernels import constraint_rows as kernels
from taichisoft.kernels.contacts import Contacts
from taichisoft.kernels.rigid_motion import RigidState
from taichisoft.model import Model

# A contact is expected to push if it did in the last step, or would close within this many steps as it moves now.
STEPS_AHEAD = 2.0


class ActiveSet:
    """Separation speeds of all contacts of a step.

    Attributes:
        separation: gap rates and speeds of all contacts.
        chosen: contacts that take part, shape (contact_count,).
    """

    def __init__(self, model: Model, rigid: RigidState):
        """Watch the contacts between soft bodies and these rigid bodies."""
        self._model = model
        self._rigid = rigid
        self.separation = kernels.Separation(np.empty(0), np.empty(0))

    def begin(self, contacts: Contacts, last_impulse: np.ndarray, node_velocity: np.ndarray) -> None:
        """Choose the contacts that are expected to push.

        Args:
            contacts: all of the step.
            last_impulse: of each in the last step, 0 where it is new [mN s], shape (contact_count, 3).
            node_velocity: of the soft nodes in the last step [mm/s], shape (node_count, 3).
        """
        self._contacts, self._count = contacts, len(last_impulse)
        capacity = len(contacts.distance)
        if capacity != len(self.separation.speed):
            self.separation = kernels.Separation(np.empty(capacity), np.empty(capacity))
        self._gap_rate, self._speed = (values[: self._count] for values in self.separation)
        np.subtract(contacts.distance[: self._count], self._model.scene.contact.contact_distance, out=self._gap_rate)
        np.divide(self._gap_rate, self._model.scene.time.step, out=self._gap_rate)
        self._measure_speeds(node_velocity)
        self.chosen = last_impulse.any(axis=1)
        self.chosen |= self._gap_rate + STEPS_AHEAD * self._speed <= 0.0

    def add_violated(self, node_velocity: np.ndarray) -> bool:
        """Add the contacts that these velocities [mm/s], and those of the rigid bodies, close; were there any?"""
        if self.chosen.all():
            return False
        self._measure_speeds(node_velocity)
        violated = self._gap_rate + self._speed < -self._model.scene.contact.tolerance
        violated &= ~self.chosen
        self.chosen |= violated
        return bool(violated.any())

    def _measure_speeds(self, node_velocity: np.ndarray) -> None:
        kernels.separation_speed(
            len(self._model.soft_bodies),
            self._contacts,
            self._model.surfaces.carriers,
            node_velocity,
            self._rigid,
            self.separation,
        )
