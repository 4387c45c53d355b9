"""The tasks that compute the fronts of a factorisation: subtrees, fronts, and pieces of fronts."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from taichisoft.cholesky.kernels.front_layout import AWAITED, FIRST_FRONT, LAST_FRONT
from taichisoft.cholesky.schedule import schedule
from taichisoft.runtime.language import THREADS
from taichisoft.runtime.tiles import TILE
from taichisoft.runtime.waiting import PER_LOOK

# A subtree becomes one task when it holds at most this share of all the arithmetic.
SUBTREE_SHARE = 1 / 16
# A front above all such subtrees is cut into pieces of at least this many multiplications, about 20 microseconds.
PIECE_WORK = 2.0e5
LARGEST_PIECE_COUNT = 6
# Ends a range of rows or columns of tiles that goes to the end of a front.
ALL = 2**20
# Times that were fitted to the times of single tasks, which they predict to 10 % [ns]: a multiplication and addition in
# the columns of a front and in its update matrix, an entry that a child adds or that is filled in, a front, a task.
IN_PANEL, IN_UPDATE, ADDED, FILLED, PER_FRONT, PER_TASK = 0.059, 0.039, 1.2, 0.52, 2200.0, 1900.0
# How much longer than the longest task a thread waits: tasks may take twice the time when programs on other cores use
# the memory. A patience is at most some seconds.
LONGER, LARGEST_PATIENCE = 3.0, 2**28


@dataclass(frozen=True)
class FrontSizes:
    """The work on each front; counts of scalars, shape (supernode_count,) each.

    Attributes:
        parent: front that takes over the update matrix, -1 for a root.
        width, columns: own columns, and the same padded to whole tiles.
        below: rows below.
        in_parent: how many of them are own columns of the parent.
    """

    parent: np.ndarray
    width: np.ndarray
    columns: np.ndarray
    below: np.ndarray
    in_parent: np.ndarray


@dataclass(frozen=True)
class Times:
    """Predicted times [ns] for parts of each front, shape (supernode_count,) each.

    Attributes:
        assembly: to fill the panel, and add to it what the children leave.
        pivots: to eliminate the rows of the own columns.
        rows: to eliminate the rows below.
        update: for the update matrix.
    """

    assembly: np.ndarray
    pivots: np.ndarray
    rows: np.ndarray
    update: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        """For a front in one piece."""
        return self.assembly + self.pivots + self.rows + self.update


def share_out(sizes: FrontSizes) -> tuple[np.ndarray, np.ndarray, int]:
    """Tasks in the order in which threads take them, the number of pieces of each front, and the patience of a thread.

    The patience is a number of looks at tasks that takes longer than any task.

    A task is a range of supernodes, the pieces of its front that must be finished before it starts, a range of
    rows of tiles of the panel, and one of columns of tiles of the update matrix. Small subtrees are one task each, the
    fronts above them are cut: first the rows of the panel's own columns, then the rows below, then the update matrix.
    """
    times, parent = _predict(sizes), sizes.parent
    work = 1.0 * sizes.width * (sizes.width + sizes.below) ** 2
    subtree_work, first = work.copy(), np.arange(len(parent))
    for s, above in enumerate(parent):
        if above >= 0:
            subtree_work[above] += subtree_work[s]
            first[above] = min(first[above], first[s])
    small = subtree_work <= SUBTREE_SHARE * work.sum()
    time_before = np.concatenate([[0.0], np.cumsum(times.whole)])
    pieces = np.ones(len(parent), dtype=np.int32)
    tasks: list[tuple[int, ...]] = []
    expected: list[float] = []
    for s in range(len(parent)):
        if small[s] and parent[s] >= 0 and small[parent[s]]:
            continue
        parts = int(min(LARGEST_PIECE_COUNT, work[s] // PIECE_WORK, sizes.below[s] // (2 * TILE)))
        if small[s] or parts < 2:
            begin = first[s] if small[s] else s
            tasks.append((begin, s + 1, 0, 0, ALL, 0, ALL))
            expected.append(time_before[s + 1] - time_before[begin])
            continue
        pivot_tiles, tiles = sizes.columns[s] // TILE, -(-sizes.below[s] // TILE)
        pieces[s] = 1 + 2 * parts
        tasks.append((s, s + 1, 0, 0, pivot_tiles, 0, 0))
        rows = pivot_tiles + np.arange(parts + 1) * tiles // parts
        tasks += [(s, s + 1, 1, a, b, 0, 0) for a, b in pairwise(rows)]
        # Columns of a triangle: equal areas.
        cuts = np.round(tiles * (1.0 - np.sqrt(1.0 - np.arange(parts + 1) / parts))).astype(int)
        tasks += [(s, s + 1, 1 + parts, 0, 0, a, b) for a, b in pairwise(cuts)]
        expected += [times.assembly[s] + times.pivots[s]]
        expected += [times.rows[s] / parts] * parts + [times.update[s] / parts] * parts
    table, time = np.array(tasks, dtype=np.int32), np.array(expected) + PER_TASK
    order = schedule(time, _prerequisites(table, parent), THREADS)
    return table[order], pieces, min(int(LONGER * time.max() / PER_LOOK), LARGEST_PATIENCE)


def _predict(sizes: FrontSizes) -> Times:
    width, below, above = sizes.width.astype(float), sizes.below.astype(float), sizes.parent
    has_parent = above >= 0
    to_panel = sizes.in_parent * (below - sizes.in_parent / 2)
    to_update = (below - sizes.in_parent) ** 2 / 2
    added = [np.bincount(above[has_parent], entries[has_parent], len(above)) for entries in (to_panel, to_update)]
    return Times(
        assembly=PER_FRONT + FILLED * sizes.columns * (sizes.columns + below) + ADDED * added[0],
        pivots=IN_PANEL * width**3 / 6,
        rows=IN_PANEL * width**2 * below / 2,
        update=IN_UPDATE * width * below**2 / 2 + ADDED * added[1],
    )


def _prerequisites(tasks: np.ndarray, parent: np.ndarray) -> list[list[int]]:
    """The tasks that each one waits for: pieces of its own front, and all of its children's."""
    of_front: list[list[int]] = [[] for _ in parent]
    for number, task in enumerate(tasks):
        for s in range(task[FIRST_FRONT], task[LAST_FRONT]):
            of_front[s].append(number)
    before: list[list[int]] = [of_front[task[FIRST_FRONT]][: task[AWAITED]] for task in tasks]
    for s, above in enumerate(parent):
        if above >= 0 and of_front[above] != of_front[s]:
            for number in of_front[above]:
                before[number] = before[number] + of_front[s]
    return before
