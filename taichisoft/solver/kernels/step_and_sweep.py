"""Newton steps with a proximal term, their residual, and a sweep from their end.

`solver/proximal_newton.py` moves the center of the pull. All steps with one center are one launch, which takes as long
as a step of a few contacts; steps and check are one kernel, because the Newton step is among the slowest to compile.
"""

from taichisoft.runtime.language import Scalars, func, ti
from taichisoft.runtime.launch import kernel
from taichisoft.solver.kernels.actuator_bounds import best_impulse, tension_before
from taichisoft.solver.kernels.constraint_problem import (
    Iterate,
    Problem,
    copy_iterate,
    first_moment,
    measure_velocity,
    row_count,
)
from taichisoft.solver.kernels.elimination import LinearSystem
from taichisoft.solver.kernels.newton_step import ProximalTerm, newton_step, pressing, pulled_velocity
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.solver.kernels.sweep import largest_of_two, largest_tangential, sweep

# Entries of `outcome`: natural residual at the end of the last step, pull included; residual of a sweep from there; and
# number of steps.
MISS, FOUND, TAKEN = range(3)


@func
def natural_residual(problem: Problem, point: Iterate, proximal: ProximalTerm) -> ti.f64:
    """Largest violation of a block's law with all others fixed, as a velocity [mm/s, of a volume mm^3/s]."""
    worst = 0.0
    rows = row_count(problem)
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        normal, own = pressing(c, problem, point, proximal), problem.compliance[n * (rows + 1)]
        scale = largest_tangential(c, problem)
        worst = ti.max(worst, own * ti.abs(point.impulse[n] - ti.max(0.0, normal)))
        z = ti.Vector.zero(ti.f64, 2)
        for i in ti.static(range(2)):
            z[i] = point.impulse[n + 1 + i] - pulled_velocity(n + 1 + i, point, proximal) / scale
        limit, size = problem.friction[c] * ti.max(0.0, normal), z.norm()
        if size > limit:
            z *= limit / size
        for i in ti.static(range(2)):
            worst = ti.max(worst, scale * ti.abs(point.impulse[n + 1 + i] - z[i]))
    first = 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        own, tension = problem.compliance[row * (rows + 1)], tension_before(problem.bounds, a, first, point.impulse)
        velocity = pulled_velocity(row, point, proximal)
        best = best_impulse(problem.bounds, a, point.impulse[row], velocity, own, tension)
        worst = ti.max(worst, own * ti.abs(best - point.impulse[row]))
    for m in range(problem.size[MOMENTS]):
        worst = ti.max(worst, missed_by_moment(m, problem, point, proximal))
    return worst


@func
def missed_by_moment(m: ti.i32, problem: Problem, point: Iterate, proximal: ProximalTerm) -> ti.f64:
    """Largest violation of a moment's laws, as a velocity 1 mm from the axis [mm/s]."""
    rows, n = row_count(problem), first_moment(problem) + 3 * m
    normal = ti.max(0.0, pressing(problem.moment_contact[m], problem, point, proximal))
    own, scale = problem.compliance[n * (rows + 1)], largest_of_two(n + 1, problem)
    limit = problem.moment_length[m, SPINNING] * normal
    spin = point.impulse[n] - pulled_velocity(n, point, proximal) / own
    worst = own * ti.abs(point.impulse[n] - ti.max(-limit, ti.min(spin, limit)))
    z = ti.Vector.zero(ti.f64, 2)
    for i in ti.static(range(2)):
        z[i] = point.impulse[n + 1 + i] - pulled_velocity(n + 1 + i, point, proximal) / scale
    limit, size = problem.moment_length[m, ROLLING] * normal, z.norm()
    if size > limit:
        z *= limit / size
    for i in ti.static(range(2)):
        worst = ti.max(worst, scale * ti.abs(point.impulse[n + 1 + i] - z[i]))
    return worst


@kernel
def step_and_sweep(
    problem: Problem,
    point: Iterate,
    swept: Iterate,
    proximal: ProximalTerm,
    system: LinearSystem,
    outcome: Scalars,
    bound: ti.f64,
    still: ti.f64,
    least: ti.i32,
    most: ti.i32,
    one: ti.i32,
):
    """Move `point` by Newton steps, then sweep once from there to `swept`.

    `least` to `most` steps are taken, until the natural residual is below `bound` [mm/s] and, where `still` is not 0,
    the last step changed no impulse by more than `still` times the largest one.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows, taken, goes_on = row_count(problem), -1, 1
        while goes_on == 1:
            taken += 1
            moved, largest = 0.0, 0.0
            if taken > 0:
                newton_step(problem, point, proximal, system, swept, one)
                for k in range(rows):
                    moved = ti.max(moved, ti.abs(swept.impulse[k] - point.impulse[k]))
                    largest = ti.max(largest, ti.abs(swept.impulse[k]))
                    point.impulse[k] = swept.impulse[k]
            measure_velocity(problem, point)
            outcome[MISS] = natural_residual(problem, point, proximal)
            moves = outcome[MISS] >= bound or (still > 0.0 and moved > still * largest)
            goes_on = ti.cast(taken < least or (taken < most and moves), ti.i32)
        copy_iterate(rows, point, swept)
        outcome[FOUND] = sweep(problem, swept)
        outcome[TAKEN] = taken
