"""The soft bodies of a model together: element arrays, forces and the system matrix of a step."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from taichisoft.bodies.elements import edge_frames, linear_tetrahedra
from taichisoft.bodies.soft_body import SoftBody
from taichisoft.cholesky.solver import Cholesky
from taichisoft.kernels import elasticity as kernels


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
        self._polar = np.repeat([int(body.settings.corotation == "polar") for body in bodies], counts).astype(np.int32)
        node_counts = [len(body.rest_position) for body in bodies]
        rayleigh_stiffness = np.array([body.settings.rayleigh_stiffness for body in bodies])
        self.node_rayleigh_mass = np.repeat([body.settings.rayleigh_mass for body in bodies], node_counts)
        self.node_lag = np.repeat(time_step + rayleigh_stiffness, node_counts)  # h + b
        self._element_lag = np.repeat(time_step + rayleigh_stiffness, counts)
        self._diagonal = (
            1.0 + time_step * self.node_rayleigh_mass
        ) * self.node_mass + time_step * self.node_lag * self.anchor_stiffness
        self._lay_out_elements(time_step * self._element_lag)
        self._lay_out_blocks()

    def _lay_out_elements(self, stiffness_factor: np.ndarray) -> None:
        """Element data for the kernel; `stiffness_factor`, K's in A, has shape (element_count,)."""
        corners = self.rest_position[self.elements[:, :3]]
        self._rest_frame = edge_frames(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        shear_weight = np.sqrt(stiffness_factor[:, None] * self.volume * self.lame[:, 1:])
        self._shape_gradient = _points_apart(self.gradient)
        self._scaled_gradient = _points_apart(shear_weight[:, :, None, None] * self.gradient)
        self._rotated_gradient = np.zeros_like(self._scaled_gradient)
        self._element_force = np.zeros(4 * self.elements.size)
        self._corners = self.elements.reshape(-1)
        self.rotation = np.empty((len(self.elements), 3, 3))
        self._position, self._velocity = np.empty(self.rest_position.size), np.empty(self.rest_position.size)
        self._force = np.empty_like(self.rest_position)
        self._progress = np.zeros(2, dtype=np.int32)

    def _lay_out_blocks(self) -> None:
        """The solver, and where the parts of each of its blocks stand."""
        corner_count, node_count = self.elements.shape[1], len(self.rest_position)
        row, column = np.repeat(self.elements, corner_count, axis=1), np.tile(self.elements, corner_count)
        pattern = sparse.csr_matrix((np.ones(row.size), (row.ravel(), column.ravel())), (node_count, node_count))
        self.solver = Cholesky(pattern)
        pairs = self.solver.block_pairs
        start, element, row_corner, column_corner = _block_contributions(self.elements, pairs, node_count)
        row_place = 4 * (element * corner_count + row_corner)
        column_place = 4 * (element * corner_count + column_corner)
        ratio = (self.lame[:, 0] / self.lame[:, 1])[element]
        self._block_parts = (start, row_place.astype(np.int32), column_place.astype(np.int32), ratio)
        self._diagonal_block = np.where(pairs[:, 0] == pairs[:, 1], pairs[:, 0], -1).astype(np.int32)

    def assemble(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Fill the solver's blocks with A, its rotations frozen at these positions, and sum the elastic forces.

        Args:
            position: of the nodes [mm], shape (node_count, 3).
            velocity: of the nodes [mm/s], shape (node_count, 3).

        Returns:
            Elastic force less the lagged stiffness term, f - (h + b) K v [mN], shape (node_count, 3); it is
            overwritten by the next call.
        """
        self._position[:] = position.reshape(-1)
        self._velocity[:] = velocity.reshape(-1)
        self._progress[:] = 0
        kernels.assemble(
            self.elements.shape[1],
            self._corners,
            self._polar,
            self._rest_frame,
            self.volume,
            self._shape_gradient,
            self._scaled_gradient,
            self.lame,
            self._element_lag,
            self._position,
            self._velocity,
            self.rotation,
            self._rotated_gradient,
            self._element_force,
            *self._block_parts,
            self._diagonal_block,
            self._diagonal,
            self._force,
            self.solver.blocks,
            self._progress,
        )
        return self._force

    def internal_force(self, position: np.ndarray) -> np.ndarray:
        """Elastic force on each node at rest in these positions [mN], shape (node_count, 3)."""
        return self.assemble(position, np.zeros_like(position)).copy()


def _points_apart(gradient: np.ndarray) -> np.ndarray:
    """Gradients (element, point, corner, 3) point by point, each vector filled up to four numbers, as one row."""
    return np.ascontiguousarray(np.pad(gradient.transpose(1, 0, 2, 3), ((0, 0), (0, 0), (0, 0), (0, 1)))).reshape(-1)


def _block_contributions(elements: np.ndarray, pairs: np.ndarray, node_count: int) -> tuple[np.ndarray, ...]:
    """For each stored block (row node, column node): start in, and lists of, elements and their two corners."""
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
    return start.astype(np.int32), element[order], row_corner[order], column_corner[order]
