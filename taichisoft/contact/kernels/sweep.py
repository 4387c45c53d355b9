"""A sweep of the projected Gauss-Seidel over the blocks of the constraint problem.

The blocks: a contact has three rows, one normal with lambda_n >= 0 and two tangential with |lambda_t| <= mu lambda_n
(Coulomb's cone, exactly); an actuator's coordinate has one row (constraint_problem.py); a moment has three, whose
bounds come from its contact's normal impulse (row_velocities.py).
"""

from taichisoft.contact.kernels.constraint_problem import (
    Iterate,
    Problem,
    add_multiple,
    add_three_multiples,
    best_impulse,
    first_moment,
    measure_velocity,
    row_count,
    tension_before,
)
from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.runtime.language import Scalars, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel


@func
def largest_tangential(c: ti.i32, problem: Problem) -> ti.f64:
    """The larger eigenvalue of the tangential block of contact c."""
    return largest_of_two(3 * c + 1, problem)


@func
def largest_of_two(first_row: ti.i32, problem: Problem) -> ti.f64:
    """The larger eigenvalue of the block of two rows."""
    w = ti.static(problem.compliance)
    rows = row_count(problem)
    row = first_row * (rows + 1)
    first, mixed, second = w[row], w[row + 1], w[row + rows + 1]
    return 0.5 * (first + second) + ti.sqrt((0.5 * (first - second)) ** 2 + mixed**2)


@func
def solve_contact(block: mat3, velocity: vec3, old: vec3, friction: ti.f64) -> vec3:
    """Improved impulse of one contact with all others fixed; `velocity` belongs to the impulse `old`.

    First the normal part, then the tangential part, scaled by the larger eigenvalue of its block: with the mean of both
    eigenvalues (as in SOFA) the iteration may overshoot for ever in a direction of little mobility. More iterations per
    visit do not pay: in a grasp the number of sweeps hardly fell.
    """
    mean = 0.5 * (block[1, 1] + block[2, 2])
    largest = mean + ti.sqrt((0.5 * (block[1, 1] - block[2, 2])) ** 2 + block[1, 2] ** 2)
    impulse = old
    impulse[0] = ti.max(0.0, old[0] - velocity[0] / block[0, 0])
    change = impulse[0] - old[0]
    impulse[1] -= (velocity[1] + block[1, 0] * change) / largest
    impulse[2] -= (velocity[2] + block[2, 0] * change) / largest
    size = ti.sqrt(impulse[1] * impulse[1] + impulse[2] * impulse[2])
    limit = friction * impulse[0]
    if size > limit:
        impulse[1] *= limit / size
        impulse[2] *= limit / size
    return impulse


@func
def sweep(problem: Problem, iterate: Iterate) -> ti.f64:
    """Visit every block once; returns the largest change of a block's own velocity [mm/s, of a volume mm^3/s].

    The velocities follow every change of an impulse (W is symmetric: a row is a column), so that an open contact that
    stays open costs nothing.
    """
    w, impulse, velocity = ti.static(problem.compliance, iterate.impulse, iterate.velocity)
    residual = 0.0
    rows = row_count(problem)
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        # A Newton step may have left any impulse on an open contact.
        acts = impulse[n] != 0.0 or impulse[n + 1] != 0.0 or impulse[n + 2] != 0.0
        if acts or velocity[n] < 0.0:
            old, speed = vec3(0.0), vec3(0.0)
            block = ti.Matrix.zero(ti.f64, 3, 3)
            for i in ti.static(range(3)):
                old[i] = impulse[n + i]
                speed[i] = velocity[n + i]
                for j in ti.static(range(3)):
                    block[i, j] = w[(n + i) * rows + n + j]
            new = solve_contact(block, speed, old, problem.friction[c])
            change = new - old
            own = block @ change
            for i in ti.static(range(3)):
                impulse[n + i] = new[i]
                residual = ti.max(residual, ti.abs(own[i]))
            add_three_multiples(velocity, change, w, n * rows, rows)
    first = 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        own, tension = w[row * rows + row], tension_before(problem.bounds, a, first, impulse)
        correction = best_impulse(problem.bounds, a, impulse[row], velocity[row], own, tension) - impulse[row]
        residual = ti.max(residual, ti.abs(own * correction))
        impulse[row] = impulse[row] + correction
        add_multiple(velocity, 0, correction, w, row * rows, rows)
    for m in range(problem.size[MOMENTS]):
        residual = ti.max(residual, sweep_moment(m, problem, iterate))
    return residual


@func
def best_moment(m: ti.i32, problem: Problem, iterate: Iterate, normal: ti.f64) -> vec3:
    """Improved impulse of moment m with all others fixed; `normal` is the normal impulse of its contact."""
    w, impulse, velocity = ti.static(problem.compliance, iterate.impulse, iterate.velocity)
    rows, n = row_count(problem), first_moment(problem) + 3 * m
    new = vec3(impulse[n], impulse[n + 1], impulse[n + 2])
    limit = problem.moment_length[m, SPINNING] * normal
    new[0] = ti.max(-limit, ti.min(new[0] - velocity[n] / w[n * (rows + 1)], limit))
    spun, largest = new[0] - impulse[n], largest_of_two(n + 1, problem)
    for i in ti.static(range(1, 3)):
        new[i] -= (velocity[n + i] + w[(n + i) * rows + n] * spun) / largest
    size, limit_of_rolling = ti.sqrt(new[1] * new[1] + new[2] * new[2]), problem.moment_length[m, ROLLING] * normal
    if size > limit_of_rolling:
        new[1] *= limit_of_rolling / size
        new[2] *= limit_of_rolling / size
    return new


@func
def sweep_moment(m: ti.i32, problem: Problem, iterate: Iterate) -> ti.f64:
    """Visit a moment; returns the largest change of the velocity of a point 1 mm from the axis [mm/s].

    The moment is always changed as a whole, because its bound has just changed.
    """
    w, impulse, velocity = ti.static(problem.compliance, iterate.impulse, iterate.velocity)
    rows, n = row_count(problem), first_moment(problem) + 3 * m
    new = best_moment(m, problem, iterate, ti.max(0.0, impulse[3 * problem.moment_contact[m]]))
    change, residual = vec3(0.0), 0.0
    for i in ti.static(range(3)):
        change[i] = new[i] - impulse[n + i]
        impulse[n + i] = new[i]
    for i in ti.static(range(3)):
        own = 0.0
        for j in ti.static(range(3)):
            own += w[(n + i) * rows + n + j] * change[j]
        residual = ti.max(residual, ti.abs(own))
    add_three_multiples(velocity, change, w, n * rows, rows)
    return residual


# Entries of the outcome of `sweep_repeatedly`: the residual, and the number of sweeps.
RESIDUAL, SWEEPS = range(2)


@kernel
def sweep_repeatedly(problem: Problem, current: Iterate, outcome: Scalars, tolerance: ti.f64, most_sweeps: ti.i32):
    """Sweep until the residual is below `tolerance`, at most `most_sweeps` times; velocities follow the impulses."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        measure_velocity(problem, current)
        outcome[RESIDUAL] = 2.0 * tolerance
        outcome[SWEEPS] = 0.0
        while outcome[RESIDUAL] >= tolerance and outcome[SWEEPS] < most_sweeps:
            outcome[RESIDUAL] = sweep(problem, current)
            outcome[SWEEPS] += 1.0
