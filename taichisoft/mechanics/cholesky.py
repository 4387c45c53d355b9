"""A sparse direct solver for symmetric positive definite matrices of 3x3 node blocks.

Analyse the pattern once (`SymbolicFactor`), then per step `factorise` together with a right-hand side, and `complete`
its solution with rows J of which `solver/` has computed L^-1 J^T. `solve` is for any other right-hand side.
"""

import heapq
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sparse

from taichisoft.errors import MeshError, NotPositiveDefinite
from taichisoft.mechanics.elimination_order import Supernodes, find_supernodes, share_out_branches
from taichisoft.mechanics.kernels.factorisation import factorise, factorise_alone
from taichisoft.mechanics.kernels.sparse_columns import (
    AWAITED,
    BELOW,
    COLUMNS,
    FIRST_FRONT,
    IN_PARENT,
    LAST_FRONT,
    EliminationTree,
    Factor,
    Fronts,
    SparseColumns,
)
from taichisoft.mechanics.kernels.substitution import Substitution, back, back_alone, forward, forward_alone
from taichisoft.runtime.arithmetic import COUNTERS, PER_LOOK, TILE
from taichisoft.runtime.language import THREADS

# The order in which threads take tasks that wait for one another: list scheduling (Graham 1969, Bounds on
# multiprocessing timing anomalies), by time that is predicted.


def schedule(work: np.ndarray, prerequisites: list[list[int]], workers: int) -> list[int]:
    """Tasks in the order in which so many workers would start them.

    A free worker starts, of the tasks that wait for nothing, the one with the longest path to the end. Threads that
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
    path = _longest_paths(work, prerequisites, followers)
    missing = [len(before) for before in prerequisites]
    ready = [(-path[task], task) for task, count in enumerate(missing) if not count]
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
                heapq.heappush(ready, (-path[follower], follower))
    return order


def _longest_paths(work: np.ndarray, prerequisites: list[list[int]], followers: list[list[int]]) -> list[float]:
    """Work from the start of each task to the end of all that follow, one after the other."""
    path = [0.0] * len(work)
    missing = [len(after) for after in followers]
    last = [task for task, count in enumerate(missing) if not count]
    while last:
        task = last.pop()
        path[task] = float(work[task]) + max((path[follower] for follower in followers[task]), default=0.0)
        for before in prerequisites[task]:
            missing[before] -= 1
            if not missing[before]:
                last.append(before)
    return path


# The tasks that compute the fronts of a factorisation: subtrees, fronts, and pieces of fronts.

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


# How the fronts of a sparse Cholesky factorisation lie in memory.
#
# Indices are in scalars, three for a node, unless said otherwise. A panel has rows for its own columns, padded to whole
# tiles, and then for its rows below, padded likewise.

LARGEST_INDEX = 2**31 - 1


@dataclass(frozen=True)
class Layout:
    """The layout of all fronts.

    Attributes:
        fronts: what the kernels read.
        block_pairs: position of the row and the column node of each stored block, shape (block_count, 2).
        size: columns of tiles of all panels and update matrices.
    """

    fronts: Fronts
    block_pairs: np.ndarray
    size: int


def lay_out(adjacency: sparse.csr_matrix, supernodes: Supernodes) -> Layout:
    """Assign every part of every front its place in memory."""
    width = 3 * np.diff(supernodes.first_column)
    columns = _padded(width)
    rest = 3 * np.diff(supernodes.row_start) - width
    tiles = _padded(rest) // TILE
    padding = columns - width
    panel_start = _offsets((columns // TILE + tiles) * columns)
    update_start = panel_start[-1] + _offsets(TILE * tiles * (tiles + 1) // 2)
    if TILE * update_start[-1] > LARGEST_INDEX:
        raise MeshError(
            f"the soft bodies' {len(supernodes.order)} nodes need {TILE * update_start[-1]:.3g} numbers for the "
            f"factorisation, of which the kernels can count {LARGEST_INDEX:.3g}; mesh the bodies more coarsely"
        )
    block_pairs, block_start, local_row, local_column = _place_blocks(adjacency, supernodes)
    owner = np.repeat(np.arange(supernodes.count), np.diff(block_start))
    child_start, child = _children(supernodes.parent)
    row_start = _offsets(TILE * tiles)
    table = np.column_stack(
        [
            np.append(width, 0),
            np.append(columns, 0),
            np.append(rest, 0),
            panel_start,
            update_start,
            block_start,
            child_start,
            row_start,
            3 * supernodes.first_column,
            np.zeros(supernodes.count + 1),
        ]
    ).astype(np.int32)
    position = np.full(row_start[-1] + 1, 3 * len(supernodes.order), dtype=np.int32)
    relative = np.zeros_like(position)
    for s, parent in enumerate(supernodes.parent):
        if parent >= 0:
            below = supernodes.rows[supernodes.row_start[s] + width[s] // 3 : supernodes.row_start[s + 1]]
            above = supernodes.rows[supernodes.row_start[parent] : supernodes.row_start[parent + 1]]
            place = slice(row_start[s], row_start[s] + rest[s])
            position[place] = _scalars(3 * below)
            local = 3 * np.searchsorted(above, below)
            relative[place] = _scalars(np.where(local < width[parent], local, local + padding[parent]))
            relative[place.stop : row_start[s + 1]] = relative[place.stop - 1]
            table[s, IN_PARENT] = np.searchsorted(relative[place], columns[parent])
    tasks, pieces, patience = share_out(FrontSizes(supernodes.parent, width, columns, rest, table[:-1, IN_PARENT]))
    block_row = np.where(local_row < width[owner], local_row, local_row + padding[owner])[:, None] + np.arange(3)
    block_column = panel_start[owner] + local_column
    block_place = TILE * (block_row // TILE * columns[owner][:, None] + block_column[:, None]) + block_row % TILE
    fronts = Fronts(
        table=table,
        rows=position,
        relative=relative,
        children=child,
        block_place=block_place.astype(np.int32),
        tasks=tasks,
        pieces=pieces,
        patience=np.array([patience], dtype=np.int32),
    )
    return Layout(fronts, block_pairs, int(update_start[-1]))


def _padded(count: np.ndarray) -> np.ndarray:
    return TILE * -(-count // TILE)


def _offsets(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)])


def _scalars(first: np.ndarray) -> np.ndarray:
    return (first[:, None] + np.arange(3)).reshape(-1)


def _place_blocks(
    adjacency: sparse.csr_matrix, supernodes: Supernodes
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Blocks of the lower triangle by columns: node positions, start per supernode, row and column in its panel."""
    position = np.empty(len(supernodes.order), dtype=np.int64)
    position[supernodes.order] = np.arange(len(supernodes.order))
    owner = np.repeat(np.arange(supernodes.count), np.diff(supernodes.first_column))
    pattern = adjacency.tocoo()
    row, column = position[pattern.row], position[pattern.col]
    lower = row >= column
    row, column = row[lower], column[lower]
    by_column = np.lexsort((row, column))
    row, column = row[by_column], column[by_column]
    s = owner[column]
    start = np.searchsorted(s, np.arange(supernodes.count + 1))
    # Rows are ascending within a supernode, so one search over (supernode, row) finds every local row.
    key = np.repeat(np.arange(supernodes.count), np.diff(supernodes.row_start)) * (len(owner) + 1) + supernodes.rows
    local_row = np.searchsorted(key, s * (len(owner) + 1) + row) - supernodes.row_start[s]
    local_column = column - supernodes.first_column[s]
    return np.column_stack([row, column]), start, 3 * local_row, 3 * local_column


def _children(parent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    child = np.flatnonzero(parent >= 0)
    child = child[np.argsort(parent[child], kind="stable")]
    start = np.searchsorted(parent[child], np.arange(len(parent) + 1))
    return start, np.append(child, 0).astype(np.int32)


# The symbolic factorisation: what a sparse Cholesky factorisation needs of a matrix's pattern, computed once.


class SymbolicFactor:
    """The pattern of L in A = L L^T, for a matrix A of 3x3 node blocks.

    Attributes:
        block_pairs: the two nodes (row, column) of every stored block of A, of the lower triangle in elimination order,
            shape (block_count, 2).
        order: node eliminated at each position, shape (unknown_count,); nodes without an entry on the diagonal of the
            pattern are no unknowns.
        node_count: number of nodes with those that are no unknowns.
        tree: the path from a node up the tree of supernodes.
        fronts: how the fronts lie in memory, and the tasks that compute them.
        size: columns of tiles that the fronts take.
        supernodes, branch_start: the same shared out for solves, see `kernels.forward_substitution.Substitution`.
        factor_entries: number of non-zeros stored in L.
    """

    def __init__(self, adjacency: sparse.csr_matrix):
        """Analyse the pattern of nodes that share an element; shape (node_count, node_count), diagonal included."""
        self.node_count = adjacency.shape[0]
        unknown = np.flatnonzero(adjacency.diagonal())
        if len(unknown) < self.node_count:
            adjacency = adjacency[unknown][:, unknown].tocsr()
        supernodes = find_supernodes(adjacency)
        node_width, node_height = np.diff(supernodes.first_column), np.diff(supernodes.row_start)
        self.order = unknown[supernodes.order].astype(supernodes.order.dtype)
        position = np.full(self.node_count, -1, dtype=np.int32)
        position[self.order] = np.arange(len(self.order))
        self.tree = EliminationTree(
            position_of_node=position,
            supernode_of_position=np.repeat(np.arange(supernodes.count, dtype=np.int32), node_width),
            parent=supernodes.parent,
        )
        self.factor_entries = int((9 * node_width * node_height - 3 * node_width * (3 * node_width - 1) // 2).sum())
        layout = lay_out(adjacency, supernodes)
        self.fronts, self.size = layout.fronts, layout.size
        self.block_pairs = self.order[layout.block_pairs]
        table = self.fronts.table
        entries = table[:-1, COLUMNS] * (table[:-1, COLUMNS] + table[:-1, BELOW])
        self.supernodes, self.branch_start = share_out_branches(supernodes.parent, entries, THREADS)


# Non-zeros of a factor below which a single thread works: less than some 0.5 ms is not worth waking the others.
SMALL_FACTOR = 300_000
# Non-zeros, as of reduced bodies, below which kernels run on the calling thread: to wake another one takes as long as
# the work, and on a busy machine until it gets a core. The choice is by size alone, since such kernels round otherwise.
TINY_FACTOR = 20_000
NO_MULTIPLIERS = np.zeros(0)


class Cholesky:
    """Factorisation A = L L^T of a matrix with a fixed pattern.

    Attributes:
        symbolic: the pattern.
        blocks: the matrix, whose blocks the caller fills in the order of `symbolic.block_pairs`, shape
            (block_count, 3, 3).
        factor: L, in columns of tiles as `mechanics/kernels/sparse_columns.py` says, and after it the update matrices.
    """

    def __init__(self, symbolic: SymbolicFactor):
        self.symbolic = symbolic
        self.blocks = np.zeros((len(symbolic.block_pairs), 3, 3))
        tiles = _allocate(symbolic.size)
        self.factor = Factor(
            tiles=tiles,
            scalars=tiles.reshape(-1),
            done=np.zeros(len(symbolic.tree.parent), dtype=np.int32),
            failed_column=np.zeros(1, dtype=np.int32),
            taken=np.zeros(len(symbolic.fronts.tasks), dtype=np.int32),
        )
        x = np.zeros(3 * len(symbolic.order) + TILE)  # the last tile may read and write beyond the end
        left = _allocate(len(symbolic.fronts.rows) // TILE)
        self._begun = Substitution(
            supernodes=symbolic.supernodes,
            branch_start=symbolic.branch_start,
            order=symbolic.order,
            given=np.zeros((symbolic.node_count, 3)),
            found=np.zeros((symbolic.node_count, 3)),
            forward=np.zeros_like(x),
            x=x,
            left=left.reshape(-1),
            left_tiles=left,
            progress=np.zeros(COUNTERS, dtype=np.int32),
        )
        self._whole = self._begun._replace(given=np.zeros_like(self._begun.given), forward=np.zeros_like(x))
        self._no_columns = SparseColumns.with_room(0, len(symbolic.tree.parent), 0)
        entries = symbolic.factor_entries
        self._workers = 1 if entries < SMALL_FACTOR else THREADS
        self._factorise, self._most = (factorise_alone, 1) if entries < TINY_FACTOR else (factorise, THREADS)
        self._forward, self._back = (forward_alone, back_alone) if entries < TINY_FACTOR else (forward, back)

    @property
    def begun(self) -> np.ndarray:
        """L^-1 b of the right-hand side that was factorised with, by elimination order, shape (3 node_count + 8,)."""
        return self._begun.forward

    def factorise(self, right_hand_side: np.ndarray) -> None:
        """Factorise what `blocks` holds, and begin to solve for a right-hand side b of shape (node_count, 3)."""
        factor, none = self.factor, 3 * len(self.symbolic.order)
        factor.done.fill(0)
        factor.taken.fill(0)
        factor.failed_column[0] = none
        _set_rhs(self._begun, right_hand_side)
        self._factorise(self.symbolic.fronts, self.blocks, factor, self._begun, self._most, 1)
        if factor.failed_column[0] < none:
            node = int(self.symbolic.order[factor.failed_column[0] // 3])
            raise NotPositiveDefinite(f"the system matrix is not positive definite at node {node}", node)

    def leave_out_right_hand_side(self) -> None:
        """Replace the right-hand side b by 0."""
        _set_rhs(self._begun, 0.0)

    def complete(self, columns: SparseColumns, multipliers: np.ndarray, count: int) -> np.ndarray:
        """A^-1 (b + J^T lambda), shape (node_count, 3), with the right-hand side that was factorised with.

        Args:
            columns: Y = L^-1 J^T, of the last factorisation.
            multipliers: lambda, in an array with room for more.
            count: how many they are.
        """
        return self._substitute_back(self._begun, columns, multipliers, count)

    def complete_with(self, more: np.ndarray) -> np.ndarray:
        """A^-1 (b + c), shape (node_count, 3), with the right-hand side that was factorised with and another one."""
        return self.solve(self._begun.given + more)

    def solve(self, right_hand_side: np.ndarray) -> np.ndarray:
        """Solve A x = c with the last factorisation, c and x of shape (node_count, 3), beside what was begun."""
        _set_rhs(self._whole, right_hand_side)
        self._forward(self.symbolic.fronts, self.factor, self._whole, self._workers, 1)
        return self._substitute_back(self._whole, self._no_columns, NO_MULTIPLIERS, 0)

    def _substitute_back(
        self, substitution: Substitution, columns: SparseColumns, multipliers: np.ndarray, count: int
    ) -> np.ndarray:
        substitution.x.fill(0.0)
        substitution.progress.fill(0)
        workers, symbolic = self._workers, self.symbolic
        self._back(count, multipliers, columns, symbolic.fronts, self.factor, substitution, workers, 1)
        return substitution.found.copy()


def _set_rhs(substitution: Substitution, right_hand_side: np.ndarray | float) -> None:
    """Begin with a right-hand side. Zeros of the factor's padding meet any entry of L^-1 b, so all must be numbers."""
    substitution.given[:] = right_hand_side
    substitution.forward.fill(0.0)
    substitution.progress.fill(0)


def _allocate(count: int) -> np.ndarray:
    """Columns of tiles, zero, each in a cache line of its own; shape (count + 1, 8)."""
    entries = np.zeros((count + 2) * TILE)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + (count + 1) * TILE].reshape(-1, TILE)
