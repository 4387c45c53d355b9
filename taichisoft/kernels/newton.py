"""A Newton step on the conditions of contact and friction, on the contacts that are closed.

The conditions are one equation, l = projection(l - r v), which is smooth but for where contacts open, stick and slip:
Alart and Curnier 1991, A mixed formulation for frictional contact problems prone to Newton like solution methods.
From where a Gauss-Seidel has found out which contacts do what, one step gives the answer to many digits. From elsewhere
it may lead astray: whoever takes the step must check it.
"""

from taichisoft.kernels.elimination import solve_linear
from taichisoft.kernels.runtime import Integers, Scalars, ti

# The matrix of closed contacts is singular where they share a load in many ways (a table has four legs). This share of
# the diagonal, added to it, chooses among them what is nearest to the present impulses; it does not change the answer,
# at which the step is zero.
PROXIMAL_SHARE = 1e-9


@ti.func
def newton_step(
    w: Scalars,
    velocity: Scalars,
    friction: Scalars,
    impulse: Scalars,
    matrix: Scalars,
    step: Scalars,
    row_of: Integers,
    trial: Scalars,
):
    """Fill `trial` with better impulses, or with the present ones if the linear system cannot be solved."""
    count = choose_rows(w, velocity, friction, impulse, row_of)
    rows = impulse.shape[0]
    for k in range(rows):
        trial[k] = 0.0
    for a in range(count):
        trial[row_of[a]] = impulse[row_of[a]]
        step[a] = -velocity[row_of[a]]
    for k in range(rows):
        released = impulse[k] - trial[k]
        if released != 0.0:
            for a in range(count):
                step[a] = step[a] + w[k * rows + row_of[a]] * released
    for a in range(count):
        row = row_of[a] * rows
        for b in range(count):
            matrix[a * count + b] = w[row + row_of[b]]
        matrix[a * count + a] = (1.0 + PROXIMAL_SHARE) * w[row + row_of[a]]
    for k in range(count // 3):
        if row_of[3 * k] < 3 * friction.shape[0]:
            let_slip(3 * k, count, row_of[3 * k] // 3, w, friction, trial, matrix, step)
    if solve_linear(count, matrix, step):
        for a in range(count):
            trial[row_of[a]] = trial[row_of[a]] + step[a]
        project(friction, trial)
    else:
        for k in range(rows):
            trial[k] = impulse[k]


@ti.func
def choose_rows(w: Scalars, velocity: Scalars, friction: Scalars, impulse: Scalars, row_of: Integers) -> ti.i32:
    """List the rows of contacts that are closed, or close, and of cavities; returns their number."""
    count = 0
    for c in range(friction.shape[0]):
        n = 3 * c
        if impulse[n] - velocity[n] / w[n * impulse.shape[0] + n] > 0.0:
            for i in ti.static(range(3)):
                row_of[count + i] = n + i
            count += 3
    for row in range(3 * friction.shape[0], impulse.shape[0]):
        row_of[count] = row
        count += 1
    return count


@ti.func
def let_slip(
    a: ti.i32,
    count: ti.i32,
    c: ti.i32,
    w: Scalars,
    friction: Scalars,
    impulse: Scalars,
    matrix: Scalars,
    step: Scalars,
):
    """Where contact c (row a) slips, its tangential rows say l_t = mu l_n z / |z| with z = l_t - r v_t, linearised."""
    n, rows = 3 * c, impulse.shape[0]
    scale = 2.0 / (w[(n + 1) * rows + n + 1] + w[(n + 2) * rows + n + 2])
    z = ti.Vector([impulse[n + 1] + scale * step[a + 1], impulse[n + 2] + scale * step[a + 2]])
    normal = impulse[n]
    if normal <= 0.0:
        normal = step[a] / w[n * rows + n]
    limit = friction[c] * normal
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
            matrix[place] = matrix[place] - friction[c] * d[i]
            matrix[place + 1 + i] = matrix[place + 1 + i] + 1.0
            for j in ti.static(range(2)):
                matrix[place + 1 + j] = matrix[place + 1 + j] - turn[i, j]
            step[a + 1 + i] = limit * d[i] - impulse[n + 1 + i]


@ti.func
def project(friction: Scalars, impulse: Scalars):
    """Move every contact's impulse to its friction cone: no pull, and |l_t| <= mu l_n."""
    for c in range(friction.shape[0]):
        n = 3 * c
        impulse[n] = ti.max(0.0, impulse[n])
        size = ti.sqrt(impulse[n + 1] * impulse[n + 1] + impulse[n + 2] * impulse[n + 2])
        limit = friction[c] * impulse[n]
        if size > limit:
            impulse[n + 1] = impulse[n + 1] * (limit / size)
            impulse[n + 2] = impulse[n + 2] * (limit / size)
