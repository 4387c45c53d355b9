"""Contacts where the bodies are about to be.

The inequality of a contact is linear in the velocities of the step, and true to second order around the place where the
contact was measured. So surfaces are measured where they will be at the end of the step if they go on as they do now: a
ball that rolls touches the ground below its centre then, and what flies past an edge is past it and not in front of it.

No pair of bodies may reach into each other on the way there. Where two could approach each other by more than the
contact distance, conservative advancement (Mirtich 1996, Impulse-based Dynamic Simulation of Rigid Body Systems) finds
the first time at which they come close, and they are measured there; so nothing passes through at any speed. Bodies
that reach into each other at the start of the step are measured then, since their depth is what counts.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.contact.detection import ContactDetection
from taichisoft.contact.moving_surfaces import MovingSurfaces
from taichisoft.kernels.contacts import Contacts
from taichisoft.model import Model
from taichisoft.state import State

# Shares of the contact distance: two surfaces are followed until they are between these two apart.
NEAREST, NEAR = 0.5, 0.75
FIRST_CAPACITY = 1024


class Found(NamedTuple):
    """The contacts of a step, each as it is at some time of the step if all bodies keep their velocities.

    Attributes:
        contacts: the pairs of points, in arrays with room for more.
        fraction: of the step at which each one was measured, shape (contact_count,).
    """

    contacts: Contacts
    fraction: np.ndarray


class ContactPrediction:
    """Finds the contacts of a step; the work space of one simulation."""

    def __init__(self, model: Model):
        """Prepare for the bodies of `model`."""
        settings, surfaces = model.scene.contact, model.surfaces
        self._model, self._surfaces = model, surfaces
        self._time_step = model.scene.time.step
        self._tolerance = surfaces.gap_tolerance
        self._distance = settings.contact_distance
        smaller = np.minimum(surfaces.body_size[:, None], surfaces.body_size)
        self._least_reach = np.minimum(settings.alarm_distance, smaller)
        self._moving = MovingSurfaces(surfaces)
        self._detection = ContactDetection(surfaces, self._moving, settings.contact_distance)
        self._room = Contacts.with_room(FIRST_CAPACITY)
        self._rigid_radius = np.array([body.radius for body in model.rigid_bodies])
        self._depth = float(self._least_reach[surfaces.may_touch].max(initial=0.0))

    @property
    def is_needed(self) -> bool:
        """Whether anything can touch anything."""
        return bool(self._surfaces.may_touch.any())

    def find(self, state: State, rotation: np.ndarray) -> Found:
        """All locally closest pairs that can matter in a step.

        Args:
            state: at the start of the step.
            rotation: body axes of the rigid bodies then, shape (rigid_count, 3, 3).
        """
        self._state, self._rotation = state, rotation
        approach = self._approach()
        fraction = np.where(self._surfaces.may_touch, 1.0, np.nan)
        fast = self._surfaces.may_pass_through & (approach > self._distance)
        if fast.any():
            self._follow(fast, approach, fraction)
        reach = self._reach(approach, fraction)
        times = np.unique(fraction[self._surfaces.may_touch]).tolist() if fast.any() else [1.0]
        parts = (part for time in times for part in self._measure(np.where(fraction == time, reach, -1.0), time))
        return self._joined(parts)

    def _approach(self) -> np.ndarray:
        """The most by which points of two bodies approach each other in the step [mm], (body_count, body_count).

        The velocities of a body lie in a ball around one of them.
        """
        state, model = self._state, self._model
        count = len(model.body_names)
        centre, radius = np.zeros((count, 3)), np.zeros(count)
        for number, body in enumerate(model.soft_bodies):
            velocity = state.velocity[body.nodes]
            low, high = velocity.min(axis=0), velocity.max(axis=0)
            centre[number], radius[number] = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)
        rigid = slice(len(model.soft_bodies), len(model.soft_bodies) + len(model.rigid_bodies))
        centre[rigid] = state.rigid_velocity
        radius[rigid] = np.linalg.norm(state.rigid_angular_velocity, axis=1) * self._rigid_radius
        apart = np.linalg.norm(centre[:, None] - centre, axis=2)
        approach: np.ndarray = self._time_step * (apart + radius[:, None] + radius)
        return approach

    def _reach(self, approach: np.ndarray, fraction: np.ndarray) -> np.ndarray:
        """How far apart contacts are looked for [mm], (body_count, body_count).

        What is left of the step after the pair was measured, what gravity adds, and what an impact of other bodies may.
        """
        falls = self._time_step**2 * float(np.linalg.norm(self._state.gravity))
        strikes = fraction < 1.0
        struck = float(approach[strikes].max()) if strikes.any() else 0.0
        reach: np.ndarray = self._distance + (1.0 - fraction) * approach + falls + struck
        return np.maximum(reach, self._least_reach)

    def _follow(self, fast: np.ndarray, approach: np.ndarray, fraction: np.ndarray) -> None:
        """Fill in the times at which fast bodies first come close, 0 for those that are too close at the start."""
        reach = np.where(fast, self._distance + approach, -1.0)
        nearest = self._nearest(self._search(reach, 0.0))
        for first, second in zip(*np.nonzero(np.triu(np.isfinite(nearest))), strict=True):
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
                distance = self._nearest(self._search(only, time))[pair]
                follows = distance > NEAR * self._distance
            fraction[pair] = fraction[pair[::-1]] = time

    def _measure(self, reach: np.ndarray, time: float) -> Iterator[Found]:
        """The contacts within reach at this time; at the end, of bodies that overlap at the start, those of then.

        Each part stays as it is until the next one is asked for.
        """
        contacts = self._search(reach, time)
        too_close = time == 1.0 and self._nearest(contacts) < self._distance - self._tolerance
        if not np.any(too_close):
            yield Found(contacts, np.full(contacts.count[0], time))
            return
        ahead = contacts.trimmed()
        at_start = self._search(np.where(too_close, reach, -1.0), 0.0)
        overlapping = self._nearest(at_start) < self._distance - self._tolerance
        for chosen, when in ((_chosen(at_start, overlapping), 0.0), (_chosen(ahead, ~overlapping), time)):
            yield Found(chosen, np.full(chosen.count[0], when))

    def _joined(self, parts: Iterable[Found]) -> Found:
        """All of them, one after the other, in arrays that stay in place."""
        room, count, fractions = self._room, 0, []
        for part in parts:
            end = count + part.contacts.count[0]
            if end > len(room.distance):
                larger = Contacts.with_room(2 * end)
                for new, old in zip(larger[1:], room[1:], strict=True):
                    new[:count] = old[:count]
                room = self._room = larger
            for target, source in zip(room[1:], part.contacts[1:], strict=True):
                target[count:end] = source[: end - count]
            fractions.append(part.fraction)
            count = end
        room.count[0] = count
        return Found(room, np.concatenate(fractions))

    def _nearest(self, contacts: Contacts) -> np.ndarray:
        """Distance of each pair of bodies [mm], infinite where they have no contact, shape (body_count, body_count)."""
        nearest, count = np.full(self._surfaces.may_touch.shape, np.inf), contacts.count[0]
        first, second = contacts.bodies[:count].T
        np.minimum.at(nearest, (first, second), contacts.distance[:count])
        return np.minimum(nearest, nearest.T)

    def _search(self, reach: np.ndarray, time: float) -> Contacts:
        """Contacts within reach at this time."""
        state, passed = self._state, time * self._time_step
        rotation = self._rotation
        if passed and state.rigid_angular_velocity.any():
            rotation = _turns(passed * state.rigid_angular_velocity) @ rotation
        self._moving.update(
            state.position + passed * state.velocity, state.rigid_position + passed * state.rigid_velocity, rotation
        )
        self._moving.follow_load(state)
        return self._detection.find(np.where(self._surfaces.may_touch, reach, -1.0), self._depth)


def _turns(vector: np.ndarray) -> np.ndarray:
    """Matrices of rotation vectors [rad], (count, 3, 3)."""
    half = 0.5 * np.linalg.norm(vector, axis=1, keepdims=True)
    return matrices_from_quaternions(np.hstack([np.cos(half), 0.5 * np.sinc(half / np.pi) * vector]))


def _chosen(contacts: Contacts, pairs: np.ndarray) -> Contacts:
    """The contacts of these pairs of bodies."""
    count = contacts.count[0]
    kept = pairs[tuple(contacts.bodies[:count].T)]
    return Contacts(np.array([kept.sum()], dtype=np.int32), *(array[:count][kept] for array in contacts[1:]))
