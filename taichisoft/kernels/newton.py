"""A Newton step on the conditions of contact and friction, on the contacts that are closed.

The conditions are one equation, l = projection(l - r v), which is smooth but for where contacts open, stick and slip:
Alart and Curnier 1991, A mixed formulation for frictional contact problems prone to Newton like solution methods.
From where a Gauss-Seidel has found out which contacts do what, one step gives the answer to many digits. From elsewhere
it may lead astray: whoever takes the step must check it.
"""

from typing import NamedTuple

from taichisoft.kernels.constraint_rows import CAVITIES, CONTACTS
from taichisoft.kernels.elimination import solve_linear
from taichisoft.kernels.launch import func
from taichisoft.kernels.runtime import Integers, Scalars, ti

# The matrix of closed contacts is singular where they share a load in many ways (a table has four legs). This share of
# the diagonal, added to it, chooses among them what is nearest to the present impulses; it does not change the answer,
# at which the step is zero.
PROXIMAL_SHARE = 1e-9


class Problem(NamedTuple):
    """The constraint problem: v = free + W l, with the conditions of contact and friction. Contacts' rows come first.

    Attributes:
        size: number of contacts and of cavities, shape (2,).
        compliance: W by rows [mm/s per mN s, and the like for volumes], shape (row_capacity^2,).
        free: velocities without impulses [mm/s, of a cavity mm^3/s], shape (row_capacity,).
        friction: coefficient of each contact, shape (contact_capacity,).
    """

    size: Integers
    compliance: Scalars
    free: Scalars
    friction: Scalars


class Iterate(NamedTuple):
    """Impulses [mN s, of a cavity kPa s] and the velocities that belong to them, each of shape (row_capacity,)."""

    impulse: Scalars
    velocity: Scalars


class NewtonSystem(NamedTuple):
    """Linear system on the closed contacts.

    Attributes:
        row_of: rows of the problem that take part, shape (row_capacity,).
        matrix: by rows, shape (row_capacity^2,).
        step: right-hand side, then the solution, shape (row_capacity,).
    """

    row_of: Integers
    matrix: Scalars
    step: Scalars


@func
def row_count(problem: Problem) -> ti.i32:
    """Three rows for a contact, one for a cavity."""
    return 3 * problem.size[CONTACTS] + problem.size[CAVITIES]


@func
def newton_step(problem: Problem, point: Iterate, newton: NewtonSystem, trial: Iterate):
    """Fill `trial` with better impulses than those of `point`, or the same if the linear system cannot be solved."""
    w, impulse, matrix, step, row_of = ti.static(
        problem.compliance, point.impulse, newton.matrix, newton.step, newton.row_of
    )
    count = choose_rows(problem, point, newton)
    rows = row_count(problem)
    for k in range(rows):
        trial.impulse[k] = 0.0
    for a in range(count):
        trial.impulse[row_of[a]] = impulse[row_of[a]]
        step[a] = -point.velocity[row_of[a]]
    for k in range(rows):
        released = impulse[k] - trial.impulse[k]
        if released != 0.0:
            for a in range(count):
                step[a] = step[a] + w[k * rows + row_of[a]] * released
    for a in range(count):
        row = row_of[a] * rows
        for b in range(count):
            matrix[a * count + b] = w[row + row_of[b]]
        matrix[a * count + a] = (1.0 + PROXIMAL_SHARE) * w[row + row_of[a]]
    for k in range(count // 3):
        if row_of[3 * k] < 3 * problem.size[CONTACTS]:
            let_slip(3 * k, count, row_of[3 * k] // 3, problem, trial.impulse, newton)
    if solve_linear(count, matrix, step):
        for a in range(count):
            trial.impulse[row_of[a]] = trial.impulse[row_of[a]] + step[a]
        project(problem, trial.impulse)
    else:
        for k in range(rows):
            trial.impulse[k] = impulse[k]


@func
def choose_rows(problem: Problem, point: Iterate, newton: NewtonSystem) -> ti.i32:
    """List the rows of contacts that are closed, or close, and of cavities; returns their number."""
    rows = row_count(problem)
    count = 0
    for c in range(problem.size[CONTACTS]):
        n = 3 * c
        if point.impulse[n] - point.velocity[n] / problem.compliance[n * rows + n] > 0.0:
            for i in ti.static(range(3)):
                newton.row_of[count + i] = n + i
            count += 3
    for row in range(3 * problem.size[CONTACTS], rows):
        newton.row_of[count] = row
        count += 1
    return count


@func
def let_slip(a: ti.i32, count: ti.i32, c: ti.i32, problem: Problem, impulse: Scalars, newton: NewtonSystem):
    """Where contact c (row a) slips, its tangential rows say l_t = mu l_n z / |z| with z = l_t - r v_t, linearised."""
    w, matrix, step = ti.static(problem.compliance, newton.matrix, newton.step)
    n, rows = 3 * c, row_count(problem)
    scale = 2.0 / (w[(n + 1) * rows + n + 1] + w[(n + 2) * rows + n + 2])
    z = ti.Vector([impulse[n + 1] + scale * step[a + 1], impulse[n + 2] + scale * step[a + 2]])
    normal = impulse[n]
    if normal <= 0.0:
        normal = step[a] / w[n * rows + n]
    limit = problem.friction[c] * normal
    size = z.norm()
    if size > limit:
        d = z / size
        turn = limit / size * (ti.Matrix.identity(ti.f64, 2) - d.outer_product(d))
        for b in range(count):
            first, second = matrix[(a + 1) * count + b], matrix[(a + 2) * count + b]
            matrix[(a + 1) * count + b] = scale * (turn[0, 0] * first + turn[0, 1] * second)
            matrix[(a + 2) * count + b] = scale * (turn[1, 0] * first + turn[1, 1] * second)
        for i in ti.static(range(2)):
            place = (a + 1 + i) * count + a
            matrix[place] = matrix[place] - problem.friction[c] * d[i]
            matrix[place + 1 + i] = matrix[place + 1 + i] + 1.0
            for j in ti.static(range(2)):
                matrix[place + 1 + j] = matrix[place + 1 + j] - turn[i, j]
            step[a + 1 + i] = limit * d[i] - impulse[n + 1 + i]


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
