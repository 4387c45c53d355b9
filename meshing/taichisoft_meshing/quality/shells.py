"""The connected pieces of a surface."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def connected_triangles(triangles: np.ndarray, node_count: int) -> list[np.ndarray]:
    """The triangles, each (count, 3), of every piece of a surface that shares no node with the others."""
    starts, ends = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(starts)), (starts, ends)), shape=(node_count, node_count))
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return [triangles[piece == number] for number in np.unique(piece)]
