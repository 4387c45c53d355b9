"""The ten-node tetrahedron, whose sides may be curved: its order of nodes, its slopes, its volume, its parts."""

import numpy as np

SIDES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""The corners between which the nodes 4 to 9 of a tetrahedron lie, in VTK's order."""

QUADRATURE_POINTS = np.full((4, 4), (5.0 - 5.0**0.5) / 20.0) + np.eye(4) * 5.0**-0.5
"""Four points that integrate quadratic functions over a tetrahedron exactly, as barycentric coordinates."""

CUBIC_POINTS = np.vstack([np.full(4, 1 / 4), np.full((4, 4), 1 / 6) + np.eye(4) / 3])
CUBIC_WEIGHTS = np.array([-4 / 5, 9 / 20, 9 / 20, 9 / 20, 9 / 20])
"""Points and weights that integrate cubic functions, such as the determinant of the Jacobian, exactly (Zienkiewicz)."""

NODES = np.vstack([np.eye(4), np.eye(4)[SIDES].mean(axis=1)])
"""Barycentric coordinates of the ten nodes."""


def slopes(points: np.ndarray) -> np.ndarray:
    """Slopes of the ten shape functions along the last three barycentric coordinates, shape (point_count, 10, 3).

    Args:
        points: barycentric coordinates, shape (point_count, 4).
    """
    first, second = SIDES.T
    unit = np.eye(4)
    at_corners = (4.0 * points - 1.0)[:, :, None] * unit
    at_middles = 4.0 * (points[:, first, None] * unit[second] + points[:, second, None] * unit[first])
    along_all = np.concatenate([at_corners, at_middles], axis=1)
    return np.asarray(along_all[..., 1:] - along_all[..., :1])


def jacobians(nodes: np.ndarray, elements: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Slopes of the positions [mm] along the last three barycentric coordinates, (element_count, point_count, 3, 3).

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: node indices, the four corners first and then the middles of `SIDES`, shape (element_count, 10).
        points: barycentric coordinates, shape (point_count, 4).
    """
    return np.asarray(np.einsum("eai,qaj->eqij", nodes[elements], slopes(points)))


def curved_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] between the curved sides, exact but for rounding, shape (element_count,)."""
    return np.asarray(np.linalg.det(jacobians(nodes, elements, CUBIC_POINTS)) @ CUBIC_WEIGHTS / 6.0)


def least_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """How near each element is to being turned over somewhere: not positive where it is [mm^3], (element_count,).

    The least determinant of the Jacobian, as the volume of a straight element that has it everywhere, at the nodes and
    at the points where strains are computed; or eight times the least volume of the eight parts of `linear_parts`, in
    which points are embedded. Both are the volume of an element with straight sides.
    """
    points = np.vstack([NODES, QUADRATURE_POINTS, CUBIC_POINTS])
    determinants = np.linalg.det(jacobians(nodes, elements, points))
    corners = nodes[linear_parts(elements)]
    parts = np.linalg.det(corners[:, 1:] - corners[:, :1]).reshape(-1, 8)
    return np.asarray(np.minimum(determinants.min(axis=1) / 6.0, 8.0 * parts.min(axis=1) / 6.0))


def linear_parts(elements: np.ndarray) -> np.ndarray:
    """Each ten-node tetrahedron as eight of four nodes, shape (8 element_count, 4); four-node ones as they are."""
    if elements.shape[1] == 4:
        return elements
    parts = [
        [0, 4, 6, 7],
        [4, 1, 5, 8],
        [6, 5, 2, 9],
        [7, 8, 9, 3],
        [4, 9, 5, 6],
        [4, 9, 6, 7],
        [4, 9, 7, 8],
        [4, 9, 8, 5],
    ]
    return elements[:, parts].reshape(-1, 4)
