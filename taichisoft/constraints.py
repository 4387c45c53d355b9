"""The constraint problem of a step: rows for contacts and cavities, their compliance, and their impulses."""

import numpy as np

from taichisoft.detection import ContactPairs
from taichisoft.gauss_seidel import GaussSeidel
from taichisoft.kernels import compliance, contact_rows
from taichisoft.kernels.compliance import GROUP
from taichisoft.model import Model
from taichisoft.rigid_motion import RigidMotion
from taichisoft.state import State

# Rows times non-zeros of the factor: less than some 0.5 ms of work is not worth waking threads.
SMALL_COMPLIANCE = 30e6


class ConstraintProblem:
    """Find impulses such that velocities after the step obey contact, friction and imposed volumes.

    With v the velocity of each row after the step, v = free + W impulse. A contact has three rows: normal
    (velocity plus gap / h, at least 0), and two tangents. A cavity of imposed volume has one: its rate of volume
    less the rate that reaches the imposed growth at the end of the step. (Imposed pressures are known impulses.)

    The arrays are used again in the next step, and made anew only when the number of rows changes.

    Attributes:
        contacts: the pairs.
        basis: normal and two tangents of each contact, as rows, shape (contact_count, 3, 3).
        compliance: W [mm/s per mN s and the like for volumes], shape (row_count, row_count).
        free: velocities [mm/s] or volume rates [mm^3/s] without impulses, shape (row_count,).
        impulse: [mN s] of contacts, pressure times step [kPa s] of cavities, shape (row_count,).
        contact_impulse: on the second body in world axes [mN s], shape (contact_count, 3).
        node_impulse: J^T impulse on the soft nodes [mN s], shape (node_count, 3).
    """

    def __init__(self, model: Model, rigid_motion: RigidMotion):
        """Make the buffers whose size does not depend on the contacts.

        Args:
            model: the bodies.
            rigid_motion: the rigid bodies of a step; it gets the impulses that are found.
        """
        self._model = model
        self._rigid_motion = rigid_motion
        self._time_step = model.scene.time.step
        self._slots = 6 * model.surfaces.vertex_nodes.shape[1]
        self._node_velocity = np.empty((model.node_count, 3))
        self.node_impulse = np.zeros((model.node_count, 3))
        self._make_room(0, 0)

    def _make_room(self, count: int, cavity_count: int) -> None:
        self._bodies = np.empty((count, 2), dtype=np.int32)
        self._vertices = np.empty((count, 2, 3), dtype=np.int32)
        self._vertex_weights = np.empty((count, 2, 3))
        self._points = np.empty((count, 2, 3))
        self._normal = np.empty((count, 3))
        self._approach = np.empty(count)
        self._friction = np.empty(count)
        self.basis = np.empty((count, 3, 3))
        self._node = np.empty((count, self._slots), dtype=np.int32)
        self._weight = np.empty((count, self._slots))
        self._rigid = np.empty((count, 2), dtype=np.int32)
        self._rigid_jacobian = np.zeros((3 * count, 2, 6))
        self.contact_impulse = np.empty((count, 3))
        self._cavities = np.empty(cavity_count, dtype=np.int32)
        rows = 3 * count + cavity_count
        self.row_count = rows
        self.compliance = np.empty((rows, rows))
        self.free, self.impulse = np.empty(rows), np.empty(rows)
        self._gauss_seidel = GaussSeidel(rows)
        groups = -(-rows // GROUP)
        if self._model.elasticity is not None:
            solver = self._model.elasticity.solver
            self._active = np.empty((groups, len(solver.parent)), dtype=np.int32)
            self._columns = np.empty((groups, 3 * len(solver.order), GROUP))
            self._done = np.zeros(1, dtype=np.int32)

    def lay_out(self, state: State, contacts: ContactPairs) -> None:
        """Lay out the rows at the positions of `state`."""
        self.contacts = contacts
        self._state = state
        cavities = np.flatnonzero(state.cavity_volume_imposed)
        if contacts.count != len(self._bodies) or len(cavities) != len(self._cavities):
            self._make_room(contacts.count, len(cavities))
        self._cavities[:] = cavities
        if not contacts.count:
            return
        self._bodies[:] = contacts.bodies
        self._vertices[:] = contacts.vertices
        self._vertex_weights[:] = contacts.weights
        self._points[:] = contacts.points
        self._normal[:] = contacts.normal
        self._friction[:] = self._model.friction[self._bodies[:, 0], self._bodies[:, 1]]
        self._approach[:] = (contacts.distance - self._model.scene.contact.contact_distance) / self._time_step
        surfaces = self._model.surfaces
        contact_rows.lay_out(
            len(self._model.soft_bodies),
            len(self._model.rigid_bodies),
            self._bodies,
            self._vertices,
            self._vertex_weights,
            self._points,
            self._normal,
            surfaces.vertex_nodes,
            surfaces.vertex_weights,
            surfaces.vertex_owner,
            self._rigid_motion.position,
            self.basis,
            self._node,
            self._weight,
            self._rigid,
            self._rigid_jacobian,
        )

    def measure(self, node_velocity: np.ndarray) -> None:
        """Fill `free` and `compliance`.

        Args:
            node_velocity: of the soft nodes without the impulses to be found [mm/s], shape (node_count, 3).
        """
        if not self.row_count:
            return
        self._node_velocity[:] = node_velocity
        self.compliance[:] = 0.0
        if self._model.elasticity is not None:
            self._add_soft_compliance()
        if self.contacts.count:
            contact_rows.contact_velocity(
                self._node,
                self._weight,
                self.basis,
                self._rigid,
                self._rigid_jacobian,
                self._node_velocity,
                self._rigid_motion.velocity,
                self._approach,
                self.free,
            )
            contact_rows.add_rigid_compliance(
                self._rigid, self._rigid_jacobian, self._rigid_motion.inverse_mass, self.compliance
            )
        self._measure_volumes()

    def _measure_volumes(self) -> None:
        """Rates of the imposed volumes less those that reach their targets [mm^3/s]."""
        cavities, state, first = self._model.cavities, self._state, 3 * self.contacts.count
        for row, cavity in enumerate(self._cavities, first):
            entries = slice(cavities.entry_start[cavity], cavities.entry_start[cavity + 1])
            rate = np.vdot(cavities.gradient[entries], self._node_velocity[cavities.entry_node[entries]])
            missing = state.cavity_volume[cavity] - cavities.rest_volume[cavity] - state.cavity_target[cavity]
            self.free[row] = rate + missing / self._time_step

    def _add_soft_compliance(self) -> None:
        assert self._model.elasticity is not None
        solver, cavities = self._model.elasticity.solver, self._model.cavities
        small = self.row_count * solver.factor_entries < SMALL_COMPLIANCE
        measure = compliance.soft_compliance_serially if small else compliance.soft_compliance
        self._done[0] = 0
        measure(
            self._node,
            self._weight,
            self.basis,
            self._cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            solver.position_of_node,
            solver.supernode_of_position,
            solver.parent,
            solver.front,
            solver.rows,
            solver.panel,
            self._active,
            self._columns,
            self.compliance,
            self._done,
            1,
        )

    def solve(self) -> None:
        """Find the impulses by Gauss-Seidel, from those of the last step."""
        if not self.row_count:
            return
        settings = self._model.scene.contact
        self._warm_start()
        self._gauss_seidel.solve(
            self.compliance, self.free, self._friction, self.impulse, settings.tolerance, settings.max_iterations
        )
        self._apply_impulses()

    def _warm_start(self) -> None:
        state, count = self._state, self.contacts.count
        self.impulse[: 3 * count] = 0.0
        self.impulse[3 * count :] = state.cavity_impulse[self._cavities]
        if not count:
            return
        matched = self._model.contact_selection.match(
            self.contacts,
            state.contact_key,
            state.contact_point,
            max(self._model.scene.contact.spacing, self._model.scene.contact.contact_distance),
        )
        known = np.flatnonzero(matched >= 0)
        local = np.einsum("cij,cj->ci", self.basis[known], state.contact_impulse[matched[known]])
        local[local[:, 0] < 0.0] = 0.0
        self.impulse[: 3 * count].reshape(-1, 3)[known] = local

    def _apply_impulses(self) -> None:
        cavities = self._model.cavities
        contact_rows.apply_impulses(
            self._node,
            self._weight,
            self.basis,
            self._rigid,
            self._rigid_jacobian,
            self._cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            self.impulse,
            self.contact_impulse,
            self.node_impulse,
            self._rigid_motion.impulse,
        )

    @property
    def iterations(self) -> int:
        """Sweeps of the Gauss-Seidel."""
        return self._gauss_seidel.iterations

    @property
    def residual(self) -> float:
        """Largest change of a block's own velocity in the last sweep [mm/s, of a cavity mm^3/s]."""
        return self._gauss_seidel.residual

    @property
    def cavity_impulse(self) -> np.ndarray:
        """Pressure times step of every cavity, imposed or found [kPa s], shape (cavity_count,)."""
        result = self._state.cavity_target * self._time_step
        result[self._cavities] = self.impulse[3 * self.contacts.count :]
        return result
