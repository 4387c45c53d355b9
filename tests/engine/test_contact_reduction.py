"""The choice of contacts, and which of the last step they continue, against the definitions written out in numpy."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.building.simulation import make_model
from taichisoft.contact.reduction import FIRST_CAPACITY, ContactReduction
from taichisoft.kernels.contact_reduction import CLEARLY_CLOSER
from taichisoft.kernels.contacts import Contacts
from taichisoft.scenes.file import scene_from_dict
from taichisoft.state import State

BODIES = 4
SIZE = np.array([100.0, 100.0, 5.0, np.inf])  # [mm]: contacts of body 2 may be as close as 1 mm
SPACING = 3.0
AXES = np.vstack([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def start() -> State:
    """A state without contacts."""
    return make_model(scene_from_dict({"rigid_bodies": {"box": {"box": [1, 1, 1], "mass": 1}}})).initial_state()


def after(start: State, contacts: Contacts) -> State:
    """The state after a step with these contacts; the impulse of each is its own number."""
    impulse = np.arange(1.0, len(contacts.distance) + 1.0)[:, None] * np.ones(3)
    return replace(start, contact_body_pair=contacts.bodies, contact_point=middle(contacts), contact_impulse=impulse)


def some_contacts(random: np.random.Generator, count: int) -> Contacts:
    """Contacts in a space of 10 mm, in six directions."""
    first = random.integers(0, BODIES - 1, count)
    return Contacts(
        count=np.array([count], dtype=np.int32),
        bodies=np.column_stack([first, random.integers(first + 1, BODIES)]).astype(np.int32),
        vertices=random.integers(0, 100, (count, 2, 3)).astype(np.int32),
        weights=random.uniform(size=(count, 2, 3)),
        points=random.uniform(0.0, 10.0, (count, 2, 3)),
        normal=AXES[random.integers(0, 6, count)],
        distance=random.uniform(0.0, 5.0, count),
    )


def middle(contacts: Contacts) -> np.ndarray:
    """Midpoints [mm]."""
    return contacts.points.mean(axis=1)


def take(contacts: Contacts, chosen: np.ndarray | list[int]) -> Contacts:
    """A copy of the contacts with these numbers."""
    return Contacts(np.array([len(chosen)], dtype=np.int32), *(array[chosen] for array in contacts[1:]))


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances [mm] of all points from all others."""
    return np.linalg.norm(first[:, None] - second, axis=2)


def same_bodies(first: Contacts, second: Contacts) -> np.ndarray:
    """Whether each of the first contacts has the bodies of each of the second."""
    return (first.bodies[:, None] == second.bodies).all(axis=2)


@examples(100)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 40) | st.integers(FIRST_CAPACITY, 3 * FIRST_CAPACITY))
def test_what_is_dropped_is_near_a_closer_contact_that_is_kept(start: State, seed: int, count: int) -> None:
    """And of what is kept no two are near each other: alike in bodies and normal, and closer than the spacing. Nothing
    of a kept contact changes, and they keep their order."""
    found = some_contacts(np.random.default_rng(seed), count)
    kept = ContactReduction(SIZE, SPACING).reduce(found, start).trimmed()
    chosen = np.flatnonzero(np.isin(found.distance, kept.distance))
    for expected, field in zip(take(found, chosen), kept, strict=True):
        np.testing.assert_array_equal(field, expected)
    spacing = np.minimum(SPACING, 0.2 * SIZE[found.bodies].min(axis=1))
    near = apart(middle(found), middle(kept)) < spacing[:, None]
    near &= same_bodies(found, kept) & (found.normal @ kept.normal.T > 0.5)
    itself = found.distance[:, None] == kept.distance
    is_kept = itself.any(axis=1)
    assert not (near & ~itself)[is_kept].any()
    assert (near & (kept.distance < found.distance[:, None]))[~is_kept].any(axis=1).all()


@examples(100)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 40), last_count=st.integers(0, 2 * FIRST_CAPACITY))
def test_each_contact_continues_the_nearest_of_the_last_step_that_is_still_free(
    start: State, seed: int, count: int, last_count: int
) -> None:
    random = np.random.default_rng(seed)
    last, reduction = some_contacts(random, last_count), ContactReduction(SIZE, SPACING)
    contacts = reduction.reduce(some_contacts(random, count), start)
    for _ in range(2):
        impulse = reduction.last_impulses(contacts, after(start, last), radius=2.0)[: contacts.count[0]].copy()
        contacts = contacts.trimmed()
        far = apart(middle(contacts), middle(last))
        far[~same_bodies(contacts, last)] = np.inf
        for contact in range(contacts.count[0]):
            nearest = far[contact].argmin() if last_count else -1
            expected = nearest if last_count and far[contact, nearest] < 2.0 else -1
            assert impulse[contact].tolist() == 3 * [expected + 1.0]
            if expected >= 0:
                far[:, expected] = np.inf


def test_what_was_a_contact_stays_one_unless_another_is_clearly_closer(start: State) -> None:
    found = some_contacts(np.random.default_rng(0), 2)
    found.bodies[:], found.normal[:], found.points[:] = [0, 1], [0, 0, 1], 5.0
    found.points[1, :, 0] += 1.0
    last = after(start, take(found, [1]))
    for closer, chosen in ((0.9 * CLEARLY_CLOSER, 1), (1.1 * CLEARLY_CLOSER, 0)):
        found.distance[:] = [1.0 - closer, 1.0]
        kept = ContactReduction(SIZE, SPACING).reduce(found, last).trimmed()
        np.testing.assert_array_equal(kept.distance, found.distance[[chosen]])


def test_trimmed_contacts_stay_when_the_buffers_are_used_again(start: State) -> None:
    """They belong to the state, and must not follow the next step."""
    random, reduction = np.random.default_rng(1), ContactReduction(SIZE, SPACING)
    kept = reduction.reduce(some_contacts(random, 30), start).trimmed()
    before = kept.trimmed()
    reduction.reduce(some_contacts(random, 30), after(start, kept))
    for field, expected in zip(kept, before, strict=True):
        np.testing.assert_array_equal(field, expected)
