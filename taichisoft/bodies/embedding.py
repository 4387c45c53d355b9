"""Points that follow a mesh: the element around each and its barycentric weights."""

import numpy as np

POINTS_AT_A_TIME = 64
# A point on the boundary counts as inside, whatever the round-off of its barycentric weights.
ON_BOUNDARY = 1e-9


def embed(points: np.ndarray, nodes: np.ndarray, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of each point in the tetrahedra, as SOFA's BarycentricMapping chooses them.

    The element in which the point lies deepest wins; a point outside all of them belongs to the element with
    the nearest centroid, with extrapolated weights.

    Args:
        points: [mm], shape (point_count, 3).
        nodes: [mm], shape (node_count, 3).
        elements: shape (element_count, 4).

    Returns:
        node indices and weights, both of shape (point_count, 4); a point outside has a negative weight.
    """
    origin = nodes[elements[:, 0]]
    to_local = np.linalg.inv((nodes[elements[:, 1:]] - origin[:, None]).transpose(0, 2, 1))
    centroid = nodes[elements].mean(axis=1)
    chosen = np.empty(len(points), dtype=np.int64)
    weights = np.empty((len(points), 4))
    for start in range(0, len(points), POINTS_AT_A_TIME):
        some = points[start : start + POINTS_AT_A_TIME]
        local = np.einsum("eij,pej->pei", to_local, some[:, None] - origin)
        outside = np.maximum(-local.min(axis=2), local.sum(axis=2) - 1.0)
        distance = ((some[:, None] - centroid) ** 2).sum(axis=2)
        element = np.where(outside > ON_BOUNDARY, distance, outside).argmin(axis=1)
        inner = local[np.arange(len(some)), element]
        chosen[start : start + len(some)] = element
        weights[start : start + len(some)] = np.column_stack([1.0 - inner.sum(axis=1), inner])
    return elements[chosen, :4].astype(np.int32), weights
