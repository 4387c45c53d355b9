"""A Newton step on the conditions of contact and friction of the closed contacts.

The conditions are one equation, l = projection(l - r v), smooth except between opening, sticking and slipping: Alart
and Curnier 1991, A mixed formulation for frictional contact problems prone to Newton like solution methods. Once a
Gauss-Seidel has found the state of each contact, one step gives the solution to many digits. Otherwise the step may
diverge, and the caller must check it.
"""

from typing import NamedTuple

from taichisoft.runtime.language import Scalars, func, ti
from taichisoft.solver.kernels.actuator_bounds import (
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
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem, first_moment, row_count
from taichisoft.solver.kernels.elimination import LinearSystem, factorise, row_length, substitute
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.solver.kernels.sweep import largest_of_two


class ProximalTerm(NamedTuple):
    """A proximal term, which adds share weight (l - center) to the velocities.

    Attributes:
        center: impulses [mN s, of a volume kPa s], shape (row_capacity,).
        weight: compliances, usually the diagonal of W, shape (row_capacity,).
        share: factor of the weights [-], shape (1,).
    """

    center: Scalars
    weight: Scalars
    share: Scalars


@func
def newton_step(
    problem: Problem, point: Iterate, proximal: ProximalTerm, newton: LinearSystem, trial: Iterate, one: ti.i32
):
    """Fill `trial` with better impulses than `point`, or the same if the linear system cannot be solved.

    The impulses may leave the friction cones: a sweep brings them back, but further Newton steps must start from
    `trial`.
    """
    w, impulse, matrix, step, row_of = ti.static(
        problem.compliance, point.impulse, newton.matrix, newton.step, newton.row_of
    )
    count = choose_rows(problem, point, proximal, newton)
    rows = row_count(problem)
    for k in range(rows):
        trial.impulse[k] = 0.0
    let_actuators_give_way(problem, point, trial)
    for a in range(count):
        trial.impulse[row_of[a]] = impulse[row_of[a]]
        step[a] = -pulled_velocity(row_of[a], point, proximal)
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
        matrix[a * length + a] = w[row + row_of[a]] + proximal.share[0] * proximal.weight[row_of[a]]
    hold_actuators(count, problem, point, trial.impulse, newton)
    for k in range(count // 3):
        if row_of[3 * k] < 3 * problem.size[CONTACTS]:
            c = row_of[3 * k] // 3
            let_slip(3 * k + 1, 3 * k, count, c, problem.friction[c], problem, point, proximal, newton)
    let_turn(count, problem, point, proximal, newton)
    if factorise(count, newton, one):
        substitute(count, newton)
        for a in range(count):
            trial.impulse[row_of[a]] = trial.impulse[row_of[a]] + step[a]
    else:
        for k in range(rows):
            trial.impulse[k] = impulse[k]


@func
def pulled_velocity(row: ti.i32, point: Iterate, proximal: ProximalTerm) -> ti.f64:
    """Velocity of a row including the proximal term."""
    return point.velocity[row] + proximal.share[0] * proximal.weight[row] * (point.impulse[row] - proximal.center[row])


@func
def pressing(c: ti.i32, problem: Problem, point: Iterate, proximal: ProximalTerm) -> ti.f64:
    """Normal impulse of contact c with all others fixed; not positive if the contact opens."""
    own = problem.compliance[3 * c * (row_count(problem) + 1)]
    return point.impulse[3 * c] - pulled_velocity(3 * c, point, proximal) / own


@func
def choose_rows(problem: Problem, point: Iterate, proximal: ProximalTerm, newton: LinearSystem) -> ti.i32:
    """List the rows of contacts that are closed or will close, of held actuators, and of these contacts' moments.

    Returns their number.
    """
    rows = row_count(problem)
    count = 0
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        if pressing(c, problem, point, proximal) > 0.0:
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
    for m in range(problem.size[MOMENTS]):
        if pressing(problem.moment_contact[m], problem, point, proximal) > 0.0:
            for i in ti.static(range(3)):
                newton.row_of[count + i] = first_moment(problem) + 3 * m + i
            count += 3
    return count


@func
def let_actuators_give_way(problem: Problem, point: Iterate, trial: Iterate):
    """Fill in each actuator's best impulse with all others fixed; held actuators are solved for later."""
    rows, first = row_count(problem), 3 * problem.size[CONTACTS]
    for a in range(problem.size[ACTUATORS]):
        row = first + a
        w = problem.compliance[row * rows + row]
        trial.impulse[row] = best_impulse(problem.bounds, a, point.impulse[row], point.velocity[row], w, 0.0)


@func
def hold_actuators(count: ti.i32, problem: Problem, point: Iterate, impulse: Scalars, newton: LinearSystem):
    """Set the equations of actuators: the coordinate is at its end, or a point loses the tension of sliding.

    `impulse` are the impulses to which the step is added.
    """
    rows, first = row_count(problem), 3 * problem.size[CONTACTS]
    for k in range(count):
        row = newton.row_of[k]
        a = row - first
        if a >= 0 and a < problem.size[ACTUATORS]:
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
    """Set equation k, friction of actuator row a: l = share T, with T the cable's l less l of the points before."""
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
def let_slip(
    b: ti.i32,
    normal: ti.i32,
    count: ti.i32,
    c: ti.i32,
    share: ti.f64,
    problem: Problem,
    point: Iterate,
    proximal: ProximalTerm,
    newton: LinearSystem,
):
    """Set the equations of two slipping rows: l = share l_n z / |z| with z = l - r v, linearised.

    They are equations b and b + 1 of the system: the tangents of contact c, or of its moment. Equation `normal` is the
    contact's normal row.
    """
    impulse, matrix, step = ti.static(point.impulse, newton.matrix, newton.step)
    n, length = newton.row_of[b], row_length(count)
    scale = 1.0 / largest_of_two(n, problem)
    z = ti.Vector.zero(ti.f64, 2)
    for i in ti.static(range(2)):
        z[i] = impulse[n + i] - scale * pulled_velocity(n + i, point, proximal)
    limit = share * pressing(c, problem, point, proximal)
    size = z.norm()
    if size > limit:
        d = z / size
        turn = limit / size * (ti.Matrix.identity(ti.f64, 2) - d.outer_product(d))
        # The right-hand sides include the changes of velocity by contacts that open and actuators that give way.
        change = ti.Vector([step[b], step[b + 1]])
        for i in ti.static(range(2)):
            change[i] += pulled_velocity(n + i, point, proximal)
        for k in range(count):
            first, second = matrix[b * length + k], matrix[(b + 1) * length + k]
            matrix[b * length + k] = scale * (turn[0, 0] * first + turn[0, 1] * second)
            matrix[(b + 1) * length + k] = scale * (turn[1, 0] * first + turn[1, 1] * second)
        for i in ti.static(range(2)):
            line = (b + i) * length
            matrix[line + normal] = matrix[line + normal] - share * d[i]
            matrix[line + b + i] = matrix[line + b + i] + 1.0
            for j in ti.static(range(2)):
                matrix[line + b + j] = matrix[line + b + j] - turn[i, j]
            step[b + i] = share * impulse[3 * c] * d[i] - impulse[n + i]
            for j in ti.static(range(2)):
                step[b + i] = step[b + i] + scale * turn[i, j] * change[j]


@func
def let_turn(count: ti.i32, problem: Problem, point: Iterate, proximal: ProximalTerm, newton: LinearSystem):
    """Set the equations of moments of bodies that spin or roll: l_n = -+ b_s p and l_t = b_r p z / |z|."""
    row_of = ti.static(newton.row_of)
    rows, length, normal = row_count(problem), row_length(count), 0
    for k in range(count):
        m = row_of[k] - first_moment(problem)
        if m >= 0 and m % 3 == 0:
            c = problem.moment_contact[m // 3]
            while row_of[normal] != 3 * c:  # contacts are in the same order
                normal += 3
            n, share = row_of[k], problem.moment_length[m // 3, SPINNING]
            z = point.impulse[n] - pulled_velocity(n, point, proximal) / problem.compliance[n * (rows + 1)]
            if ti.abs(z) > share * pressing(c, problem, point, proximal):
                if z < 0.0:
                    share = -share
                for b in range(count):
                    newton.matrix[k * length + b] = 0.0
                newton.matrix[k * length + k] = 1.0
                newton.matrix[k * length + normal] = -share
                newton.step[k] = share * point.impulse[3 * c] - point.impulse[n]
            rolling = problem.moment_length[m // 3, ROLLING]
            let_slip(k + 1, normal, count, c, rolling, problem, point, proximal, newton)
