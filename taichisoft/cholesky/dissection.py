"""Nested dissection: a fill-reducing order whose elimination tree is bushy, from the graph alone.

A part of the graph is cut in two by few nodes, which are eliminated after both sides (George 1973, Nested dissection
of a regular finite element mesh). They are found by a maximum flow between the two ends of the part (Schild and Sommer
2015, On balanced separators in road networks): the smallest separator behind the first quarter of its nodes and before
the last. Small parts are ordered by minimum degree. All that decides are whole numbers, and of several smallest
separators those nearest to the ends are taken, which are unique: the order is the same on every machine.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from scipy.sparse import csgraph

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
    """The order of a part of the graph, in pieces."""
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
    room = np.concatenate([np.full(len(arc[0]), arc[2], dtype=np.int32) for arc in arcs])
    network = sparse.csr_matrix((room, (tail, head)), (2 * size + 2, 2 * size + 2))
    left = network - csgraph.maximum_flow(network, source, sink).flow
    left.eliminate_zeros()
    reached, reaching = _reached(left, source), _reached(left.T.tocsr(), sink)
    return [
        _cut(side, nodes, reached[size : 2 * size], reached[:size] & ~reached[size : 2 * size]),
        _cut(side, nodes, ~reaching[size : 2 * size], reaching[size : 2 * size] & ~reaching[:size]),
    ]


def _reached(network: sparse.csr_matrix, start: int) -> np.ndarray:
    """Points of a network that can be reached from `start`."""
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
