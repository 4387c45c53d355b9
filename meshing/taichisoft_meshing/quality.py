"""How well shaped tetrahedra are."""

import numpy as np

from taichisoft.mesh import tetrahedron_volumes


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


def longest_edges(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Longest edge of each tetrahedron [mm], shape (element_count,)."""
    corners = nodes[elements[:, :4]]
    lengths = np.linalg.norm(corners[:, :, None] - corners[:, None, :], axis=-1)
    return lengths.max(axis=(1, 2))
