"""Free velocities and compliance matrix of the constraint rows."""

import numpy as np

from taichisoft.actuators.kernels.coordinate_gradients import Coordinates, Gradient
from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.cholesky.kernels.sparse_columns import GROUP
from taichisoft.runtime.language import THREADS
from taichisoft.solver.constraint_rows import ConstraintRows
from taichisoft.solver.kernels import moment_rows, row_velocities
from taichisoft.solver.kernels.row_compliance import lay_out_columns, soft_compliance, soft_compliance_serially
from taichisoft.step.soft_motion import SoftMotion

# Rows times non-zeros of the factor; less than about 0.5 ms of work does not justify waking threads.
SMALL_COMPLIANCE = 30e6
NO_VELOCITY = np.zeros((0, 3))


def assemble_compliance(
    problem: ConstraintRows,
    coordinates: Coordinates,
    gradient: Gradient,
    own_compliances: tuple[tuple[int, np.ndarray], ...],
    soft: SoftMotion | None,
    rigid: RigidState,
) -> None:
    """Fill in the rows' velocities without impulses, and W of soft bodies, rigid bodies and actuators.

    Args:
        problem: the rows, with the bodies on which they act.
        coordinates: coordinates of the actuators.
        gradient: gradients of the coordinates.
        own_compliances: compliances of actuators themselves, see `ActuatorRequests.compliances`.
        soft: the soft bodies of the step, or None.
        rigid: the rigid bodies of the step.
    """
    rows, w = problem.rows, problem.compliance
    contact_count, actuator_count, moment_count = rows.size.tolist()
    row_count = problem.row_count
    known_velocity = soft.known_velocity if soft is not None else NO_VELOCITY
    if contact_count:
        row_velocities.free_contact_velocity(rows, known_velocity, rigid)
    if actuator_count:
        row_velocities.free_actuator_velocity(rows, coordinates, gradient, known_velocity, rigid)
    if soft is not None and row_count:
        _assemble_soft_compliance(row_count, problem, coordinates, gradient, soft)
    else:
        w[: row_count**2] = 0.0
    if contact_count:
        row_velocities.add_rigid_compliance(row_count, rows, rigid, w)
    if actuator_count:
        _add_own_compliances(3 * contact_count, own_compliances, w[: row_count**2].reshape(row_count, row_count))
        if len(gradient.rigid):
            row_velocities.add_rigid_actuator_compliance(rows, coordinates, gradient, rigid, w)
    if moment_count:
        moment_rows.free_moment_velocity(rows, rigid)
        moment_rows.add_moment_compliance(row_count, rows, coordinates, gradient, rigid, w)


def _assemble_soft_compliance(
    row_count: int, problem: ConstraintRows, coordinates: Coordinates, gradient: Gradient, soft: SoftMotion
) -> None:
    """Fill in W of the soft bodies, and the effect of their forces on the rows' velocities."""
    solver, rows = soft.system.solver, problem.rows
    symbolic = solver.symbolic
    if row_count * symbolic.factor_entries < SMALL_COMPLIANCE:
        # The largest possible size is small here, and allocating it saves a launch.
        assemble, workers, entries = soft_compliance_serially, 1, -(-row_count // GROUP) * 3 * len(symbolic.order)
    else:
        lay_out_columns(rows, coordinates, soft.system.modes, symbolic.tree, symbolic.fronts, problem.columns)
        assemble, workers, entries = soft_compliance, THREADS, int(problem.columns.size[0])
    problem.make_room_for_columns(entries)
    columns = problem.columns
    columns.progress[:] = 0
    tree, fronts, w = symbolic.tree, symbolic.fronts, problem.compliance
    modes, factor, begun = soft.system.modes, solver.factor, solver.begun
    assemble(rows, coordinates, gradient, modes, tree, fronts, factor, columns, begun, w, workers, 1)


def _add_own_compliances(first_row: int, own_compliances: tuple[tuple[int, np.ndarray], ...], w: np.ndarray) -> None:
    for row, own in own_compliances:
        place = slice(first_row + row, first_row + row + len(own))
        w[place, place] += own
