"""The choice of contacts, and which of the last step they continue, against the definitions written out in numpy."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from taichisoft.contact.selection import CLEARLY_CLOSER, FIRST_CAPACITY, ContactSelection

from taichisoft.contact.detection import ContactPairs

BODIES = 4
SIZE = np.array([100.0, 100.0, 5.0, np.inf])  # [mm]: contacts of body 2 may be as close as 1 mm
SPACING = 3.0
NO_CONTACTS = np.zeros(0, dtype=np.int32), np.zeros((0, 3))
AXES = np.vstack([np.eye(3), -np.eye(3)])


def some_pairs(random: np.random.Generator, count: int) -> ContactPairs:
    """Contacts in a space of 10 mm, in six directions."""
    first = random.integers(0, BODIES - 1, count)
    return ContactPairs(
        bodies=np.column_stack([first, random.integers(first + 1, BODIES)]).astype(np.int32),
        vertices=random.integers(0, 100, (count, 2, 3)).astype(np.int32),
        weights=random.uniform(size=(count, 2, 3)),
        points=random.uniform(0.0, 10.0, (count, 2, 3)),
        normal=AXES[random.integers(0, 6, count)],
        distance=random.uniform(0.0, 5.0, count),
    )


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances [mm] of all points from all others."""
    return np.linalg.norm(first[:, None] - second, axis=2)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 40) | st.integers(FIRST_CAPACITY, 3 * FIRST_CAPACITY))
def test_what_is_dropped_is_near_a_closer_contact_that_is_kept(seed: int, count: int) -> None:
    """And of what is kept no two are near each other: alike in bodies and normal, and closer than the spacing."""
    pairs = some_pairs(np.random.default_rng(seed), count)
    kept = ContactSelection(SIZE).spread_out(pairs, SPACING, *NO_CONTACTS)
    assert np.isin(kept.distance, pairs.distance).all()
    spacing = np.minimum(SPACING, 0.2 * SIZE[pairs.bodies].min(axis=1))
    near = apart(pairs.middle, kept.middle) < spacing[:, None]
    near &= (pairs.key[:, None] == kept.key) & (pairs.normal @ kept.normal.T > 0.5)
    itself = pairs.distance[:, None] == kept.distance
    is_kept = itself.any(axis=1)
    assert not (near & ~itself)[is_kept].any()
    assert (near & (kept.distance < pairs.distance[:, None]))[~is_kept].any(axis=1).all()


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 40), last_count=st.integers(0, 2 * FIRST_CAPACITY))
def test_each_contact_continues_the_nearest_of_the_last_step_that_is_still_free(
    seed: int, count: int, last_count: int
) -> None:
    random = np.random.default_rng(seed)
    pairs, last = some_pairs(random, count), some_pairs(random, last_count)
    selection = ContactSelection(SIZE)
    matched = selection.match(pairs, last.key, last.middle, radius=2.0)
    np.testing.assert_array_equal(selection.match(pairs, last.key, last.middle, radius=2.0), matched)
    far = apart(pairs.middle, last.middle)
    far[pairs.key[:, None] != last.key] = np.inf
    for contact in range(count):
        nearest = far[contact].argmin() if last_count else -1
        expected = nearest if last_count and far[contact, nearest] < 2.0 else -1
        assert matched[contact] == expected
        if expected >= 0:
            far[:, expected] = np.inf


def test_what_was_a_contact_stays_one_unless_another_is_clearly_closer() -> None:
    pairs = some_pairs(np.random.default_rng(0), 2)
    pairs.bodies[:], pairs.normal[:], pairs.points[:] = [0, 1], [0, 0, 1], 5.0
    pairs.points[1, :, 0] += 1.0
    for closer, chosen in ((0.9 * CLEARLY_CLOSER, 1), (1.1 * CLEARLY_CLOSER, 0)):
        pairs.distance[:] = [1.0 - closer, 1.0]
        kept = ContactSelection(SIZE).spread_out(pairs, SPACING, pairs.key[1:], pairs.middle[1:])
        np.testing.assert_array_equal(kept.distance, pairs.distance[[chosen]])


def test_nothing_chosen_changes_when_the_buffers_are_used_again() -> None:
    """Contacts that were handed out belong to the state, and must not follow the next step."""
    random, selection = np.random.default_rng(1), ContactSelection(SIZE)
    pairs = some_pairs(random, 30)
    kept = selection.spread_out(pairs, SPACING, *NO_CONTACTS)
    before = kept.middle
    selection.spread_out(some_pairs(random, 30), SPACING, kept.key, kept.middle)
    np.testing.assert_array_equal(kept.middle, before)
