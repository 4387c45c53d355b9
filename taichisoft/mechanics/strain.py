"""The largest principal stretch of elements, from the positions of their corners."""

import math
from collections.abc import Sequence

import numpy as np

from taichisoft.mechanics.element_kinds import linear_tetrahedra
from taichisoft.mesh.volume_mesh import linear_parts
from taichisoft.scene.soft_body import SoftBodySettings

HOOKE_STRETCH = 1.2
"""Stretch up to which Hooke's law does for rubber: pulled to it, its force lies 19 % above the neo-Hookean one of equal
moduli, E (l - 1) against E (l - l^-2) / 3, and 71 % at a stretch of 2."""
MOST = 0.99
"""Share of a body's elements: their stretch hardly depends on the few elements at corners and clamps, whose
stretch grows with every finer mesh."""


class Stretches:
    """The stretches of tetrahedra in many positions.

    Attributes:
        tetrahedra: their corners, shape (count, 4).
        rest_volumes: their volumes at rest [mm^3], shape (count,).
    """

    def __init__(self, rest_position: np.ndarray, elements: np.ndarray):
        """Compute gradients and volumes at rest; a quadratic element counts as eight tetrahedra, in order."""
        self.tetrahedra = elements = linear_parts(elements)
        self._corners = np.ascontiguousarray(elements.T)
        gradients, volumes = linear_tetrahedra(rest_position, elements)
        self._gradients = np.ascontiguousarray(gradients[:, 0, 1:].transpose(1, 2, 0))
        self.rest_volumes = volumes[:, 0]

    def largest(self, position: np.ndarray) -> np.ndarray:
        """Largest principal stretch of each tetrahedron [-], 1 at rest, shape (count,); to 1e-8.

        The root of the largest eigenvalue of C = F^T F, in closed form (Smith 1961, Eigenvalues of a Symmetric 3x3
        Matrix). It works on whole columns, since numpy takes long for many small matrices.
        """
        coordinates = np.ascontiguousarray(position.T)
        first, *others = (coordinates.take(corners, axis=1) for corners in self._corners)
        edges, gradients = [other - first for other in others], self._gradients
        x, y, z = (_product(edges, gradients[:, j]) for j in range(3))
        xx, yy, zz, xy, xz, yz = (_product(*both) for both in ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z)))
        mean = (xx + yy + zz) / 3.0
        x, y, z = xx - mean, yy - mean, zz - mean
        shear = xy * xy + xz * xz + yz * yz
        size = np.sqrt(np.maximum((x * x + y * y + z * z + 2.0 * shear) / 6.0, 1e-100))
        determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)
        angle = np.arccos(np.clip(0.5 * determinant / size**3, -1.0, 1.0)) / 3.0
        return np.asarray(np.sqrt(mean + 2.0 * size * np.cos(angle)))


def _product(three: Sequence[np.ndarray] | np.ndarray, others: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Sum of the products of three pairs; numpy's own sum over a short axis takes several times as long."""
    product: np.ndarray = three[0] * others[0] + three[1] * others[1] + three[2] * others[2]
    return product


def spread(stretches: np.ndarray) -> tuple[float, float]:
    """Of the stretches of a body's elements [-], shape (count,): the largest, and the one that 99 % stay below."""
    return float(stretches.max()), float(np.quantile(stretches, MOST))


def valid_stretch(body: SoftBodySettings) -> tuple[float, str]:
    """Stretch up to which the law of a body holds [-], infinite where none is known, and what to call the law."""
    if body.law == "hooke":
        return HOOKE_STRETCH, "Hooke's law"
    if body.material is not None and body.law == body.material.law:
        return body.material.highest_stretch, f"the fitted law of {body.material.name}"
    return math.inf, f"the law {body.law}"
