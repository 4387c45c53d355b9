"""The soft bodies of a model together: element arrays, forces and the system matrix of a step."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from taichisoft.cholesky import Cholesky
from taichisoft.elements import linear_tetrahedra
from taichisoft.kernels import elasticity as kernels
from taichisoft.soft_body import SoftBody


class Elasticity:
    """Internal forces and A = (1 + h a) M + h (h + b) K over all soft nodes, one block of A per body.

    Attributes:
        solver: the direct solver, whose `blocks` `assemble` fills.
        node_mass: [kg], shape (node_count,).
        anchor_stiffness: [mN/mm], shape (node_count,).
        rotation: of each element at the last call of `assemble`, shape (element_count, 3, 3).
    """

    def __init__(self, bodies: Sequence[SoftBody], time_step: float):
        """Lay out the arrays; `time_step` h in [s]."""
        counts = [len(body.elements) for body in bodies]
        self.elements = np.vstack([body.elements + body.nodes.start for body in bodies]).astype(np.int32)
        self.rest_position = np.vstack([body.rest_position for body in bodies])
        self.gradient, self.volume = linear_tetrahedra(self.rest_position, self.elements)
        self.lame = np.vstack([body.lame for body in bodies])
        self.node_mass = np.concatenate([body.node_mass for body in bodies])
        self.anchor_stiffness = np.concatenate([body.anchor_stiffness for body in bodies])
        self.polar = np.repeat([int(body.settings.corotation == "polar") for body in bodies], counts).astype(np.int32)
        node_counts = [len(body.rest_position) for body in bodies]
        rayleigh_stiffness = np.array([body.settings.rayleigh_stiffness for body in bodies])
        self.node_rayleigh_mass = np.repeat([body.settings.rayleigh_mass for body in bodies], node_counts)
        self.node_lag = np.repeat(time_step + rayleigh_stiffness, node_counts)  # h + b
        self._element_lag = np.repeat(time_step + rayleigh_stiffness, counts)
        self._stiffness_factor = time_step * self._element_lag
        self._diagonal = (
            1.0 + time_step * self.node_rayleigh_mass
        ) * self.node_mass + time_step * self.node_lag * self.anchor_stiffness
        self._allocate()

    def _allocate(self) -> None:
        element_count, corner_count = self.elements.shape
        node_count = len(self.rest_position)
        self.rotation = np.empty((element_count, 3, 3))
        self._rotated_gradient = np.empty_like(self.gradient)
        self._element_force = np.empty((element_count, corner_count, 3))
        self._node_parts = _contributions(self.elements.reshape(-1), node_count, corner_count)
        row, column = np.repeat(self.elements, corner_count, axis=1), np.tile(self.elements, corner_count)
        pattern = sparse.csr_matrix((np.ones(row.size), (row.ravel(), column.ravel())), (node_count, node_count))
        self.solver = Cholesky(pattern)
        pairs = self.solver.block_pairs
        self._block_parts = _block_contributions(self.elements, pairs, node_count)
        self._diagonal_block = np.where(pairs[:, 0] == pairs[:, 1], pairs[:, 0], -1).astype(np.int32)

    def assemble(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Fill the solver's blocks with A, its rotations frozen at these positions, and sum the elastic forces.

        Args:
            position: of the nodes [mm], shape (node_count, 3).
            velocity: of the nodes [mm/s], shape (node_count, 3).

        Returns:
            Elastic force less the lagged stiffness term, f - (h + b) K v [mN], shape (node_count, 3).
        """
        force = np.empty_like(position)
        kernels.assemble(
            self.elements,
            self.polar,
            self.rest_position,
            self.gradient,
            self.volume,
            self.lame,
            self._element_lag,
            position,
            velocity,
            self.rotation,
            self._rotated_gradient,
            self._element_force,
            *self._node_parts,
            force,
            *self._block_parts,
            self._stiffness_factor,
            self._diagonal_block,
            self._diagonal,
            self.solver.blocks,
        )
        return force

    def internal_force(self, position: np.ndarray) -> np.ndarray:
        """Elastic force on each node at rest in these positions [mN], shape (node_count, 3)."""
        return self.assemble(position, np.zeros_like(position))


def _contributions(nodes: np.ndarray, node_count: int, corner_count: int) -> tuple[np.ndarray, ...]:
    """For each node: start in, and lists of, the elements and corners that touch it, in element order."""
    by_node = np.argsort(nodes, kind="stable")
    start = np.searchsorted(nodes[by_node], np.arange(node_count + 1))
    element, corner = np.divmod(by_node, corner_count)
    return start.astype(np.int32), element.astype(np.int32), corner.astype(np.int32)


def _block_contributions(elements: np.ndarray, pairs: np.ndarray, node_count: int) -> tuple[np.ndarray, ...]:
    """For each stored block (row node, column node): the elements and their two corners that add to it."""
    corner_count = elements.shape[1]
    row = np.repeat(elements, corner_count, axis=1).astype(np.int64)
    column = np.tile(elements, corner_count)
    key = (row * node_count + column).ravel()
    stored = pairs[:, 0].astype(np.int64) * node_count + pairs[:, 1]
    by_key = np.argsort(stored)
    place = np.searchsorted(stored[by_key], key)
    place = np.minimum(place, len(stored) - 1)
    found = stored[by_key[place]] == key  # the other half is the transpose of a stored block
    block = by_key[place[found]]
    element, corners = np.divmod(np.flatnonzero(found), corner_count**2)
    row_corner, column_corner = np.divmod(corners, corner_count)
    order = np.argsort(block, kind="stable")
    start = np.searchsorted(block[order], np.arange(len(pairs) + 1))
    lists = (element[order], row_corner[order], column_corner[order])
    return start.astype(np.int32), *(array.astype(np.int32) for array in lists)
