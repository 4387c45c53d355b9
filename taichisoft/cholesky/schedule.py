"""The order in which threads take tasks that wait for one another: list scheduling (Graham 1969, Bounds on
multiprocessing timing anomalies), by time that is predicted."""

import heapq

import numpy as np


def schedule(work: np.ndarray, prerequisites: list[list[int]], workers: int) -> list[int]:
    """Tasks in the order in which so many workers would start them.

    Whoever is free starts, of the tasks that wait for nothing, the one with the longest way to the end. Threads that
    take tasks in this order hardly wait.

    Args:
        work: time that each task takes, in any unit, shape (task_count,).
        prerequisites: the tasks that each one waits for, without circles.
        workers: how many tasks are done at once.

    Returns:
        All tasks, each behind its prerequisites.
    """
    followers: list[list[int]] = [[] for _ in prerequisites]
    for task, before in enumerate(prerequisites):
        for other in before:
            followers[other].append(task)
    way = _longest_ways(work, prerequisites, followers)
    missing = [len(before) for before in prerequisites]
    ready = [(-way[task], task) for task, count in enumerate(missing) if not count]
    heapq.heapify(ready)
    at_work: list[tuple[float, int]] = []
    now, order = 0.0, []
    while ready or at_work:
        while ready and len(at_work) < workers:
            _, task = heapq.heappop(ready)
            order.append(task)
            heapq.heappush(at_work, (now + work[task], task))
        now, task = heapq.heappop(at_work)
        for follower in followers[task]:
            missing[follower] -= 1
            if not missing[follower]:
                heapq.heappush(ready, (-way[follower], follower))
    return order


def _longest_ways(work: np.ndarray, prerequisites: list[list[int]], followers: list[list[int]]) -> list[float]:
    """Work from the start of each task to the end of all that follow, one after the other."""
    way = [0.0] * len(work)
    missing = [len(after) for after in followers]
    last = [task for task, count in enumerate(missing) if not count]
    while last:
        task = last.pop()
        way[task] = float(work[task]) + max((way[follower] for follower in followers[task]), default=0.0)
        for before in prerequisites[task]:
            missing[before] -= 1
            if not missing[before]:
                last.append(before)
    return way
