"""The order of the factorisation's tasks: whatever a thread waits for was taken before, and threads hardly wait."""

import numpy as np
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.mechanics.cholesky import schedule


def time_taken(order: list[int], work: np.ndarray, prerequisites: list[list[int]], workers: int) -> float:
    """Until the last worker has finished, each taking the next task and waiting for what comes before it."""
    free, end = [0.0] * workers, np.zeros(len(work))
    for task in order:
        worker = int(np.argmin(free))
        free[worker] = end[task] = max([free[worker], *end[prerequisites[task]]]) + work[task]
    return max(free)


@examples(60)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), workers=st.integers(1, 8), share=st.floats(0.0, 1.0))
def test_what_a_task_waits_for_comes_before_it(seed: int, count: int, workers: int, share: float) -> None:
    """And it takes no longer than Graham's bound: (2 - 1 / workers) times what the work or the longest way needs."""
    random = np.random.default_rng(seed)
    work = random.exponential(size=count)
    numbers = random.permutation(count)
    prerequisites: list[list[int]] = [[] for _ in range(count)]
    for place, task in enumerate(numbers):
        prerequisites[task] = [int(other) for other in numbers[:place] if random.random() < share / 4]
    order = schedule(work, prerequisites, workers)
    assert sorted(order) == list(range(count))
    place_of = np.argsort(order)
    assert all(place_of[before] < place_of[task] for task in range(count) for before in prerequisites[task])
    way = np.zeros(count)
    for task in numbers:
        way[task] = work[task] + max(way[prerequisites[task]], default=0.0)
    least = max(work.sum() / workers, way.max())
    assert time_taken(order, work, prerequisites, workers) <= (2.0 - 1.0 / workers) * least * (1.0 + 1e-12)


def test_nobody_waits_where_there_is_other_work() -> None:
    """Twenty tasks that wait for nothing and a chain of ten: two workers take half the time of one."""
    prerequisites = [[task - 1] if task > 20 else [] for task in range(30)]
    work = np.full(30, 1.0)
    assert time_taken(schedule(work, prerequisites, 2), work, prerequisites, 2) == 15.0
