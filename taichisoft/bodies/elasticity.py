"""The soft bodies of a model together: element arrays, forces and the system matrix of a step."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from taichisoft.bodies.elements import edge_frames, linear_tetrahedra
from taichisoft.bodies.soft_body import SoftBody
from taichisoft.cholesky.solver import Cholesky
from taichisoft.cholesky.symbolic import SymbolicFactor
from taichisoft.kernels import elasticity as kernels
from taichisoft.scenes.scene import Time


class Elasticity:
    """All soft bodies, whose matrix A = (1 + h a) M + h (h + b) K has one block of trees per body; it never changes.

    In first order dynamics A = h M + h^2 K: mass is a drag, so M v = f - h K v, here times h. A times a velocity is an
    impulse as before, so that contacts and actuators need not know the difference.

    Attributes:
        elements: node indices, shape (element_count, nodes_per_element).
        rest_position: of the nodes [mm], shape (node_count, 3).
        lame: Lame's lambda and mu of each element [kPa], shape (element_count, 2).
        gradient: of the shape functions [1/mm], shape (element_count, point_count, nodes_per_element, 3).
        volume: of each quadrature point [mm^3], shape (element_count, point_count).
        node_mass: [kg], shape (node_count,).
        node_rayleigh_mass: Rayleigh's factor a [1/s], shape (node_count,).
        node_lag: h + b [s]: forces are those of positions so far ahead along the velocities; 0 in first order dynamics,
            where there are no velocities before the step; shape (node_count,).
        anchor_stiffness: along x, y and z [mN/mm], shape (node_count, 3).
        symbolic: the pattern of A and of its factor.
        element_data, block_parts: what the kernels read.
    """

    def __init__(self, bodies: Sequence[SoftBody], time: Time):
        """Lay out the arrays for steps of `time`."""
        counts = [len(body.elements) for body in bodies]
        self.elements = np.vstack([body.elements + body.nodes.start for body in bodies]).astype(np.int32)
        self.rest_position = np.vstack([body.rest_position for body in bodies])
        self.gradient, self.volume = linear_tetrahedra(self.rest_position, self.elements)
        self.lame = np.vstack([body.lame for body in bodies])
        self.node_mass = np.concatenate([body.node_mass for body in bodies])
        self.anchor_stiffness = np.vstack([body.anchor_stiffness for body in bodies])
        node_counts = [len(body.rest_position) for body in bodies]
        rayleigh_mass = np.array([body.settings.rayleigh_mass for body in bodies])
        lag = np.array([time.step + body.settings.rayleigh_stiffness for body in bodies])
        mass_factor, stiffness_factor = 1.0 + time.step * rayleigh_mass, time.step * lag
        if time.dynamics == "first order":
            rayleigh_mass, lag = np.zeros(len(bodies)), np.zeros(len(bodies))
            mass_factor, stiffness_factor = np.full(len(bodies), time.step), np.full(len(bodies), time.step**2)
        self.node_rayleigh_mass = np.repeat(rayleigh_mass, node_counts)
        self.node_lag = np.repeat(lag, node_counts)
        polar = np.repeat([int(body.settings.corotation == "polar") for body in bodies], counts).astype(np.int32)
        self.element_data = self._element_data(polar, np.repeat(lag, counts), np.repeat(stiffness_factor, counts))
        held = np.repeat(stiffness_factor, node_counts)[:, None] * self.anchor_stiffness
        diagonal = (np.repeat(mass_factor, node_counts) * self.node_mass)[:, None] + held
        nodes_per_element, node_count = self.elements.shape[1], len(self.rest_position)
        row, column = np.repeat(self.elements, nodes_per_element, axis=1), np.tile(self.elements, nodes_per_element)
        pattern = sparse.csr_matrix((np.ones(row.size), (row.ravel(), column.ravel())), (node_count, node_count))
        self.symbolic = SymbolicFactor(pattern)
        self.block_parts = self._block_parts(diagonal)

    def _element_data(self, polar: np.ndarray, lag: np.ndarray, stiffness_factor: np.ndarray) -> kernels.Elements:
        corners = self.rest_position[self.elements[:, :3]]
        shear_weight = np.sqrt(stiffness_factor[:, None] * self.volume * self.lame[:, 1:])
        return kernels.Elements(
            nodes=self.elements.reshape(-1),
            polar=polar,
            rest_frame=edge_frames(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
            volume=self.volume,
            gradient=_points_apart(self.gradient),
            scaled_gradient=_points_apart(shear_weight[:, :, None, None] * self.gradient),
            lame=self.lame,
            lag=lag,
        )

    def _block_parts(self, diagonal: np.ndarray) -> kernels.BlockParts:
        nodes_per_element, pairs = self.elements.shape[1], self.symbolic.block_pairs
        start, element, row_corner, column_corner = _block_contributions(self.elements, pairs, len(diagonal))
        return kernels.BlockParts(
            start=start,
            row_place=(4 * (element * nodes_per_element + row_corner)).astype(np.int32),
            column_place=(4 * (element * nodes_per_element + column_corner)).astype(np.int32),
            lame_ratio=(self.lame[:, 0] / self.lame[:, 1])[element],
            diagonal_node=np.where(pairs[:, 0] == pairs[:, 1], pairs[:, 0], -1).astype(np.int32),
            diagonal=diagonal,
        )


class ElasticSystem:
    """The elastic forces and the matrix A at present positions, and with present stiffnesses.

    Attributes:
        position, velocity: of the nodes [mm] and [mm/s], which the caller fills, shape (node_count, 3).
        force: elastic force less the lagged stiffness term, f - (h + b) K v [mN], shape (node_count, 3).
        rotation: of each element, shape (element_count, 3, 3).
        solver: the direct solver, whose blocks are A.
    """

    def __init__(self, elasticity: Elasticity):
        """Make room."""
        self._elasticity = elasticity
        self._elements = elasticity.element_data
        self._own_elements: kernels.Elements | None = None  # with room for other stiffnesses than the model's
        self.solver = Cholesky(elasticity.symbolic)
        data, node_count = elasticity.element_data, len(elasticity.rest_position)
        self.position, self.velocity, self.force = (np.zeros((node_count, 3)) for _ in range(3))
        self.rotation = np.empty((len(elasticity.elements), 3, 3))
        self._deformation = kernels.Deformation(
            position=self.position.reshape(-1),
            velocity=self.velocity.reshape(-1),
            rotation=self.rotation,
            rotated_gradient=np.zeros_like(data.scaled_gradient),
            element_force=np.zeros(4 * elasticity.elements.size),
        )
        self._matrix = kernels.SystemMatrix(self.force, self.solver.blocks, np.zeros(2, dtype=np.int32))

    def scale_stiffness(self, factor: np.ndarray) -> None:
        """Make each element so many times as stiff as it is in the model, its Poisson's ratio unchanged.

        Args:
            factor: of each element [-], shape (element_count,); with 1 everywhere the bits are those of the model.
        """
        model = self._elasticity.element_data
        if (factor == 1.0).all():
            self._elements = model
            return
        if self._own_elements is None:
            self._own_elements = model._replace(
                scaled_gradient=np.empty_like(model.scaled_gradient), lame=np.empty_like(model.lame)
            )
        self._elements = own = self._own_elements
        np.multiply(model.lame, factor[:, None], out=own.lame)
        # Products of two gradients make the matrix. Element by element, for each of the quadrature points.
        by_element = (model.volume.shape[1], len(factor), -1)
        root = np.sqrt(factor)[:, None]
        np.multiply(model.scaled_gradient.reshape(by_element), root, out=own.scaled_gradient.reshape(by_element))

    def assemble(self) -> None:
        """Fill `force`, and the solver's blocks with A, its rotations frozen at `position`."""
        self._matrix.progress[:] = 0
        elasticity = self._elasticity
        kernels.assemble(
            elasticity.elements.shape[1],
            self._elements,
            self._deformation,
            elasticity.block_parts,
            self._matrix,
        )


def internal_force(elasticity: Elasticity, position: np.ndarray) -> np.ndarray:
    """Elastic force on each node at rest in these positions [mN], position [mm] and result of shape (node_count, 3)."""
    system = ElasticSystem(elasticity)
    system.position[:] = position
    system.assemble()
    return system.force


def _points_apart(gradient: np.ndarray) -> np.ndarray:
    """Gradients (element, point, corner, 3) point by point, each vector filled up to four numbers, as one row."""
    return np.ascontiguousarray(np.pad(gradient.transpose(1, 0, 2, 3), ((0, 0), (0, 0), (0, 0), (0, 1)))).reshape(-1)


def _block_contributions(elements: np.ndarray, pairs: np.ndarray, node_count: int) -> tuple[np.ndarray, ...]:
    """For each stored block (row node, column node): start in, and lists of, elements and their two corners."""
    nodes_per_element = elements.shape[1]
    row = np.repeat(elements, nodes_per_element, axis=1).astype(np.int64)
    column = np.tile(elements, nodes_per_element)
    key = (row * node_count + column).ravel()
    stored = pairs[:, 0].astype(np.int64) * node_count + pairs[:, 1]
    by_key = np.argsort(stored)
    place = np.searchsorted(stored[by_key], key)
    place = np.minimum(place, len(stored) - 1)
    found = stored[by_key[place]] == key  # the other half is the transpose of a stored block
    block = by_key[place[found]]
    element, corners = np.divmod(np.flatnonzero(found), nodes_per_element**2)
    row_corner, column_corner = np.divmod(corners, nodes_per_element)
    order = np.argsort(block, kind="stable")
    start = np.searchsorted(block[order], np.arange(len(pairs) + 1))
    return start.astype(np.int32), element[order], row_corner[order], column_corner[order]
