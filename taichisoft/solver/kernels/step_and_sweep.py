"""A Newton step with a proximal term, how far from the answer it leads, and a sweep from its end.

`solver/proximal_newton.py` takes the steps and moves the center of the pull. What each step and each check needs is one
kernel, since Newton's is among the longest to compile.
"""

from taichisoft.runtime.launch import func, kernel
from taichisoft.runtime.taichi_start import Scalars, ti
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
from taichisoft.solver.kernels.newton_step import Pull, newton_step, pressing, pulled_velocity
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.solver.kernels.sweep import largest_of_two, largest_tangential, sweep

# Entries of `outcome`: by what velocity a block misses its law at the end of the step, pull included; what a sweep from
# there finds to change; the largest change of an impulse by the step, and the largest impulse.
MISS, FOUND, MOVED, LARGEST = range(4)


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


@kernel
def step_and_sweep(
    problem: Problem,
    point: Iterate,
    swept: Iterate,
    pull: Pull,
    system: LinearSystem,
    outcome: Scalars,
    moves: ti.i32,
    one: ti.i32,
):
    """Take a Newton step from `point`, where it then ends, if `moves` is not 0; `swept` is a sweep further.

    The velocities of `point` must be those of its impulses if it moves; they are measured anew at the end.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = row_count(problem)
        moved, largest = 0.0, 0.0
        if moves != 0:
            newton_step(problem, point, pull, system, swept, one)
            for k in range(rows):
                moved = ti.max(moved, ti.abs(swept.impulse[k] - point.impulse[k]))
                largest = ti.max(largest, ti.abs(swept.impulse[k]))
                point.impulse[k] = swept.impulse[k]
        measure_velocity(problem, point)
        outcome[MISS] = natural_residual(problem, point, pull)
        copy_iterate(rows, point, swept)
        outcome[FOUND] = sweep(problem, swept)
        outcome[MOVED] = moved
        outcome[LARGEST] = largest
