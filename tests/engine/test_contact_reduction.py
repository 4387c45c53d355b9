"""Which contacts go on from the last step and which are added, against the definitions written out in numpy."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import State, make_model
from taichisoft.contact.detection import LAST_STEP_CAPACITY, ContactReduction, ContactTable
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.scene import scene_from_dict

BODIES = 4
SIZE = np.array([100.0, 100.0, 5.0, np.inf])  # [mm]: contacts of body 2 may be as close as 1 mm
SPACING = 3.0
AXES = np.vstack([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def start() -> State:
    """A state without contacts."""
    return make_model(scene_from_dict({"rigid_bodies": {"box": {"box": [1, 1, 1], "mass": 1}}})).initial_state()


def after(start: State, contacts: Contacts) -> State:
    """The state after a step with these contacts; the impulse of each is its own number, that of the first is 0."""
    impulse = np.arange(len(contacts.distance))[:, None] * np.ones(3)
    return replace(
        start,
        contact_body_pair=contacts.bodies,
        contact_point=middle(contacts),
        contact_normal=contacts.normal,
        contact_impulse=impulse,
    )


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


def table_of(contacts: Contacts) -> ContactTable:
    """A table of contacts that are measured at the end of the step."""
    return ContactTable.with_room(contacts, np.ones(len(contacts.distance)))


def middle(contacts: Contacts) -> np.ndarray:
    """Midpoints [mm]."""
    return contacts.points.mean(axis=1)


def alike(first: Contacts, second: Contacts) -> np.ndarray:
    """Whether each of the first contacts has the bodies and the direction of each of the second."""
    same_bodies = (first.bodies[:, None] == second.bodies).all(axis=2)
    return same_bodies & (first.normal @ second.normal.T > 0.5)


def apart(first: Contacts, second: Contacts) -> np.ndarray:
    """Distances [mm] of all from all others."""
    return np.linalg.norm(middle(first)[:, None] - middle(second), axis=2)


@examples(100)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 40), last_count=st.integers(0, 2 * LAST_STEP_CAPACITY))
def test_what_pushed_goes_on_in_the_nearest_contact_that_is_still_free(
    start: State, seed: int, count: int, last_count: int
) -> None:
    random = np.random.default_rng(seed)
    last, contacts = some_contacts(random, last_count), some_contacts(random, count)
    reduction, table = ContactReduction(SIZE, SPACING, contact_distance=1.0), table_of(contacts)
    far = np.where(alike(last, contacts), apart(last, contacts), np.inf)
    expected = np.zeros(count)
    for number in range(1, last_count):
        nearest = far[number].argmin() if count else 0
        if count and far[number, nearest] < SPACING:
            expected[nearest] = number
            far[:, nearest] = np.inf
    for _ in range(2):
        reduction.begin(table, after(start, last))
        np.testing.assert_array_equal(table.impulse[:count], expected[:, None] * np.ones(3))
        np.testing.assert_array_equal(table.is_chosen, expected > 0.0)


def test_room_for_many_contacts_stays_when_there_are_fewer(start: State) -> None:
    """Arrays that change their place with every search are set up anew for every kernel."""
    random, reduction = np.random.default_rng(0), ContactReduction(SIZE, SPACING, contact_distance=1.0)
    many, few = table_of(some_contacts(random, 40)), some_contacts(random, 5)
    table = many.holding(few, np.ones(5))
    reduction.begin(table, start)
    assert table.choice is many.choice
    assert len(table.is_chosen) == 5
    assert reduction.add(table, np.ones(5, dtype=bool), few.distance, beside=True)
    assert 1 <= table.is_chosen.sum() <= 5
    assert len(table.holding(some_contacts(random, 41), np.ones(41)).impulse) == 41


@examples(100)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), beside=st.booleans())
def test_the_worst_of_each_neighbourhood_is_added(start: State, seed: int, count: int, beside: bool) -> None:
    """Of those added no two are near each other; each wanted one left out is near a worse one, or one from before."""
    random = np.random.default_rng(seed)
    contacts = some_contacts(random, count)
    before, wanted, gap = random.random(count) < 0.2, random.random(count) < 0.7, random.normal(size=count)
    pushing = Contacts(np.array([before.sum()]), *(array[before] for array in contacts[1:]))
    state = replace(after(start, pushing), contact_impulse=np.ones((before.sum(), 3)))
    reduction, table = ContactReduction(SIZE, SPACING, contact_distance=1.0), table_of(contacts)
    reduction.begin(table, state)
    before = table.is_chosen.copy()
    any_added = reduction.add(table, wanted, gap, beside)
    added = table.is_chosen & ~before
    assert any_added == added.any()
    assert table.is_chosen[before].all()
    assert wanted[added].all()
    spacing = np.minimum(SPACING, 0.2 * SIZE[contacts.bodies].min(axis=1))
    near = alike(contacts, contacts) & (apart(contacts, contacts) < spacing[:, None]) & ~np.eye(count, dtype=bool)
    assert not near[np.ix_(added, added)].any()
    blocked = (near & added & (gap <= gap[:, None])).any(axis=1)
    if not beside:
        blocked |= (near & before).any(axis=1)
        assert not near[np.ix_(added, before)].any()
    assert blocked[wanted & ~added & ~before].all()
