"""Which contacts take part in the constraint problem of a step.

Most contacts found stay open: in a grasp five of six, on a finely triangulated ball nearly all. Their rows of the
compliance cost as much as those of the others, and give nothing but an inequality that holds. So the problem is solved
with those that pushed in the last step or are expected to push; then the motion found is checked against all others,
and if some would close after all, it is solved again with the worst of each neighbourhood. What comes out keeps all
contacts apart, whichever it began with: constraint generation.
"""

import numpy as np

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact.kernels import separation as kernels
from taichisoft.contact.kernels.contact_reduction import Choice
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.kernels.separation import Separation
from taichisoft.contact.reduction import ContactReduction
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.contact_prediction import Found


class ActiveSet:
    """Gaps and separation speeds of all contacts of a step, and which of them take part.

    Attributes:
        contacts: all of the step.
        separation: arms, depths, gap rates and speeds of them.
        resting_speed: approach below which nothing bounces, that by which gravity adds to it in a step [mm/s].
    """

    def __init__(self, model: Model, rigid: RigidState):
        """Watch the contacts between soft bodies and these rigid bodies."""
        settings = model.scene.contact
        self._surfaces, self._rigid, self._first_rigid = model.surfaces, rigid, len(model.soft_bodies)
        self._time_step, self._tolerance = model.scene.time.step, settings.tolerance
        self._reduction = ContactReduction(model.surfaces.body_size, settings.spacing, settings.contact_distance)
        terms = np.zeros(kernels.TERMS)
        terms[kernels.TIME_STEP], terms[kernels.CONTACT_DISTANCE] = model.scene.time.step, settings.contact_distance
        terms[kernels.TOLERANCE], terms[kernels.KEEPS_DEPTH] = settings.tolerance, settings.depth == "position"
        terms[kernels.GIVES_BACK] = model.restitution.any()
        self.separation = Separation.with_room(0, terms)
        self._wanted_count = np.zeros(1, dtype=np.int32)

    @property
    def choice(self) -> Choice:
        """Which contacts take part, in arrays with room for more."""
        return self._reduction.choice

    @property
    def impulse(self) -> np.ndarray:
        """Of each contact: that of the last step, 0 where it is new, then what is found [mN s], (capacity, 3)."""
        return self._reduction.impulse

    @property
    def gap(self) -> np.ndarray:
        """Of each contact at the end of the step with the velocities last measured [mm], shape (contact_count,)."""
        return self.choice.gap[: self._count]

    @property
    def depth(self) -> float:
        """By how much less than the contact distance surfaces were apart at the start of the step, at most [mm]."""
        deepest = self.separation.deepest[0]
        return -float(self.separation.depth[deepest]) if deepest >= 0 else 0.0

    @property
    def deepest(self) -> tuple[int, ...]:
        """Numbers of the two bodies where that was; empty where surfaces were as far apart as they are kept."""
        deepest = self.separation.deepest[0]
        return tuple(self.contacts.bodies[deepest].tolist()) if deepest >= 0 else ()

    def begin(self, found: Found, state: State, node_velocity: np.ndarray) -> None:
        """Choose the contacts that are expected to push.

        Args:
            found: all of the step.
            state: at its start; the rigid bodies have its velocities.
            node_velocity: of the soft nodes then [mm/s], shape (node_count, 3).
        """
        self.contacts: Contacts = found.contacts
        self._count, capacity = int(found.contacts.count[0]), len(found.contacts.distance)
        if capacity > len(self.separation.speed):
            self.separation = Separation.with_room(capacity, self.separation.terms)
        self._reduction.begin(found.contacts, state)
        kernels.begin_separation(
            self._first_rigid,
            found.contacts,
            found.fraction,
            self._surfaces.gap_tolerance,
            self._surfaces.vertex_is_round,
            self._surfaces.carriers,
            node_velocity,
            self._rigid,
            self.separation,
            self.choice,
        )
        self.resting_speed = max(self._tolerance, self._time_step * float(np.linalg.norm(state.gravity)))
        self._reduction.add_wanted(beside=False)

    def add_violated(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that these velocities [mm/s], and those of the rigid bodies, close; were there any?"""
        self._find_violated(node_velocity)
        return bool(self._wanted_count[0]) and self._reduction.add_wanted(beside=True)

    def add_deep(self) -> bool:
        """Add contacts that overlap at the end of the step; are there any?"""
        deep = self.gap < self._deepest_left
        if not deep.any():
            return False
        self._reduction.add(deep, self.gap, beside=True)
        return True

    def add_left_deep(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that overlap after a shift by these velocities [mm/s] and those of the rigid bodies."""
        gap = self.gap.copy()
        self._find_violated(node_velocity)
        left = gap + self._time_step * self.separation.speed[: self._count]
        added = self._reduction.add(left < self._deepest_left, left, beside=True)
        self.gap[:] = gap
        return added

    @property
    def _deepest_left(self) -> np.ndarray:
        """Gap of each contact below which it is an overlap to remove [mm], shape (contact_count,).

        A contact that keeps the depth `touching` is one, whichever side of it the solver's tolerance leaves it: where
        round-off decided, a rolling ball ended with a speed that changed by 0.5 % from one try to the next.
        """
        return self._time_step * self._tolerance - self.separation.touching[: self._count]

    def _find_violated(self, node_velocity: np.ndarray) -> None:
        kernels.find_violated(
            self._first_rigid,
            self.contacts,
            self._surfaces.carriers,
            node_velocity,
            self._rigid,
            self.separation,
            self.choice,
            self._wanted_count,
        )
