"""The surface of a cavity with straight or curved triangles, and what a pressure in it does."""

from itertools import pairwise

import numpy as np

from taichisoft_benchmarks.quadratic_tetrahedra import Elements

# Six points that integrate polynomials of degree four over a triangle (Dunavant 1985), as barycentric coordinates.
_NEAR, _FAR = 0.445948490915965, 0.091576213509771
POINTS = np.array([[1 - 2 * a if i == k else a for i in range(3)] for a in (_NEAR, _FAR) for k in range(3)])
SHARES = np.repeat([0.223381589678011, 0.109951743655322], 3)
SIDES = tuple(pairwise((0, 1, 2, 0)))


class DeformedCavity:
    """The triangles of a cavity on linear or quadratic elements; they point into the silicone."""

    def __init__(self, elements: Elements, triangles: np.ndarray):
        """`triangles`: corners, shape (triangle_count, 3); curved ones get the nodes in the middles of their sides."""
        self._nodes = triangles
        self._shapes, slopes = POINTS, np.repeat(np.eye(3)[:, None], len(POINTS), axis=1)
        if elements.middles:
            ends = np.sort(np.stack([triangles[:, side] for side in SIDES], axis=1), axis=2)
            middles = [[elements.middles[int(a), int(b)] for a, b in sides] for sides in ends]
            self._nodes = np.hstack([triangles, np.array(middles)])
            self._shapes, slopes = _curved(POINTS)
        self._slopes = slopes[0] - slopes[2], slopes[1] - slopes[2]

    def volume_gradient(self, position: np.ndarray) -> np.ndarray:
        """How the cavity's volume changes with the nodes: the force of 1 kPa [mN], shape (node_count, 3).

        Args:
            position: of all nodes [mm], shape (node_count, 3).
        """
        corners = position[self._nodes]
        first, second = (np.einsum("qn,tni->tqi", slope, corners) for slope in self._slopes)
        shares = np.einsum("q,qn,tqi->tni", SHARES, self._shapes, np.cross(first, second) / 2)
        gradient = np.zeros_like(position)
        np.add.at(gradient, self._nodes, shares)
        return gradient


def _curved(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions, (point_count, 6), and their slopes along each coordinate, (3, point_count, 6)."""
    values = [points * (2 * points - 1)]
    slopes = np.zeros((3, len(points), 6))
    for corner in range(3):
        slopes[corner, :, corner] = 4 * points[:, corner] - 1
    for index, (a, b) in enumerate(SIDES):
        values.append(4 * (points[:, a] * points[:, b])[:, None])
        slopes[a, :, 3 + index] += 4 * points[:, b]
        slopes[b, :, 3 + index] += 4 * points[:, a]
    return np.hstack(values), slopes
