"""Which contacts take part in the constraint problem of a step.

Most contacts found stay open: in a grasp five of six. Their rows of the compliance cost as much as those of the others,
and give nothing but an inequality that holds. So the problem is solved with those that are expected to push; then the
motion found is checked against all others, and if some would close after all, it is solved again with them. The answer
is the same as with all, to the tolerance of the solver.
"""

import numpy as np

from taichisoft.kernels import contact_rows
from taichisoft.kernels.contacts import Contacts
from taichisoft.model import Model
from taichisoft.step.rigid_motion import RigidMotion

# A contact is expected to push if it did in the last step, or would close within this many steps as it moves now.
STEPS_AHEAD = 2.0


class ActiveSet:
    """Separation speeds of all contacts of a step.

    Attributes:
        chosen: contacts that take part, shape (contact_count,).
    """

    def __init__(self, model: Model, rigid_motion: RigidMotion):
        """Watch the contacts of these bodies."""
        self._model = model
        self._rigid_motion = rigid_motion
        self._node_velocity = np.empty((model.node_count, 3))
        self._make_room(0)

    def _make_room(self, count: int) -> None:
        self._bodies = np.empty((count, 2), dtype=np.int32)
        self._vertices = np.empty((count, 2, 3), dtype=np.int32)
        self._vertex_weights = np.empty((count, 2, 3))
        self._points = np.empty((count, 2, 3))
        self._normal = np.empty((count, 3))
        self._speed = np.empty(count)

    def begin(self, contacts: Contacts, last_impulse: np.ndarray, node_velocity: np.ndarray) -> None:
        """Choose the contacts that are expected to push.

        Args:
            contacts: all of the step.
            last_impulse: of each in the last step, 0 where it is new [mN s], shape (contact_count, 3).
            node_velocity: of the soft nodes in the last step [mm/s], shape (node_count, 3).
        """
        if len(contacts.distance) != len(self._bodies):
            self._make_room(len(contacts.distance))
        if not len(contacts.distance):
            self.chosen = np.zeros(0, dtype=bool)
            return
        self._bodies[:] = contacts.bodies
        self._vertices[:] = contacts.vertices
        self._vertex_weights[:] = contacts.weights
        self._points[:] = contacts.points
        self._normal[:] = contacts.normal
        gap = contacts.distance - self._model.scene.contact.contact_distance
        self._gap_speed = gap / self._model.scene.time.step
        self._measure(node_velocity)
        self.chosen = last_impulse.any(axis=1) | (self._gap_speed + STEPS_AHEAD * self._speed <= 0.0)

    def add_missed(self, node_velocity: np.ndarray) -> bool:
        """Add the contacts that these velocities [mm/s], and those of the rigid bodies, close; were there any?"""
        if self.chosen.all():
            return False
        self._measure(node_velocity)
        missed = ~self.chosen & (self._gap_speed + self._speed < -self._model.scene.contact.tolerance)
        self.chosen |= missed
        return bool(missed.any())

    def _measure(self, node_velocity: np.ndarray) -> None:
        carriers, rigid = self._model.surfaces.carriers, self._rigid_motion
        self._node_velocity[:] = node_velocity
        contact_rows.separation_speed(
            len(self._model.soft_bodies),
            len(self._model.rigid_bodies),
            self._bodies,
            self._vertices,
            self._vertex_weights,
            self._points,
            self._normal,
            carriers.nodes,
            carriers.weights,
            carriers.owner,
            self._node_velocity,
            rigid.position,
            rigid.linear,
            rigid.angular,
            self._speed,
        )
