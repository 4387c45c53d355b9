"""The shapes of tetrahedra, and their neighbours."""

import numpy as np

from taichisoft.meshes import tetrahedron_volumes

# Start and end of each edge, and the two other corners.
EDGES = ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 2, 0), (2, 3, 0, 1))

# Corners of each face, outward for positive tetrahedra; face k is opposite to corner k.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


def radius_ratios(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Three times the inscribed radius over the circumscribed one [-], shape (element_count,).

    1 for a regular tetrahedron, 0 for a flat one; gmsh calls it gamma.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4 or more); the first four nodes are the corners.
    """
    a, b, c, d = np.moveaxis(nodes[elements[:, :4]], 1, 0)
    volumes = np.abs(tetrahedron_volumes(nodes, elements))
    areas = sum(
        np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2 for p, q, r in ((a, b, c), (a, b, d), (a, c, d), (b, c, d))
    )
    # Products of opposite edges are the sides of a triangle of area 6 V R (Crelle's formula).
    x, y, z = (
        np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1)
        for p, q in ((b - a, d - c), (c - a, d - b), (d - a, c - b))
    )
    crelle = np.sqrt(np.maximum((x + y + z) * (x + y - z) * (x - y + z) * (-x + y + z), 0.0)) / 4
    inscribed = np.divide(3 * volumes, areas, out=np.zeros_like(volumes), where=areas > 0)
    return np.divide(18 * volumes * inscribed, crelle, out=np.zeros_like(volumes), where=crelle > 0)


def dihedral_angles(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Angles between the faces of each tetrahedron [degrees], shape (element_count, 6); 70.5 in a regular one.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4 or more); the first four nodes are the corners.
    """
    corners = nodes[elements[:, :4]]
    angles = []
    for start, end, first, second in EDGES:
        along = corners[:, end] - corners[:, start]
        a, b = (np.cross(along, corners[:, third] - corners[:, start]) for third in (first, second))
        angles.append(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ed,ed->e", a, b)))
    return np.degrees(np.column_stack(angles))


def edge_lengths(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Shortest and longest edge of each tetrahedron [mm], shape (element_count, 2)."""
    corners = nodes[elements[:, :4]]
    starts, ends = np.array(EDGES)[:, 0], np.array(EDGES)[:, 1]
    lengths = np.linalg.norm(corners[:, ends] - corners[:, starts], axis=-1)
    return np.column_stack([lengths.min(axis=1), lengths.max(axis=1)])


def neighbours(elements: np.ndarray) -> np.ndarray:
    """The tetrahedron behind each face, -1 on the boundary, shape (element_count, 4), for elements of that shape."""
    faces = np.sort(elements[:, FACES].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    pairs = order[:-1][same], order[1:][same]
    found = np.full(len(faces), -1)
    found[pairs[0]], found[pairs[1]] = pairs[1] // 4, pairs[0] // 4
    return found.reshape(-1, 4)
