"""The constraint problem of a step: rows for contacts and cavities, their compliance, and their impulses."""

import numpy as np

from taichisoft.kernels import compliance, contact_rows
from taichisoft.kernels.contacts import Contacts
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.constraint_rows import Rows
from taichisoft.step.rigid_motion import RigidMotion

# Rows times non-zeros of the factor: less than some 0.5 ms of work is not worth waking threads.
SMALL_COMPLIANCE = 30e6
# Sizes of the problem whose arrays are kept: the number of contacts goes up and down by a few.
KEPT_SIZES = 8


class ConstraintProblem:
    """Find impulses such that velocities after the step obey contact, friction and imposed volumes.

    With v the velocity of each row after the step, v = free + W impulse. A contact has three rows: normal
    (velocity plus gap / h, at least 0), and two tangents. A cavity of imposed volume has one: its rate of volume
    less the rate that reaches the imposed growth at the end of the step. (Imposed pressures are known impulses.)

    Attributes:
        rows: the arrays, which are used again by the next problem of this size.
        node_impulse: J^T impulse on the soft nodes [mN s], shape (node_count, 3).
        iterations: sweeps of the Gauss-Seidel, of all problems of a step.
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
        self._node_velocity = np.empty((model.node_count, 3))
        self.node_impulse = np.zeros((model.node_count, 3))
        self._kept: dict[tuple[int, int], Rows] = {}
        self.iterations = 0

    def _rows_of(self, count: int, cavity_count: int) -> Rows:
        """Arrays of this size; those that were not used for the longest time are dropped."""
        size = (count, cavity_count)
        rows = self._kept.pop(size, None) or Rows(self._model, count, cavity_count)
        self._kept[size] = rows
        if len(self._kept) > KEPT_SIZES:
            del self._kept[next(iter(self._kept))]
        return rows

    def lay_out(self, state: State, contacts: Contacts) -> None:
        """Lay out the rows at the positions of `state`."""
        self._state = state
        cavities = np.flatnonzero(state.cavity_volume_imposed)
        self.rows = rows = self._rows_of(len(contacts.distance), len(cavities))
        rows.cavities[:] = cavities
        if not len(contacts.distance):
            return
        rows.bodies[:] = contacts.bodies
        rows.vertices[:] = contacts.vertices
        rows.vertex_weights[:] = contacts.weights
        rows.points[:] = contacts.points
        rows.normal[:] = contacts.normal
        rows.friction[:] = self._model.friction[rows.bodies[:, 0], rows.bodies[:, 1]]
        rows.approach[:] = (contacts.distance - self._model.scene.contact.contact_distance) / self._time_step
        carriers = self._model.surfaces.carriers
        contact_rows.lay_out(
            len(self._model.soft_bodies),
            len(self._model.rigid_bodies),
            rows.bodies,
            rows.vertices,
            rows.vertex_weights,
            rows.points,
            rows.normal,
            carriers.nodes,
            carriers.weights,
            carriers.owner,
            self._rigid_motion.position,
            rows.basis,
            rows.node,
            rows.weight,
            rows.rigid,
            rows.rigid_jacobian,
        )

    def measure(self, node_velocity: np.ndarray) -> None:
        """Fill the rows' `free` and `compliance`.

        Args:
            node_velocity: of the soft nodes without the impulses to be found [mm/s], shape (node_count, 3).
        """
        rows, rigid = self.rows, self._rigid_motion
        if not rows.count:
            return
        self._node_velocity[:] = node_velocity
        rows.compliance[:] = 0.0
        if self._model.elasticity is not None:
            self._add_soft_compliance()
        if len(rows.bodies):
            contact_rows.contact_velocity(
                rows.node,
                rows.weight,
                rows.basis,
                rows.rigid,
                rows.rigid_jacobian,
                self._node_velocity,
                rigid.velocity,
                rows.approach,
                rows.free,
            )
            contact_rows.add_rigid_compliance(rows.rigid, rows.rigid_jacobian, rigid.inverse_mass, rows.compliance)
        self._measure_volumes()

    def _measure_volumes(self) -> None:
        """Rates of the imposed volumes less those that reach their targets [mm^3/s]."""
        cavities, state, first = self._model.cavities, self._state, 3 * len(self.rows.bodies)
        for row, cavity in enumerate(self.rows.cavities, first):
            entries = slice(cavities.entry_start[cavity], cavities.entry_start[cavity + 1])
            rate = np.vdot(cavities.gradient[entries], self._node_velocity[cavities.entry_node[entries]])
            missing = state.cavity_volume[cavity] - cavities.rest_volume[cavity] - state.cavity_target[cavity]
            self.rows.free[row] = rate + missing / self._time_step

    def _add_soft_compliance(self) -> None:
        assert self._model.elasticity is not None
        solver, cavities, rows = self._model.elasticity.solver, self._model.cavities, self.rows
        small = rows.count * solver.factor_entries < SMALL_COMPLIANCE
        measure = compliance.soft_compliance_serially if small else compliance.soft_compliance
        rows.done[0] = 0
        measure(
            rows.node,
            rows.weight,
            rows.basis,
            rows.cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            solver.position_of_node,
            solver.supernode_of_position,
            solver.parent,
            solver.front,
            solver.rows,
            solver.panel,
            rows.active,
            rows.columns,
            rows.compliance,
            rows.done,
            1,
        )

    def solve(self, start: np.ndarray) -> None:
        """Find the impulses by Gauss-Seidel.

        Args:
            start: impulses on second bodies to start from, in world axes [mN s], shape (contact_count, 3).
        """
        rows, settings = self.rows, self._model.scene.contact
        if not rows.count:
            return
        local = np.einsum("cij,cj->ci", rows.basis, start)
        local[local[:, 0] < 0.0] = 0.0
        rows.impulse[: local.size] = local.reshape(-1)
        rows.impulse[local.size :] = self._state.cavity_impulse[rows.cavities]
        rows.gauss_seidel.solve(
            rows.compliance, rows.free, rows.friction, rows.impulse, settings.tolerance, settings.max_iterations
        )
        self.iterations += rows.gauss_seidel.iterations
        self._apply_impulses()

    def _apply_impulses(self) -> None:
        cavities, rows = self._model.cavities, self.rows
        contact_rows.apply_impulses(
            rows.node,
            rows.weight,
            rows.basis,
            rows.rigid,
            rows.rigid_jacobian,
            rows.cavities,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            rows.impulse,
            rows.contact_impulse,
            self.node_impulse,
            self._rigid_motion.impulse,
        )

    @property
    def residual(self) -> float:
        """Largest change of a block's own velocity in the last sweep [mm/s, of a cavity mm^3/s]."""
        return self.rows.gauss_seidel.residual

    @property
    def slip(self) -> np.ndarray:
        """Sliding speed of each contact that presses, else 0 [mm/s], shape (contact_count,)."""
        count = 3 * len(self.rows.bodies)
        tangential = self.rows.gauss_seidel.velocity[:count].reshape(-1, 3)[:, 1:]
        return np.where(self.rows.impulse[:count:3] > 0.0, np.linalg.norm(tangential, axis=1), 0.0)

    @property
    def cavity_impulse(self) -> np.ndarray:
        """Pressure times step of every cavity, imposed or found [kPa s], shape (cavity_count,)."""
        result = self._state.cavity_target * self._time_step
        result[self.rows.cavities] = self.rows.impulse[3 * len(self.rows.bodies) :]
        return result
