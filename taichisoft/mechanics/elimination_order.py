"""The order in which nodes are eliminated, chosen for each body by the predicted time of its factorisation."""

import heapq
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from scipy.sparse import csgraph

from taichisoft.base.kept_files import kept_arrays, source_of

# Nested dissection: a fill-reducing order whose elimination tree is bushy, from the graph alone.
#
# A part of the graph is cut in two by few nodes, which are eliminated after both sides (George 1973, Nested dissection
# of a regular finite element mesh). They are found by a maximum flow between the two ends of the part (Schild and
# Sommer 2015, On balanced separators in road networks): the smallest separator behind the first quarter of its nodes
# and before the last. Small parts are ordered by minimum degree. All that decides are whole numbers, and of several
# smallest separators those nearest to the ends are taken, which are unique: the order is the same on every machine.

# Parts of fewer nodes are not cut any further.
LEAF = 200
# Share of a part's nodes that is held to each side of the cut.
HELD = 0.25
# Number of directions in which a part is cut, of all that are considered.
TRIED = 3
UNLIMITED = 2**20


class Cut(NamedTuple):
    """A part in three, each a mask of its nodes: no edge leads from one side to the other."""

    one_side: np.ndarray
    separator: np.ndarray
    other_side: np.ndarray

    @property
    def cost(self) -> int:
        """In proportion to the size of the separator, and the higher the more the sides differ."""
        larger = max(self.one_side.sum(), self.other_side.sum())
        return int(self.separator.sum() * (len(self.separator) + 2 * larger))


def nested_dissection(adjacency: sparse.csr_matrix) -> np.ndarray:
    """Nodes in the order of their elimination, of a symmetric pattern; shape (node_count,)."""
    graph = sparse.csr_matrix(adjacency, dtype=float, copy=True)
    graph.setdiag(0.0)
    graph.eliminate_zeros()
    return np.concatenate(_dissect(graph, np.arange(graph.shape[0])))


def _dissect(graph: sparse.csr_matrix, nodes: np.ndarray) -> list[np.ndarray]:
    part = graph[nodes][:, nodes].tocsr()
    count, component = csgraph.connected_components(part, directed=False)
    if count > 1:
        return [piece for c in range(count) for piece in _dissect(graph, nodes[component == c])]
    if len(nodes) > LEAF:
        directions = sorted(_directions(part), key=lambda key: _edges_across(part, key))
        cut = min((cut for key in directions[:TRIED] for cut in _cuts(part, key)), key=lambda cut: cut.cost)
        if cut.one_side.any() and cut.other_side.any():
            halves = _dissect(graph, nodes[cut.one_side]) + _dissect(graph, nodes[cut.other_side])
            return [*halves, nodes[cut.separator]]
    return [_order_leaf(graph, nodes)]


def _directions(part: sparse.csr_matrix) -> list[np.ndarray]:
    """Numbers of the nodes along which a part may be cut: distances in the graph from nodes far from each other."""
    distance = [_distance(part, 0)]
    nearest = distance[0]
    ends: list[np.ndarray] = []
    for _ in range(4):
        ends.append(_distance(part, int(np.argmax(nearest))))
        nearest = np.minimum.reduce(ends)
    a, b, c, d = ends
    return [a - b, a, b, c - a, c - b, c, c - d, d]


def _distance(part: sparse.csr_matrix, node: int) -> np.ndarray:
    return csgraph.dijkstra(part, indices=node, unweighted=True)


def _edges_across(part: sparse.csr_matrix, key: np.ndarray) -> int:
    """How many edges lead from the first half of the nodes, in the order of their numbers, to the second."""
    first = np.zeros(len(key), dtype=bool)
    first[np.argsort(key, kind="stable")[: len(key) // 2]] = True
    edges = part.tocoo()
    return int((first[edges.row] != first[edges.col]).sum())


def _cuts(part: sparse.csr_matrix, key: np.ndarray) -> list[Cut]:
    """The smallest separators between the first and the last nodes in the order of `key`, nearest to either of them.

    By a maximum flow from the first to the last, where a node lets through one and edges let through any amount; each
    node is an arc from its entrance to its exit.
    """
    count, held = len(key), int(HELD * len(key))
    order = np.argsort(key, kind="stable")
    side = np.zeros(count, dtype=int)
    side[order[:held]], side[order[count - held :]] = -1, 1
    edges = part.tocoo()
    inside = side == 0
    inside[edges.row[side[edges.row] != side[edges.col]]] = True
    nodes = np.flatnonzero(inside)
    size = len(nodes)
    entrance = np.full(count, -1)
    entrance[nodes] = np.arange(size)
    between = inside[edges.row] & inside[edges.col]
    source, sink = 2 * size, 2 * size + 1
    first, last = entrance[nodes[side[nodes] < 0]], entrance[nodes[side[nodes] > 0]]
    arcs = [
        (np.arange(size), size + np.arange(size), 1),
        (size + entrance[edges.row[between]], entrance[edges.col[between]], UNLIMITED),
        (np.full(len(first), source), first, UNLIMITED),
        (size + last, np.full(len(last), sink), UNLIMITED),
    ]
    tail, head = (np.concatenate([arc[i] for arc in arcs]) for i in range(2))
    capacity = np.concatenate([np.full(len(arc[0]), arc[2], dtype=np.int32) for arc in arcs])
    network = sparse.csr_matrix((capacity, (tail, head)), (2 * size + 2, 2 * size + 2))
    left = network - csgraph.maximum_flow(network, source, sink).flow
    left.eliminate_zeros()
    reached, reaching = _reached(left, source), _reached(left.T.tocsr(), sink)
    return [
        _cut(side, nodes, reached[size : 2 * size], reached[:size] & ~reached[size : 2 * size]),
        _cut(side, nodes, ~reaching[size : 2 * size], reaching[size : 2 * size] & ~reaching[:size]),
    ]


def _reached(network: sparse.csr_matrix, start: int) -> np.ndarray:
    reached = np.zeros(network.shape[0], dtype=bool)
    reached[csgraph.breadth_first_order(network, start, return_predecessors=False)] = True
    return reached


def _cut(side: np.ndarray, nodes: np.ndarray, before: np.ndarray, separator: np.ndarray) -> Cut:
    """The cut of a whole part from that of its `nodes`, which stand before the separator or on it."""
    one_side, on = side < 0, np.zeros(len(side), dtype=bool)
    one_side[nodes], on[nodes] = before, separator
    return Cut(one_side, on, ~one_side & ~on)


def _order_leaf(graph: sparse.csr_matrix, nodes: np.ndarray) -> np.ndarray:
    """Minimum degree of a part among its neighbours, which are eliminated later.

    They are joined to one another, as they are in the end, so that their degree is high.
    """
    inside = np.zeros(graph.shape[0], dtype=bool)
    inside[nodes] = True
    around = np.unique(graph[nodes].indices)
    around = around[~inside[around]]
    both = np.concatenate([nodes, around])
    joined = sparse.block_diag([sparse.csr_matrix((len(nodes), len(nodes))), np.ones((len(around), len(around)))])
    order = minimum_degree((graph[both][:, both] + joined + sparse.identity(len(both))).tocsr())
    return nodes[order[order < len(nodes)]]


def minimum_degree(adjacency: sparse.csr_matrix) -> np.ndarray:
    """Fill-reducing order by SuperLU's multiple minimum degree, from a diagonally dominant matrix of the pattern."""
    node_count = adjacency.shape[0]
    matrix = sparse.csc_matrix(adjacency, dtype=float)
    matrix.data[:] = -1.0
    matrix = (matrix + sparse.identity(node_count) * (node_count + 2.0)).tocsc()
    factor = sparse_linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.argsort(factor.perm_c)


# How triangular solves are shared out among threads: branches of the elimination tree, and the supernodes above.

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


# The columns of a sparse Cholesky factor, grouped for dense arithmetic: elimination tree and supernodes.
#
# Works on the graph of nodes (each a 3x3 block of the matrix) and is made once per model. Sources: Liu 1990, The Role
# of Elimination Trees in Sparse Factorization; Liu 1992, The Multifrontal Method for Sparse Matrix Solution; Ashcraft
# and Grimes 1989, The influence of relaxed supernode partitions on the multifrontal method.


@dataclass(frozen=True)
class Supernodes:
    """Consecutive columns of the factor with one row structure; columns and rows count nodes in elimination order.

    Attributes:
        order: node eliminated at each position, shape (node_count,).
        first_column: first column of each supernode, and the node count at the end, shape (count + 1,).
        row_start: where each supernode's rows begin in `rows`, shape (count + 1,).
        rows: row positions of each supernode, its own columns first, ascending.
        parent: supernode that takes over its update matrix, -1 for a root, shape (count,).
    """

    order: np.ndarray
    first_column: np.ndarray
    row_start: np.ndarray
    rows: np.ndarray
    parent: np.ndarray

    @property
    def count(self) -> int:
        """Number of supernodes."""
        return len(self.parent)


def group_columns(adjacency: sparse.csr_matrix, order: np.ndarray) -> Supernodes:
    """Supernodes of a symmetric pattern (diagonal included) whose nodes are eliminated in an order, or one as good, in
    which every subtree is consecutive.
    """
    parent, _ = _column_structure(adjacency, order)
    order = order[_postorder(parent)]
    parent, structure = _column_structure(adjacency, order)
    ranges = _amalgamate(parent, [len(rows) for rows in structure])
    first = np.array([start for start, _ in ranges] + [len(order)])
    rows = [np.concatenate([np.arange(start, end), structure[end - 1]]) for start, end in ranges]
    owner = np.repeat(np.arange(len(ranges)), np.diff(first))
    tree = [owner[structure[end - 1][0]] if len(structure[end - 1]) else -1 for _, end in ranges]
    return Supernodes(
        order=order.astype(np.int32),
        first_column=first.astype(np.int32),
        row_start=np.concatenate([[0], np.cumsum([len(r) for r in rows])]).astype(np.int32),
        rows=np.concatenate(rows).astype(np.int32),
        parent=np.array(tree, dtype=np.int32),
    )


def _column_structure(adjacency: sparse.csr_matrix, order: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Parent of each column in the elimination tree and its row positions below the diagonal."""
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    parent = np.full(len(order), -1)
    inherited: list[list[np.ndarray]] = [[] for _ in order]
    structure = []
    for column, node in enumerate(order):
        neighbours = position[adjacency.indices[adjacency.indptr[node] : adjacency.indptr[node + 1]]]
        rows = np.unique(np.concatenate([neighbours, *inherited[column]]))
        rows = rows[np.searchsorted(rows, column, side="right") :]
        structure.append(rows)
        if len(rows):
            parent[column] = rows[0]
            inherited[rows[0]].append(rows)
        inherited[column] = []
    return parent, structure


def _postorder(parent: np.ndarray) -> np.ndarray:
    """Columns with every subtree consecutive, children before parents."""
    children: list[list[int]] = [[] for _ in parent]
    roots: list[int] = []
    for column, above in enumerate(parent):
        (children[above] if above >= 0 else roots).append(column)
    ordered: list[int] = []
    for root in roots:
        stack = [root]
        reverse = []
        while stack:
            column = stack.pop()
            reverse.append(column)
            stack.extend(children[column])
        ordered.extend(reversed(reverse))
    return np.array(ordered)


def _amalgamate(parent: np.ndarray, below: list[int]) -> list[tuple[int, int]]:
    """Column ranges of the supernodes; a child is merged into its parent when few zeros come in.

    `below` counts each column's rows below the diagonal. A range is (first, end, entries of the factor in it).
    """
    ranges: list[tuple[int, int, int]] = []
    for column in range(len(parent)):
        merged = (column, column + 1, below[column] + 1)
        while ranges and ranges[-1][1] == merged[0] and parent[merged[0] - 1] in range(merged[0], column + 1):
            first, _, entries = ranges[-1]
            width = merged[1] - first
            stored = width * (width + 1) // 2 + width * below[column]
            true = entries + merged[2]
            if not _worth_merging(width, 1.0 - true / stored):
                break
            ranges.pop()
            merged = (first, merged[1], true)
        ranges.append(merged)
    return [(first, end) for first, end, _ in ranges]


def _worth_merging(width: int, zero_fraction: float) -> bool:
    """Wider supernodes tolerate fewer explicit zeros: small ones cost more in overhead than in arithmetic."""
    if width <= 3:
        return True
    if width <= 8:
        return zero_fraction < 0.5
    return zero_fraction < (0.15 if width <= 24 else 0.05)


# Number of threads for which an order is chosen: not that of the run, since the last bits depend on the order.
ASSUMED_THREADS = 2


def find_supernodes(adjacency: sparse.csr_matrix) -> Supernodes:
    """Order the nodes of a symmetric pattern (diagonal included) and group the factor's columns.

    What was found is kept for the next process.
    """
    pattern = [source_of(__file__), adjacency.indptr.tobytes(), adjacency.indices.tobytes()]
    return Supernodes(*kept_arrays("orders", pattern, lambda: astuple(_find_supernodes(adjacency))))


def _find_supernodes(adjacency: sparse.csr_matrix) -> Supernodes:
    count, component = csgraph.connected_components(adjacency, directed=False)
    if count == 1:
        return _best(adjacency)
    orders: dict[bytes, np.ndarray] = {}  # bodies of one mesh have one graph
    order = []
    for c in range(count):
        nodes = np.flatnonzero(component == c)
        part = adjacency[nodes][:, nodes].tocsr()
        part.sort_indices()
        graph = part.indptr.tobytes() + part.indices.tobytes()
        if graph not in orders:
            orders[graph] = _best(part).order
        order.append(nodes[orders[graph]])
    return group_columns(adjacency, np.concatenate(order))


def predicted_work(grouped: Supernodes) -> float:
    """Multiplications that each thread waits for: its share of all, and of what no other thread can do meanwhile.

    The supernodes on a path to a root come one after the other. Threads share their rows below, but not their pivots.
    """
    width = 3 * np.diff(grouped.first_column).astype(np.int64)
    height = 3 * np.diff(grouped.row_start).astype(np.int64)
    work = height**3 - (height - width) ** 3
    path = width**3
    for s in range(grouped.count - 1, -1, -1):
        if grouped.parent[s] >= 0:
            path[s] += path[grouped.parent[s]]
    return float(work.sum() + (ASSUMED_THREADS - 1) * path.max()) / (6 * ASSUMED_THREADS)


def _best(graph: sparse.csr_matrix) -> Supernodes:
    """The better of minimum degree, which leaves small graphs the least fill, and nested dissection."""
    by_degree = group_columns(graph, minimum_degree(graph))
    if graph.shape[0] <= LEAF:
        return by_degree
    dissected = group_columns(graph, nested_dissection(graph))
    return by_degree if predicted_work(by_degree) <= predicted_work(dissected) else dissected
