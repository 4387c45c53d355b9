"""The constraint problem of a step: rows for contacts and cavities, their compliance, and their impulses."""

import numpy as np

from taichisoft.detection import ContactPairs, match, pair_key
from taichisoft.kernels import compliance as kernels
from taichisoft.kernels import gauss_seidel
from taichisoft.kernels.compliance import GROUP
from taichisoft.model import Model
from taichisoft.state import State


class ConstraintProblem:
    """Find impulses such that velocities after the step obey contact, friction and imposed volumes.

    With v the velocity of each row after the step, v = free + W impulse. A contact has three rows: normal
    (velocity plus gap / h, at least 0), and two tangents. A cavity of imposed volume has one: its rate of volume
    less the rate that reaches the imposed growth at the end of the step. (Imposed pressures are known impulses.)

    Attributes:
        contacts: the pairs.
        basis: normal and two tangents of each contact, as rows, shape (contact_count, 3, 3).
        compliance: W [mm/s per mN s and the like for volumes], shape (row_count, row_count).
        free: velocities [mm/s] or volume rates [mm^3/s] without impulses, shape (row_count,).
        impulse: [mN s] of contacts, pressure times step [kPa s] of cavities, shape (row_count,).
        iterations: sweeps of the Gauss-Seidel.
        residual: largest change of a row's velocity in the last sweep [mm/s].
    """

    def __init__(self, model: Model, state: State, contacts: ContactPairs):
        """Lay out the rows at the positions of `state`."""
        self.contacts = contacts
        self._model = model
        self._state = state
        self._time_step = model.scene.time.step
        self.basis = contact_basis(contacts.normal)
        self._cavities = np.flatnonzero(state.cavity_volume_imposed).astype(np.int32)
        self._find_entries()
        self.row_count = 3 * contacts.count + len(self._cavities)
        self.impulse = np.zeros(self.row_count)
        self.iterations, self.residual = 0, 0.0

    def _find_entries(self) -> None:
        """Soft nodes and rigid bodies that each contact acts on."""
        surfaces, count = self._model.surfaces, self.contacts.count
        slots = 6 * surfaces.vertex_nodes.shape[1]
        self._node = np.empty((count, slots), dtype=np.int32)
        self._weight = np.empty((count, slots))
        self._rigid = np.full((count, 2), -1, dtype=np.int32)
        self._rigid_jacobian = np.zeros((max(1, 3 * count), 2, 6))
        if count == 0:
            return
        kernels.soft_entries(
            self.contacts.vertices,
            self.contacts.weights,
            surfaces.vertex_nodes,
            surfaces.vertex_weights,
            surfaces.vertex_owner,
            self._node,
            self._weight,
        )
        first_rigid, rigid_count = len(self._model.soft_bodies), len(self._model.rigid_bodies)
        rigid = self.contacts.bodies - first_rigid
        self._rigid = np.where((rigid >= 0) & (rigid < rigid_count), rigid, -1).astype(np.int32)
        if rigid_count == 0:
            return
        for side, direction in ((0, -1.0), (1, 1.0)):
            arm = self.contacts.points[:, side] - self._state.rigid_position[self._rigid[:, side]]
            linear = direction * self.basis
            angular = np.cross(arm[:, None], linear)
            on_rigid = np.repeat(self._rigid[:, side] >= 0, 3)
            rows = np.concatenate([linear, angular], axis=2).reshape(-1, 6)
            self._rigid_jacobian[:, side] = np.where(on_rigid[:, None], rows, 0.0)

    def measure(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray, inverse_mass: np.ndarray) -> None:
        """Fill `free` and `compliance`.

        Args:
            node_velocity: of the soft nodes without the impulses to be found [mm/s], shape (node_count, 3).
            rigid_velocity: linear and angular of the rigid bodies likewise, shape (rigid_count, 6).
            inverse_mass: of the rigid bodies in world axes, shape (rigid_count, 6, 6).
        """
        count = self.contacts.count
        self.free = np.empty(self.row_count)
        self.free[: 3 * count] = self._contact_velocities(node_velocity, rigid_velocity).reshape(-1)
        self.free[3 * count :] = self._volume_rates(node_velocity)
        self.compliance = np.zeros((self.row_count, self.row_count))
        if self._model.elasticity is not None and self.row_count:
            self._add_soft_compliance()
        if len(self._model.rigid_bodies) and count:
            kernels.rigid_compliance(self._rigid, self._rigid_jacobian, inverse_mass, self.compliance)

    def _contact_velocities(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> np.ndarray:
        """Relative velocities in the bases, plus gap / h along the normals [mm/s], shape (contact_count, 3)."""
        velocity = np.empty((self.contacts.count, 3))
        if self.contacts.count:
            kernels.contact_velocity(
                self._node,
                self._weight,
                self.basis,
                self._rigid,
                self._rigid_jacobian,
                node_velocity,
                rigid_velocity,
                velocity,
            )
            gap = self.contacts.distance - self._model.scene.contact.contact_distance
            velocity[:, 0] += gap / self._time_step
        return velocity

    def _volume_rates(self, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of the imposed volumes less those that reach their targets [mm^3/s], shape (imposed_count,)."""
        cavities, state = self._model.cavities, self._state
        missing = state.cavity_volume - cavities.rest_volume - state.cavity_target
        rates = []
        for cavity in self._cavities:
            entries = slice(cavities.entry_start[cavity], cavities.entry_start[cavity + 1])
            rate = np.einsum("kd,kd->", cavities.gradient[entries], node_velocity[cavities.entry_node[entries]])
            rates.append(rate + missing[cavity] / self._time_step)
        return np.array(rates)

    def _add_soft_compliance(self) -> None:
        assert self._model.elasticity is not None
        solver, cavities = self._model.elasticity.solver, self._model.cavities
        groups = -(-self.row_count // GROUP)
        active = np.empty((groups, len(solver.parent)), dtype=np.int32)
        panel = np.empty((groups, 3 * len(solver.order), GROUP))
        kernels.forward_solve(
            self._node,
            self._weight,
            self.basis,
            self._cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            self.row_count,
            solver.position_of_node,
            solver.supernode_of_position,
            solver.parent,
            solver.front,
            solver.rows,
            solver.panel,
            active,
            panel,
        )
        kernels.soft_compliance(solver.front, active, panel, self.compliance)

    def solve(self) -> None:
        """Find the impulses by Gauss-Seidel, from those of the last step."""
        if not self.row_count:
            return
        settings, model = self._model.scene.contact, self._model
        self._warm_start()
        friction = model.friction[self.contacts.bodies[:, 0], self.contacts.bodies[:, 1]]
        outcome = np.zeros(2)
        gauss_seidel.solve(
            self.compliance,
            self.free,
            friction,
            settings.tolerance,
            settings.max_iterations,
            self.impulse,
            np.empty(self.row_count),
            np.empty(self.row_count),
            outcome,
        )
        self.iterations, self.residual = int(outcome[0]), float(outcome[1])

    def _warm_start(self) -> None:
        state, count = self._state, self.contacts.count
        self.impulse[3 * count :] = state.cavity_impulse[self._cavities]
        if not count:
            return
        matched = match(
            pair_key(self.contacts.bodies),
            self.contacts.points.mean(axis=1),
            state.contact_key,
            state.contact_point,
            max(self._model.scene.contact.spacing, self._model.scene.contact.contact_distance),
        )
        known = np.flatnonzero(matched >= 0)
        local = np.einsum("cij,cj->ci", self.basis[known], state.contact_impulse[matched[known]])
        local[local[:, 0] < 0.0] = 0.0
        self.impulse[: 3 * count].reshape(-1, 3)[known] = local

    @property
    def contact_impulse(self) -> np.ndarray:
        """Impulses on the second body in world axes [mN s], shape (contact_count, 3)."""
        local = self.impulse[: 3 * self.contacts.count].reshape(-1, 3)
        return np.einsum("cij,ci->cj", self.basis, local)

    @property
    def cavity_impulse(self) -> np.ndarray:
        """Pressure times step of every cavity, imposed or found [kPa s], shape (cavity_count,)."""
        result = self._state.cavity_target * self._time_step
        result[self._cavities] = self.impulse[3 * self.contacts.count :]
        return result

    def node_impulse(self) -> np.ndarray:
        """J^T impulse on the soft nodes [mN s], shape (node_count, 3)."""
        count, cavities = self.contacts.count, self._model.cavities
        result = np.zeros((self._model.node_count, 3))
        kernels.scatter_impulses(
            self._node,
            self._weight,
            self.basis,
            self.impulse[: 3 * count].reshape(-1, 3),
            self._cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            self.impulse[3 * count :],
            result,
        )
        return result

    def rigid_impulse(self) -> np.ndarray:
        """J^T impulse on the rigid bodies, linear [mN s] and angular [mN mm s], shape (rigid_count, 6)."""
        result = np.zeros((len(self._model.rigid_bodies), 6))
        local = self.impulse[: 3 * self.contacts.count]
        for side in (0, 1):
            body = np.repeat(self._rigid[:, side], 3)
            rows = self._rigid_jacobian[: len(local), side] * local[:, None]
            np.add.at(result, body[body >= 0], rows[body >= 0])
        return result


def contact_basis(normal: np.ndarray) -> np.ndarray:
    """Normal and two tangents as rows of (count, 3, 3): the first tangent is normal to the axis least along it."""
    axis = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)
