"""A Newton step on the conditions of contact and friction, on the contacts that are closed.

The conditions are one equation, l = projection(l - r v), which is smooth but for where contacts open, stick and slip:
Alart and Curnier 1991, A mixed formulation for frictional contact problems prone to Newton like solution methods.
From where a Gauss-Seidel has found out which contacts do what, one step gives the answer to many digits. From elsewhere
it may lead astray: whoever takes the step must check it.
"""

from typing import NamedTuple

from taichisoft.kernels.actuator_rows import (
    AT_UPPER_END,
    GRIP,
    LOWER_END,
    NOT_HELD,
    UPPER_END,
    best_impulse,
    held_end,
    sliding_share,
    tension_before,
)
from taichisoft.kernels.constraint_problem import Iterate, Problem, row_count
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS
from taichisoft.kernels.elimination import LinearSystem, factorise, row_length, substitute
from taichisoft.kernels.launch import func
from taichisoft.kernels.runtime import Scalars, ti
from taichisoft.kernels.sweep import largest_tangential


class Pull(NamedTuple):
    """What a proximal term adds to the velocities: share weight (l - center).

    Attributes:
        center: impulses, shape (row_capacity,).
        weight: a compliance, usually that of each row itself, shape (row_capacity,).
        share: shape (1,).
    """

    center: Scalars
    weight: Scalars
    share: Scalars


@func
def newton_step(problem: Problem, point: Iterate, pull: Pull, newton: LinearSystem, trial: Iterate, one: ti.i32):
    """Fill `trial` with better impulses than those of `point`, or the same if the linear system cannot be solved.

    They may leave the friction cones: a sweep brings them back, but further Newton steps must start from what is here.
    """
    w, impulse, matrix, step, row_of = ti.static(
        problem.compliance, point.impulse, newton.matrix, newton.step, newton.row_of
    )
    count = choose_rows(problem, point, pull, newton)
    rows = row_count(problem)
    for k in range(rows):
        trial.impulse[k] = 0.0
    let_actuators_give_way(problem, point, trial)
    for a in range(count):
        trial.impulse[row_of[a]] = impulse[row_of[a]]
        step[a] = -pulled_velocity(row_of[a], point, pull)
    for k in range(rows):
        released = impulse[k] - trial.impulse[k]
        if released != 0.0:
            for a in range(count):
                step[a] = step[a] + w[k * rows + row_of[a]] * released
    length = row_length(count)
    for a in range(count):
        row = row_of[a] * rows
        for b in range(count):
            matrix[a * length + b] = w[row + row_of[b]]
        matrix[a * length + a] = w[row + row_of[a]] + pull.share[0] * pull.weight[row_of[a]]
    hold_actuators(count, problem, point, trial.impulse, newton)
    for k in range(count // 3):
        if row_of[3 * k] < 3 * problem.size[CONTACTS]:
            let_slip(3 * k, count, row_of[3 * k] // 3, problem, point, pull, newton)
    if factorise(count, newton, one):
        substitute(count, newton)
        for a in range(count):
            trial.impulse[row_of[a]] = trial.impulse[row_of[a]] + step[a]
    else:
        for k in range(rows):
            trial.impulse[k] = impulse[k]


@func
def pulled_velocity(row: ti.i32, point: Iterate, pull: Pull) -> ti.f64:
    """Velocity of a row with the proximal term."""
    return point.velocity[row] + pull.share[0] * pull.weight[row] * (point.impulse[row] - pull.center[row])


@func
def weigh_rows(problem: Problem, pull: Pull):
    """Each row's weight is its own compliance."""
    rows = row_count(problem)
    for k in range(rows):
        pull.weight[k] = problem.compliance[k * (rows + 1)]


@func
def pressing(c: ti.i32, problem: Problem, point: Iterate, pull: Pull) -> ti.f64:
    """Normal impulse that contact c would have with all others fixed; not positive if it opens."""
    own = problem.compliance[3 * c * (row_count(problem) + 1)]
    return point.impulse[3 * c] - pulled_velocity(3 * c, point, pull) / own


@func
def choose_rows(problem: Problem, point: Iterate, pull: Pull, newton: LinearSystem) -> ti.i32:
    """List the rows of contacts that are closed, or close, and of actuators that are held; returns their number."""
    rows = row_count(problem)
    count = 0
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        if pressing(c, problem, point, pull) > 0.0:
            for i in ti.static(range(3)):
                newton.row_of[count + i] = n + i
            count += 3
    first = 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        w = problem.compliance[row * rows + row]
        takes_part = problem.bounds[a, GRIP] >= 0.0
        if not takes_part:
            takes_part = held_end(problem.bounds, a, point.impulse[row], point.velocity[row], w) != NOT_HELD
        if takes_part:
            newton.row_of[count] = row
            count += 1
    return count


@func
def let_actuators_give_way(problem: Problem, point: Iterate, trial: Iterate):
    """Fill in the impulses of all actuators as they are best with the others fixed; held ones are solved for later."""
    rows, first = row_count(problem), 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        w = problem.compliance[row * rows + row]
        trial.impulse[row] = best_impulse(problem.bounds, a, point.impulse[row], point.velocity[row], w, 0.0)


@func
def hold_actuators(count: ti.i32, problem: Problem, point: Iterate, impulse: Scalars, newton: LinearSystem):
    """Rows of actuators say that the coordinate is at its end, or that the tension lost at a point is that of sliding.

    `impulse` are those that the step is added to.
    """
    rows, first = row_count(problem), 3 * problem.size[CONTACTS]
    for k in range(count):
        row = newton.row_of[k]
        a = row - first
        if a >= 0:
            w = problem.compliance[row * rows + row]
            if problem.bounds[a, GRIP] >= 0.0:
                tension = tension_before(problem.bounds, a, first, impulse)
                share = sliding_share(problem.bounds, a, impulse[row], point.velocity[row], w, tension)
                if share != 0.0:
                    let_rub(k, count, a, share, tension, problem, impulse, newton)
            elif held_end(problem.bounds, a, point.impulse[row], point.velocity[row], w) == AT_UPPER_END:
                newton.step[k] = newton.step[k] + problem.bounds[a, UPPER_END]
            else:
                newton.step[k] = newton.step[k] + problem.bounds[a, LOWER_END]


@func
def let_rub(
    k: ti.i32,
    count: ti.i32,
    a: ti.i32,
    share: ti.f64,
    tension: ti.f64,
    problem: Problem,
    impulse: Scalars,
    newton: LinearSystem,
):
    """Row k, friction of actuator row a, says l = share T, with T the cable's l less those of the points before."""
    first, length = 3 * problem.size[CONTACTS], row_length(count)
    for b in range(count):
        newton.matrix[k * length + b] = 0.0
    newton.matrix[k * length + k] = 1.0
    newton.step[k] = share * tension - impulse[first + a]
    b = k - 1
    above = a - 1
    while above >= 0:
        takes_part = b >= 0
        if takes_part:
            takes_part = newton.row_of[b] == first + above
        if takes_part:
            newton.matrix[k * length + b] = share
            if problem.bounds[above, GRIP] < 0.0:
                newton.matrix[k * length + b] = -share
            b -= 1
        if problem.bounds[above, GRIP] < 0.0:
            above = -1
        above -= 1


@func
def let_slip(a: ti.i32, count: ti.i32, c: ti.i32, problem: Problem, point: Iterate, pull: Pull, newton: LinearSystem):
    """Where contact c (row a) slips, its tangential rows say l_t = mu l_n z / |z| with z = l_t - r v_t, linearised."""
    impulse, matrix, step = ti.static(point.impulse, newton.matrix, newton.step)
    n, mu, length = 3 * c, problem.friction[c], row_length(count)
    scale = 1.0 / largest_tangential(c, problem)
    z = ti.Vector.zero(ti.f64, 2)
    for i in ti.static(range(2)):
        z[i] = impulse[n + 1 + i] - scale * pulled_velocity(n + 1 + i, point, pull)
    limit = mu * pressing(c, problem, point, pull)
    size = z.norm()
    if size > limit:
        d = z / size
        turn = limit / size * (ti.Matrix.identity(ti.f64, 2) - d.outer_product(d))
        # The rows' right-hand sides have what contacts that open, and actuators that give way, do to the velocities.
        change = ti.Vector([step[a + 1], step[a + 2]])
        for i in ti.static(range(2)):
            change[i] += pulled_velocity(n + 1 + i, point, pull)
        for b in range(count):
            first, second = matrix[(a + 1) * length + b], matrix[(a + 2) * length + b]
            matrix[(a + 1) * length + b] = scale * (turn[0, 0] * first + turn[0, 1] * second)
            matrix[(a + 2) * length + b] = scale * (turn[1, 0] * first + turn[1, 1] * second)
        for i in ti.static(range(2)):
            place = (a + 1 + i) * length + a
            matrix[place] = matrix[place] - mu * d[i]
            matrix[place + 1 + i] = matrix[place + 1 + i] + 1.0
            for j in ti.static(range(2)):
                matrix[place + 1 + j] = matrix[place + 1 + j] - turn[i, j]
            step[a + 1 + i] = mu * impulse[n] * d[i] - impulse[n + 1 + i]
            for j in ti.static(range(2)):
                step[a + 1 + i] = step[a + 1 + i] + scale * turn[i, j] * change[j]
