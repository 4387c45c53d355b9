"""Contacts at the predicted positions of the bodies.

The inequality of a contact is linear in the velocities of the step, and accurate to second order around the place of
the measurement. So contacts are measured at the end of the step under constant velocities: a rolling ball then touches
the ground below its centre, and a body that flies past an edge is past the edge and not in front of it.

No pair of bodies may penetrate before that. If two bodies could approach each other by more than the contact
distance, conservative advancement (Mirtich 1996, Impulse-based Dynamic Simulation of Rigid Body Systems) finds the
first time at which they come close, and their contacts are measured then; so no body passes through another at any
speed. Bodies that overlap at the start of the step are measured at the start, because their depth counts.

Where a body is stopped short of its place at the end of the step, or turns on an arc, contacts are sought farther.

How far is enough shows when the motion is found: what it moves two bodies against each other, from where they were
measured, must lie within the reach of the search. Else they are sought again, that far; those that pressed each other
in the last step where they touched, since that is where they are until the law of contact parts them. And where the
motion bends surfaces so far that they come too close, their contacts there are added.
"""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from taichisoft.contact.detection import NO_CONTACTS, ContactDetection, ContactTable
from taichisoft.contact.kernels import box_trees as kernels
from taichisoft.contact.kernels.box_trees import FAR, FAST, TOO_CLOSE, BodyPairs
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.model import Model
from taichisoft.contact.surfaces import MovingSurfaces
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.mechanics.state import State
from taichisoft.step.points_of_step import PointsOfStep

# Contacts, and the fraction of the step at which each was measured, shape (capacity,).
Part = tuple[Contacts, np.ndarray]
# Fractions of the contact distance: two surfaces are advanced until their distance is between these two.
NEAREST, NEAR = 0.5, 0.75
# Range in which contacts are sought again, over the displacement without them.
AMPLE = 1.5
# Fraction of the step of a contact that is put back to the start: not 0, at which an overlap was there and may stay.
AT_ONCE = 1e-9
FIRST_CAPACITY = 1024


class ContactPrediction:
    """Finds the contacts of a step; holds the work space of one simulation."""

    def __init__(self, model: Model, rigid: RigidState, points: PointsOfStep):
        """Prepare for the bodies of `model`; the rigid ones have the poses and velocities of `rigid`."""
        settings, surfaces = model.scene.contact, model.surfaces
        self._surfaces, self._rigid_now, self._points = surfaces, rigid, points
        self._rigid = rigid._replace(linear=np.zeros_like(rigid.linear), angular=np.zeros_like(rigid.angular))
        self._time_step = model.scene.time.step
        self._tolerance = surfaces.gap_tolerance
        self._distance = settings.contact_distance
        self._moving = MovingSurfaces(surfaces)
        self._detection = ContactDetection(surfaces, self._moving, settings.contact_distance)
        self._soft = kernels.NodeMotion(
            body_start=np.array([*(body.nodes.start for body in model.soft_bodies), model.node_count], dtype=np.int32),
            position=points.node_before,
            velocity=points.node_velocity,
        )
        body_count = len(model.body_names)
        self._pairs = BodyPairs(
            may_touch=surfaces.may_touch.astype(np.int32),
            may_pass_through=surfaces.may_pass_through.astype(np.int32),
            least_reach=np.full((body_count, body_count), settings.alarm_distance),
            rigid_radius=np.array([body.radius for body in model.rigid_bodies], dtype=float),
            centre=np.zeros((body_count, 3)),
            radius=np.zeros(body_count),
            bend=np.zeros(body_count),
            approach=np.zeros((body_count, body_count)),
            reach=np.zeros((body_count, body_count)),
            nearest=np.zeros((body_count, body_count)),
            count=np.zeros(2, dtype=np.int32),
        )
        self._table = NO_CONTACTS
        self._gravity: np.ndarray | None = None  # of `_falls`
        self._buffers, self._fraction = Contacts.with_room(FIRST_CAPACITY), np.zeros(FIRST_CAPACITY)
        self._at_the_end = np.ones(FIRST_CAPACITY)
        self._depth = settings.alarm_distance
        self._whole = np.ones((body_count, body_count))
        self._is_needed = bool(surfaces.may_touch.any())
        self._change = self._soft._replace(velocity=np.zeros((model.node_count, 3)))
        self._rigid_change = rigid._replace(linear=np.zeros_like(rigid.linear), angular=np.zeros_like(rigid.angular))
        self._is_static = model.scene.time.dynamics == "static"
        # Of the last search: what was sought how far, after which part of the step; of the last look: what it found.
        self._sought, self._passed, self._approach = (np.zeros((body_count, body_count)) for _ in range(3))
        self._displacements = self._approach, self._approach
        self._is_at_the_end: bool = True
        self._is_bent: bool = False
        self._look: ContactDetection | None = None
        self._ahead = Contacts.with_room(0)

    def find(self, state: State) -> ContactTable:
        """Find all locally closest pairs that can matter in the step that begins with `state`."""
        if not self._is_needed:
            return NO_CONTACTS
        self._table = self._table.holding(*self._find_contacts(state))
        return self._table

    def missed(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> np.ndarray | None:
        """Whether two bodies may have met out of the reach of the search, or come too close where surfaces bent.

        In statics steps are as short as the reach demands, see `EquilibriumSearch`.

        Returns:
            Whether it is so of each two bodies, shape (body_count, body_count); None: of none.
        """
        if not self._is_needed or self._is_static:
            return None
        np.subtract(node_velocity, self._soft.velocity, out=self._change.velocity)
        np.subtract(rigid_velocity[:, :3], self._rigid.linear, out=self._rigid_change.linear)
        np.subtract(rigid_velocity[:, 3:], self._rigid.angular, out=self._rigid_change.angular)
        change = self._approach_of_change()
        may_touch = self._surfaces.may_touch
        is_short = may_touch & (self._sought < self._distance + change)
        bends = may_touch & (change > NEAREST * self._distance) & (self._passed > 0.0)
        if self._is_at_the_end and not np.count_nonzero(is_short | bends):
            return None
        # Where a part f of the step had passed, the rest of it, with the change, or all of it, less that part.
        self._set_change(node_velocity, rigid_velocity)
        self._displacements = change, self._approach_of_change()
        is_short = may_touch & (self._sought < self._distance + self._bounds())
        self._is_bent = not bool(is_short.any())
        if self._is_bent and bends.any():
            is_short = self._too_close_after(node_velocity, rigid_velocity, bends)
        return is_short if is_short.any() else None

    def _too_close_after(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Which of these pairs of bodies are nearer than part of the contact distance after a motion."""
        if self._look is None:
            self._look = ContactDetection(self._surfaces, self._moving, self._distance)
        self._set_change(node_velocity, rigid_velocity)
        self._moving.move(self._time_step, self._change, self._rigid_change)
        self._moving.follow_load(self._state)
        change = self._displacements[0]  # how deep they may be, at most
        self._ahead = self._look.find(np.where(pairs, change, -1.0), self._depth + float(change[pairs].max()))
        kernels.measure_nearest(self._ahead, self._distance, self._tolerance, self._pairs)
        too_close: np.ndarray = np.less(self._pairs.nearest, NEAREST * self._distance)
        return too_close

    def find_farther(self, pairs: np.ndarray) -> ContactTable | None:
        """Find the contacts again, of these pairs of bodies as far as `missed` has seen them move; None: no others."""
        if self._is_bent:
            return self._with_contacts_ahead()
        pressed = np.zeros_like(pairs)
        pressed[tuple(self._state.contact_body_pair[self._state.contact_impulse.any(axis=1)].T)] = True
        again, count = pairs & (pressed | pressed.T) & (self._passed > 0.0), self._table.contact_count
        self._passed[again] = 0.0
        self._sought = np.where(pairs, self._distance + AMPLE * self._bounds(), self._sought)
        self._is_at_the_end = not (self._passed < 1.0).any()
        measured = self._measure_all(self._passed.copy(), self._sought.copy())
        if measured[0].count[0] == count and not again.any():
            return None
        self._table = self._table.holding(*measured)
        return self._table

    def _with_contacts_ahead(self) -> ContactTable:
        """The contacts found so far, and those at the end of the motion that `missed` looked at, where these are known.

        Each of the latter is put back by the ways of its points, as if it had been measured at the start: its gap is
        then linear around the end of that motion.
        """
        count, near = self._table.contact_count, self._ahead.distance[: self._ahead.count[0]] < self._distance
        ahead = _part_of(self._ahead, near)
        for side in range(2):
            displacements, shifts = self._displacements_of_points(ahead, side)
            ahead.points[:, side] -= shifts
            ahead.distance[:] -= (2 * side - 1) * np.einsum("ci,ci->c", ahead.normal, displacements)
        features, again = (one.vertices[: one.count[0]].reshape(-1, 1, 6) for one in (self._table.found, ahead))
        kept = ~(features == again.reshape(1, -1, 6)).all(axis=2).any(axis=1)
        parts = (
            (_part_of(self._table.found, kept), self._table.fraction[:count][kept]),
            (ahead, np.full(ahead.count[0], AT_ONCE)),
        )
        self._table = self._table.holding(*self._joined(parts))
        return self._table

    def _displacements_of_points(self, contacts: Contacts, side: int) -> tuple[np.ndarray, np.ndarray]:
        """Ways of the points on a side in the motion looked at, and those without turning [mm], shape (count, 3)."""
        carriers, motion, vertices = self._surfaces.carriers, self._rigid_change, contacts.vertices[:, side]
        soft_count, rigid_count = len(self._soft.body_start) - 1, len(motion.position)
        displacements = np.zeros_like(contacts.normal)
        on_soft = contacts.bodies[:, side] < soft_count
        weights = contacts.weights[on_soft, side, :, None] * carriers.weights[vertices[on_soft]]
        nodes = carriers.nodes[vertices[on_soft]]
        displacements[on_soft] = self._time_step * np.einsum("cvn,cvni->ci", weights, self._change.velocity[nodes])
        body = contacts.bodies[:, side] - soft_count
        on_rigid = (body >= 0) & (body < rigid_count)
        body = body[on_rigid]
        shifts = self._time_step * motion.linear[body]
        arms = contacts.points[on_rigid, side] - motion.position[body] - shifts
        displacements[on_rigid] = shifts + self._time_step * np.cross(motion.angular[body], arms)
        straight = displacements.copy()
        straight[on_rigid] = shifts
        return displacements, straight

    def _bounds(self) -> np.ndarray:
        """Bounds of the ways of bodies against each other from where they were measured [mm]."""
        change, whole = self._displacements
        return np.minimum(change + (1.0 - self._passed) * self._approach, whole + self._passed * self._approach)

    def _approach_of_change(self) -> np.ndarray:
        """Bounds of the approach of bodies with the velocities of the change [mm], shape (body_count, body_count)."""
        kernels.measure_approach(self._time_step, self._change, self._rigid_change, self._pairs)
        return self._pairs.approach.copy()

    def _set_change(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> None:
        self._change.velocity[:] = node_velocity
        self._rigid_change.linear[:], self._rigid_change.angular[:] = rigid_velocity[:, :3], rigid_velocity[:, 3:]

    def _find_contacts(self, state: State) -> Part:
        self._state, pairs = state, self._pairs
        self._points.begin(state)
        self._rigid.linear[:], self._rigid.angular[:] = self._rigid_now.linear, self._rigid_now.angular
        if state.gravity is not self._gravity:
            self._gravity = state.gravity
            self._falls = self._time_step**2 * math.sqrt(state.gravity @ state.gravity)
        kernels.look_ahead(self._time_step, self._distance, self._falls, self._soft, self._rigid, pairs)
        self._approach, self._sought, self._passed = pairs.approach.copy(), pairs.reach.copy(), self._whole.copy()
        self._is_at_the_end = not pairs.count[FAST]
        if pairs.count[FAST]:
            return self._find_on_the_move()
        contacts = self._search(pairs.reach, 1.0)
        if pairs.count[TOO_CLOSE]:
            return self._joined(self._with_overlaps(contacts, pairs.reach, 1.0))
        if len(self._at_the_end) < len(contacts.distance):
            self._at_the_end = np.ones(len(contacts.distance))
        return contacts, self._at_the_end

    def _find_on_the_move(self) -> Part:
        """The contacts of a step in which bodies could pass through each other."""
        may_touch, approach = self._surfaces.may_touch, self._approach
        fraction = np.where(may_touch, 1.0, np.nan)
        self._find_approach_times(self._surfaces.may_pass_through & (approach > self._distance), approach, fraction)
        # The rest of the step after a pair was measured, arcs, the fall by gravity, and the effect of other impacts.
        strikes = fraction < 1.0
        struck = float(approach[strikes].max()) if strikes.any() else 0.0
        bend = self._pairs.bend[:, None] + self._pairs.bend
        reach = self._distance + (1.0 - fraction) * approach + bend + self._falls + struck
        reach = np.maximum(reach, self._pairs.least_reach)
        self._passed, self._sought = np.where(may_touch, fraction, 1.0), np.where(may_touch, reach, -1.0)
        return self._measure_all(fraction, reach)

    def _measure_all(self, fraction: np.ndarray, reach: np.ndarray) -> Part:
        """Contacts of each two bodies within their reach, after their fraction of the step."""
        times = np.unique(fraction[self._surfaces.may_touch]).tolist()
        return self._joined(
            part for time in times for part in self._measure(np.where(fraction == time, reach, -1), time)
        )

    def _find_approach_times(self, fast: np.ndarray, approach: np.ndarray, fraction: np.ndarray) -> None:
        """Fill in the fraction of the step after which fast bodies first come close, 0 if too close at the start."""
        reach = np.where(fast, self._distance + approach, -1.0)
        self._search(reach, 0.0)
        nearest = self._pairs.nearest.copy()
        for first, second in zip(*np.nonzero(np.triu(nearest < FAR)), strict=True):
            pair, time = (first, second), 0.0
            distance = nearest[pair]
            follows = distance >= self._distance - self._tolerance[pair]
            while follows:
                time += (distance - NEAREST * self._distance) / approach[pair]
                if time >= 1.0:
                    time = 1.0
                    break
                only = np.full_like(reach, -1.0)
                only[pair] = only[pair[::-1]] = self._distance + (1.0 - time) * approach[pair]
                self._search(only, time)
                distance = self._pairs.nearest[pair]
                follows = distance > NEAR * self._distance
            fraction[pair] = fraction[pair[::-1]] = time

    def _measure(self, reach: np.ndarray, time: float) -> Iterator[Part]:
        """Contacts within reach at a time (0: start, 1: end of the step); overlaps at the start are measured then.

        Each part is valid until the next one is requested.
        """
        contacts = self._search(reach, time)
        if time == 1.0 and self._pairs.count[TOO_CLOSE]:
            yield from self._with_overlaps(contacts, reach, time)
        else:
            yield contacts, np.full(contacts.count[0], time)

    def _with_overlaps(self, contacts: Contacts, reach: np.ndarray, time: float) -> Iterator[Part]:
        """Contacts at the end of the step, with contacts at the start for bodies that overlap there."""
        too_close = self._too_close()
        farther = self._farther(reach, too_close)
        ahead = (contacts if farther is reach else self._search(farther, time)).trimmed()
        at_start = self._search(np.where(too_close, farther, -1.0), 0.0)
        overlapping = self._too_close()
        if overlapping.any():
            self._passed[overlapping], self._is_at_the_end = 0.0, False
        self._sought = np.maximum(self._sought, farther)
        for chosen, when in ((_chosen(at_start, overlapping), 0.0), (_chosen(ahead, ~overlapping), time)):
            yield chosen, np.full(chosen.count[0], when)

    def _farther(self, reach: np.ndarray, too_close: np.ndarray) -> np.ndarray:
        """A reach with the ways of the rigid bodies that others stop short of where they would be."""
        path = self._time_step * (np.linalg.norm(self._pairs.centre, axis=1) + self._pairs.radius)
        path[: len(self._soft.body_start) - 1] = 0.0
        path *= too_close.any(axis=1)
        return np.where(reach < 0.0, reach, reach + path[:, None] + path) if path.any() else reach

    def _joined(self, parts: Iterable[Part]) -> Part:
        buffers, fraction, count = self._buffers, self._fraction, 0
        for contacts, when in parts:
            end = count + contacts.count[0]
            if end > len(buffers.distance):
                larger, fractions = Contacts.with_room(2 * end), np.zeros(2 * end)
                for new, old in zip((*larger[1:], fractions), (*buffers[1:], fraction), strict=True):
                    new[:count] = old[:count]
                buffers, fraction = self._buffers, self._fraction = larger, fractions
            for target, source in zip(buffers[1:], contacts[1:], strict=True):
                target[count:end] = source[: end - count]
            fraction[count:end] = when
            count = end
        buffers.count[0] = count
        return buffers, fraction

    def _too_close(self) -> np.ndarray:
        """Whether two bodies were too close in the last search, shape (body_count, body_count)."""
        too_close: np.ndarray = self._pairs.nearest < self._distance - self._tolerance
        return too_close

    def _search(self, reach: np.ndarray, time: float) -> Contacts:
        """Contacts within reach at a time (0: start, 1: end of the step); also measures the distances of bodies."""
        passed = self._time_step if time == 1.0 else time * self._time_step
        self._moving.move(passed, self._soft, self._rigid)
        self._moving.follow_load(self._state)
        contacts = self._detection.find(reach, self._depth)
        kernels.measure_nearest(contacts, self._distance, self._tolerance, self._pairs)
        return contacts


def _chosen(contacts: Contacts, pairs: np.ndarray) -> Contacts:
    count = contacts.count[0]
    return _part_of(contacts, pairs[tuple(contacts.bodies[:count].T)])


def _part_of(contacts: Contacts, kept: np.ndarray) -> Contacts:
    count = len(kept)
    return Contacts(np.array([kept.sum()], dtype=np.int32), *(array[:count][kept] for array in contacts[1:]))
