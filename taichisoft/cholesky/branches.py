"""How triangular solves are shared out among threads: branches of the elimination tree, and the supernodes above."""

import heapq

import numpy as np

# Branches per thread, at most: one more gains less than its start costs.
MOST_BRANCHES = 16


def share_out_branches(parent: np.ndarray, entries: np.ndarray, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """Supernodes branch by branch, the largest first, then those above; and where each of these begins.

    Each tree is a branch to begin with. The largest branch is cut at its root, again and again, and that number of
    cuts is kept with which the threads, each taking the next branch, and one of them all that is above, are to be done
    first.

    Args:
        parent: of each supernode, which follows it, -1 for a root, shape (supernode_count,).
        entries: of the factor in each supernode, which a solve reads, shape (supernode_count,).
        threads: how many there are.

    Returns:
        The supernodes, shape (supernode_count,), and the starts, shape (branch_count + 2,).
    """
    size, first = entries.astype(float), np.arange(len(parent))
    for s, above in enumerate(parent):
        if above >= 0:
            size[above] += size[s]
            first[above] = min(first[above], first[s])
    branches = [(-size[s], int(s)) for s in np.flatnonzero(parent < 0)]
    heapq.heapify(branches)
    above_branches: list[int] = []
    best, kept = _time(branches, 0.0, threads), (sorted(branches), 0)
    while threads > 1 and len(branches) < MOST_BRANCHES * threads:
        _, root = heapq.heappop(branches)
        above_branches.append(root)
        for child in np.flatnonzero(parent == root):
            heapq.heappush(branches, (-size[child], int(child)))
        if not branches:
            break
        time = _time(branches, float(entries[above_branches].sum()), threads)
        if time < best:
            best, kept = time, (sorted(branches), len(above_branches))
    roots = [root for _, root in kept[0]]
    parts = [np.arange(first[root], root + 1) for root in roots] + [np.sort(above_branches[: kept[1]]).astype(int)]
    starts = np.cumsum([0, *(len(part) for part in parts)])
    return np.concatenate(parts).astype(np.int32), starts.astype(np.int32)


def _time(branches: list[tuple[float, int]], above: float, threads: int) -> float:
    """Number of entries that are read one after the other."""
    busy = [0.0] * threads
    for negative_size, _ in sorted(branches):
        heapq.heapreplace(busy, busy[0] - negative_size)
    return above + max(busy)
