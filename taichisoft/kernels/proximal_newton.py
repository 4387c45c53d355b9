"""The proximal point method with Newton steps, for what sweeps leave.

The matrix of closed contacts is singular where they share a load in many ways, and nearly so where light rigid bodies
are held by soft ones: a Newton step from there may lead anywhere. With a proximal term, a pull towards a center, the
impulses are nearly always found in a few steps; the center then moves there, and the pull becomes weaker (Rockafellar
1976, Monotone operators and the proximal point algorithm; for friction Acary, Bremond and Huber 2018, On solving
contact problems with Coulomb friction). Where the center no longer moves the pull is nothing: it does not change the
answer.
"""

from taichisoft.kernels.actuator_rows import best_impulse, tension_before
from taichisoft.kernels.constraint_problem import (
    Iterate,
    Problem,
    copy_iterate,
    first_moment,
    measure_velocity,
    row_count,
)
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.kernels.elimination import LinearSystem
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.newton import Pull, newton_step, pressing, pulled_velocity, weigh_rows
from taichisoft.kernels.runtime import Scalars, ti
from taichisoft.kernels.sweep import PLAIN, largest_of_two, largest_tangential, sweep

# Newton steps with one center, and how many of them let the next pull be weaker.
LONGEST = 12
QUICK = 5
WEAKER, STRONGER, WEAKEST = 0.1, 10.0, 1e-9
# Each center's problem is solved to this share of the residual there, or of the tolerance.
SHARE_OF_RESIDUAL = 0.01
SHARE_OF_TOLERANCE = 0.1
# Steps towards no impulses end where they move these by no more than this share of the largest.
STILL = 1e-9


@func
def natural_residual(problem: Problem, point: Iterate, pull: Pull) -> ti.f64:
    """Largest velocity [mm/s, of a volume mm^3/s] by which a block misses its law, each with all others fixed."""
    worst = 0.0
    rows = row_count(problem)
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        normal, own = pressing(c, problem, point, pull), problem.compliance[n * (rows + 1)]
        scale = largest_tangential(c, problem)
        worst = ti.max(worst, own * ti.abs(point.impulse[n] - ti.max(0.0, normal)))
        z = ti.Vector.zero(ti.f64, 2)
        for i in ti.static(range(2)):
            z[i] = point.impulse[n + 1 + i] - pulled_velocity(n + 1 + i, point, pull) / scale
        limit, size = problem.friction[c] * ti.max(0.0, normal), z.norm()
        if size > limit:
            z *= limit / size
        for i in ti.static(range(2)):
            worst = ti.max(worst, scale * ti.abs(point.impulse[n + 1 + i] - z[i]))
    first = 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        own, tension = problem.compliance[row * (rows + 1)], tension_before(problem.bounds, a, first, point.impulse)
        velocity = pulled_velocity(row, point, pull)
        best = best_impulse(problem.bounds, a, point.impulse[row], velocity, own, tension)
        worst = ti.max(worst, own * ti.abs(best - point.impulse[row]))
    for m in range(problem.size[MOMENTS]):
        worst = ti.max(worst, missed_by_moment(m, problem, point, pull))
    return worst


@func
def missed_by_moment(m: ti.i32, problem: Problem, point: Iterate, pull: Pull) -> ti.f64:
    """Largest velocity 1 mm from the axis [mm/s] by which a moment misses its laws."""
    rows, n = row_count(problem), first_moment(problem) + 3 * m
    normal = ti.max(0.0, pressing(problem.moment_contact[m], problem, point, pull))
    own, scale = problem.compliance[n * (rows + 1)], largest_of_two(n + 1, problem)
    limit = problem.moment_length[m, SPINNING] * normal
    spin = point.impulse[n] - pulled_velocity(n, point, pull) / own
    worst = own * ti.abs(point.impulse[n] - ti.max(-limit, ti.min(spin, limit)))
    z = ti.Vector.zero(ti.f64, 2)
    for i in ti.static(range(2)):
        z[i] = point.impulse[n + 1 + i] - pulled_velocity(n + 1 + i, point, pull) / scale
    limit, size = problem.moment_length[m, ROLLING] * normal, z.norm()
    if size > limit:
        z *= limit / size
    for i in ti.static(range(2)):
        worst = ti.max(worst, scale * ti.abs(point.impulse[n + 1 + i] - z[i]))
    return worst


@func
def aim_at_zero(problem: Problem, current: Iterate, pull: Pull, tolerance: ti.f64):
    """Pull contacts towards no impulses, all with the largest weight, so that the pull measures lengths.

    Moments are pulled with their own weights, since they may be as undetermined as what presses; actuators are not.

    Velocities below the tolerance are what the sweeps left, and what tilts a body by less than 1e-6 mm. They would
    decide more than the weak pull does, so the center makes up for them.
    """
    largest = 0.0
    for k in range(3 * problem.size[CONTACTS]):
        largest = ti.max(largest, pull.weight[k])
    measure_velocity(problem, current)
    for k in range(row_count(problem)):
        pull.center[k] = 0.0
        if k < first_moment(problem):
            pull.weight[k] = 0.0
        if k < 3 * problem.size[CONTACTS]:
            pull.weight[k] = largest
            if ti.abs(current.velocity[k]) < tolerance:
                pull.center[k] = current.velocity[k] / (pull.share[0] * largest)


@kernel
def improve(
    problem: Problem,
    current: Iterate,
    point: Iterate,
    trial: Iterate,
    system: LinearSystem,
    pull: Pull,
    figure: Scalars,
    tolerance: ti.f64,
    first_share: ti.f64,
    most_steps: ti.i32,
    to_zero: ti.i32,
    one: ti.i32,
):
    """Newton steps until a sweep from there finds less than the tolerance to change, which `figure` then has.

    `figure` begins with that of `current`. `current` ends with the best impulses and velocities that a sweep left.

    With `to_zero` there is one center, 0, and the pull stays: of many answers that chooses the one with small impulses,
    which `current` becomes if a sweep confirms it. The pull is weak and decides alone, so the steps go on until they
    move nothing.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = row_count(problem)
        weigh_rows(problem, pull)
        for k in range(rows):
            point.impulse[k] = current.impulse[k]
            pull.center[k] = current.impulse[k]
        pull.share[0] = first_share
        if to_zero != 0:
            aim_at_zero(problem, current, pull, tolerance)
        steps, residual = 0, figure[0]
        while steps < most_steps and (figure[0] >= tolerance or to_zero != 0):
            bound = ti.max(SHARE_OF_TOLERANCE * tolerance, SHARE_OF_RESIDUAL * residual)
            taken = 0
            measure_velocity(problem, point)
            miss = natural_residual(problem, point, pull)
            goes_on = miss >= bound or to_zero != 0
            while taken < LONGEST and goes_on:
                newton_step(problem, point, pull, system, trial, one)
                moved, largest = 0.0, 0.0
                for k in range(rows):
                    moved = ti.max(moved, ti.abs(trial.impulse[k] - point.impulse[k]))
                    largest = ti.max(largest, ti.abs(trial.impulse[k]))
                    point.impulse[k] = trial.impulse[k]
                measure_velocity(problem, point)
                miss = natural_residual(problem, point, pull)
                taken += 1
                goes_on = miss >= bound or (to_zero != 0 and moved > STILL * largest)
            copy_iterate(rows, point, trial)
            found = sweep(problem, trial, PLAIN)
            if miss < bound:
                residual = found
                for k in range(rows):
                    pull.center[k] = point.impulse[k]
                if taken <= QUICK:
                    pull.share[0] = ti.max(WEAKER * pull.share[0], WEAKEST)
            else:
                if found < residual:
                    residual = found
                    for k in range(rows):
                        pull.center[k] = trial.impulse[k]
                pull.share[0] = STRONGER * pull.share[0]
            better = found < figure[0]
            if to_zero != 0:
                better = miss < bound and found < tolerance
                steps = most_steps
            if better:
                figure[0] = found
                copy_iterate(rows, trial, current)
            steps += ti.max(taken, 1)
            for k in range(rows):
                point.impulse[k] = pull.center[k]
