"""Which contacts take part in the constraint problem of a step.

Most contacts found stay open: in a grasp five of six, on a finely triangulated ball nearly all. Their rows of the
compliance cost as much as those of the others, and give nothing but an inequality that holds. So the problem is solved
with those that pushed in the last step or are expected to push; then the motion found is checked against all others,
and if some would close after all, it is solved again with the worst of each neighbourhood. What comes out keeps all
contacts apart, whichever it began with: constraint generation.
"""

import numpy as np

from taichisoft.contact.reduction import ContactReduction
from taichisoft.kernels import constraint_rows as kernels
from taichisoft.kernels.contacts import Contacts
from taichisoft.kernels.rigid_motion import RigidState
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.contact_prediction import Found

# A contact is expected to push if it would close within this many steps as it moves now.
STEPS_AHEAD = 2.0


class ActiveSet:
    """Gaps and separation speeds of all contacts of a step, and which of them take part.

    Attributes:
        contacts: all of the step.
        separation: arms, gap rates and speeds of them.
        depth: by how much less than the contact distance each contact was apart at the start of the step [mm], 0 or
            negative, shape (contact_count,).
        resting_speed: approach below which nothing bounces, that by which gravity adds to it in a step [mm/s].
        gap: of each contact at the end of the step with the velocities last measured [mm], shape (contact_count,).
    """

    def __init__(self, model: Model, rigid: RigidState):
        """Watch the contacts between soft bodies and these rigid bodies."""
        settings = model.scene.contact
        self._model, self._rigid = model, rigid
        self._time_step = model.scene.time.step
        self._reduction = ContactReduction(model.surfaces.body_size, settings.spacing, settings.contact_distance)
        self._gives_back = bool(model.restitution.any())
        self._make_room(0)

    def _make_room(self, capacity: int) -> None:
        self.separation = kernels.Separation.with_room(capacity)
        self._passed, self._measured_gap, self._touching = (np.zeros(capacity) for _ in range(3))

    @property
    def chosen(self) -> np.ndarray:
        """Contacts that take part, shape (contact_count,)."""
        return self._reduction.taking_part

    @property
    def last_impulse(self) -> np.ndarray:
        """Of each contact in the last step, 0 where it is new [mN s], shape (contact_count, 3)."""
        return self._reduction.impulse

    def begin(self, found: Found, state: State, node_velocity: np.ndarray) -> None:
        """Choose the contacts that are expected to push.

        Args:
            found: all of the step.
            state: at its start; the rigid bodies have its velocities.
            node_velocity: of the soft nodes then [mm/s], shape (node_count, 3).
        """
        self.contacts: Contacts = found.contacts
        capacity, count = len(found.contacts.distance), len(found.fraction)
        if capacity != len(self._passed):
            self._make_room(capacity)
        settings = self._model.scene.contact
        gap = found.contacts.distance[:count] - settings.contact_distance
        self._tolerance = self._model.surfaces.gap_tolerance[tuple(found.contacts.bodies[:count].T)]
        self._passed[:count] = self._time_step * found.fraction
        self._measured_gap[:count], self._touching[:count] = gap, self._tolerance
        kernels.place_arms(
            len(self._model.soft_bodies),
            found.contacts,
            self._passed,
            self._measured_gap,
            self._touching,
            self._model.surfaces.vertex_is_round,
            self._rigid,
            self.separation,
        )
        self._speed, self._gap_rate = self.separation.speed[:count], self.separation.gap_rate[:count]
        self._measure_speeds(node_velocity)
        passed = self._passed[:count] * self._speed
        at_start = np.where(found.fraction > 0.0, np.maximum(gap - passed, -self._tolerance), gap)
        self.depth = np.minimum(np.maximum(gap, at_start), 0.0)
        self._kept_depth = self.depth if settings.depth == "position" else np.zeros(count)
        self._gap_rate[:] = (gap - self._kept_depth - passed) / self._time_step
        self._reduction.begin(found.contacts, state)
        self._measure_gap()
        expected = self._gap_rate + STEPS_AHEAD * self._speed <= 0.0
        if self._gives_back:
            # An impact may throw anything at its neighbours, as fast as the fastest approach.
            fastest = self._speed.min(initial=0.0)
            expected |= self._time_step * (self._gap_rate + self._speed + 2.0 * fastest) < self._tolerance
        self.resting_speed = max(settings.tolerance, self._time_step * float(np.linalg.norm(state.gravity)))
        self._reduction.add(expected, self.gap, beside=False)

    def add_violated(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that these velocities [mm/s], and those of the rigid bodies, close; were there any?"""
        self._measure_speeds(node_velocity)
        self._measure_gap()
        least = np.minimum(self._kept_depth - self._time_step * self._model.scene.contact.tolerance, -self._tolerance)
        return self._reduction.add(self.gap < least, self.gap, beside=True)

    def add_deep(self) -> bool:
        """Add contacts that overlap at the end of the step; are there any?"""
        deep = self.gap < -self._tolerance
        self._reduction.add(deep, self.gap, beside=True)
        return bool(deep.any())

    def add_left_deep(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that overlap after a shift by these velocities [mm/s] and those of the rigid bodies."""
        self._measure_speeds(node_velocity)
        left = self.gap + self._time_step * self._speed
        return self._reduction.add(left < -self._tolerance, left, beside=True)

    def worth_telling(self) -> np.ndarray:
        """Numbers of the contacts that take part, and of the closest one of bodies that are near without any."""
        chosen, count = self.chosen, len(self.gap)
        first, second = self.contacts.bodies[:count].T
        takes_part = np.zeros((len(self._model.body_names),) * 2, dtype=bool)
        takes_part[first[chosen], second[chosen]] = True
        distance = self.contacts.distance[:count]
        others = np.flatnonzero((distance < self._model.scene.contact.alarm_distance) & ~takes_part[first, second])
        told = np.flatnonzero(chosen)
        if not len(others):
            return told
        others = others[np.argsort(distance[others], kind="stable")]
        pair = first[others] * len(takes_part) + second[others]
        return np.sort(np.concatenate([told, others[np.unique(pair, return_index=True)[1]]]))

    def _measure_gap(self) -> None:
        self.gap = self._time_step * (self._gap_rate + self._speed) + self._kept_depth

    def _measure_speeds(self, node_velocity: np.ndarray) -> None:
        kernels.separation_speed(
            len(self._model.soft_bodies),
            self.contacts,
            self._model.surfaces.carriers,
            node_velocity,
            self._rigid,
            self.separation,
        )
