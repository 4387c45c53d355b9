"""The constraint problem of a step, and what is a solution's."""

from typing import NamedTuple

from taichisoft.kernels.axpy import add_multiple
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS
from taichisoft.kernels.launch import func
from taichisoft.kernels.runtime import Integers, Scalars, ScalarTable, ti


class Problem(NamedTuple):
    """The constraint problem: v = free + W l, with the conditions of contact, friction and actuators.

    Contacts' rows come first, then those of actuators, whose impulses are efforts times the time step.

    Attributes:
        size: number of contacts and of actuator rows, shape (2,).
        compliance: W by rows [mm/s per mN s, and the like for volumes], shape (row_capacity^2,).
        free: velocities without impulses [mm/s, of a volume mm^3/s], shape (row_capacity,).
        friction: coefficient of each contact, shape (contact_capacity,).
        bounds: what each actuator row obeys, see `actuator_rows`, shape (actuator_capacity, 6).
    """

    size: Integers
    compliance: Scalars
    free: Scalars
    friction: Scalars
    bounds: ScalarTable


class Iterate(NamedTuple):
    """Impulses [mN s, of a volume kPa s] and the velocities that belong to them, each of shape (row_capacity,)."""

    impulse: Scalars
    velocity: Scalars


@func
def row_count(problem: Problem) -> ti.i32:
    """Three rows for a contact, one for an actuator's."""
    return 3 * problem.size[CONTACTS] + problem.size[ACTUATORS]


@func
def measure_velocity(problem: Problem, iterate: Iterate):
    """velocity = free + W impulse."""
    count = row_count(problem)
    for k in range(count):
        iterate.velocity[k] = problem.free[k]
    for row in range(count):
        if iterate.impulse[row] != 0.0:
            add_multiple(iterate.velocity, 0, iterate.impulse[row], problem.compliance, row * count, count)


@func
def copy_iterate(rows: ti.i32, source: Iterate, target: Iterate):
    """Impulses and velocities."""
    for k in range(rows):
        target.impulse[k] = source.impulse[k]
        target.velocity[k] = source.velocity[k]


@func
def project(problem: Problem, impulse: Scalars):
    """Move every contact's impulse to its friction cone: no pull, and |l_t| <= mu l_n."""
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        impulse[n] = ti.max(0.0, impulse[n])
        size = ti.sqrt(impulse[n + 1] * impulse[n + 1] + impulse[n + 2] * impulse[n + 2])
        limit = problem.friction[c] * impulse[n]
        if size > limit:
            impulse[n + 1] = impulse[n + 1] * (limit / size)
            impulse[n + 2] = impulse[n + 2] * (limit / size)
