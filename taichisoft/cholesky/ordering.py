"""The order in which nodes are eliminated, chosen for each body by the predicted time of its factorisation."""

import sys
from dataclasses import astuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from taichisoft.cholesky import dissection, supernodes
from taichisoft.cholesky.dissection import LEAF, minimum_degree, nested_dissection
from taichisoft.cholesky.supernodes import Supernodes, group_columns
from taichisoft.kept_files import kept_arrays, source_of

# Number of threads for which an order is chosen: not that of the run, since the last bits depend on the order.
THREADS = 2


def find_supernodes(adjacency: sparse.csr_matrix) -> Supernodes:
    """Order the nodes of a symmetric pattern (diagonal included) and group the factor's columns.

    What was found is kept for the next process.
    """
    sources = [source_of(module.__file__) for module in (sys.modules[__name__], dissection, supernodes)]
    pattern = [adjacency.indptr.tobytes(), adjacency.indices.tobytes()]
    return Supernodes(*kept_arrays("orders", [*sources, *pattern], lambda: astuple(_find_supernodes(adjacency))))


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

    The supernodes on the way to a root come one after the other. Threads share their rows below, but not their pivots.
    """
    width = 3 * np.diff(grouped.first_column).astype(np.int64)
    height = 3 * np.diff(grouped.row_start).astype(np.int64)
    work = height**3 - (height - width) ** 3
    way = width**3
    for s in range(grouped.count - 1, -1, -1):
        if grouped.parent[s] >= 0:
            way[s] += way[grouped.parent[s]]
    return float(work.sum() + (THREADS - 1) * way.max()) / (6 * THREADS)


def _best(graph: sparse.csr_matrix) -> Supernodes:
    """The better of minimum degree, which leaves small graphs the least fill, and nested dissection."""
    by_degree = group_columns(graph, minimum_degree(graph))
    if graph.shape[0] <= LEAF:
        return by_degree
    dissected = group_columns(graph, nested_dissection(graph))
    return by_degree if predicted_work(by_degree) <= predicted_work(dissected) else dissected
