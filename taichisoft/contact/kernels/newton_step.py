"""A Newton step on the conditions of contact and friction of the closed contacts.

The conditions are one equation, l = projection(l - r v), smooth except between opening, sticking and slipping: Alart
and Curnier 1991, A mixed formulation for frictional contact problems prone to Newton like solution methods. Once a
Gauss-Seidel has found the state of each contact, one step gives the solution to many digits. Otherwise the step may
diverge, and the caller must check it.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels.constraint_problem import (
    AT_UPPER_END,
    GRIP,
    LOWER_END,
    NOT_HELD,
    UPPER_END,
    Iterate,
    Problem,
    best_impulse,
    copy_iterate,
    first_moment,
    held_end,
    measure_velocity,
    row_count,
    sliding_share,
    tension_before,
)
from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, ROLLING, SPINNING
from taichisoft.contact.kernels.sweep import largest_of_two, largest_tangential, sweep
from taichisoft.runtime.arithmetic import TILE, Columns, advance, opaque, tiles_in
from taichisoft.runtime.language import Integers, Scalars, func, ti
from taichisoft.runtime.launch import kernel

# Gaussian elimination with partial pivoting, in panels of eight columns and blocks of 32.
#
# Golub and Van Loan 2013, section 3.4. Nearly all of the work is in `subtract_block`, whose tiles of 8 x 8 stay in
# registers while it reads the eliminated block; see `arithmetic.py`, also for `one`.

BLOCK = 32


class LinearSystem(NamedTuple):
    """Linear equations for some rows of a larger problem; the factors overwrite the matrix.

    Attributes:
        row_of: row of the problem for each equation, shape (row_capacity,).
        matrix: by rows, each padded to whole tiles, `row_length` numbers long, shape (row_capacity row_length,).
        tiles: the same memory by eights, shape (row_capacity row_length / 8, 8).
        order: row exchanged with the row of each pivot, shape (row_capacity,).
        step: right-hand side, then the solution, shape (row_capacity,).
    """

    row_of: Integers
    matrix: Scalars
    tiles: Columns
    order: Integers
    step: Scalars


@func
def row_length(count: ti.i32) -> ti.i32:
    """Distance between rows of the matrix in memory, in numbers."""
    return TILE * tiles_in(count)


@func
def factorise(count: ti.i32, system: LinearSystem, one: ti.i32) -> ti.i32:
    """Factorise P A = L U in place; returns 0 if a pivot is zero."""
    solvable = 1
    for block in range((count + BLOCK - 1) // BLOCK):
        start = BLOCK * block
        end = ti.min(start + BLOCK, count)
        for panel in range(tiles_in(end - start)):
            first = start + TILE * panel
            last = ti.min(first + TILE, end)
            if solvable != 0:
                solvable = eliminate_panel(first, last, count, system, one)
            if solvable != 0 and last < end:
                solve_upper(first, last, tiles_in(last), tiles_in(end), count, system, one)
                for i in range(last, count):
                    subtract_panel(i, first, tiles_in(end), count, system)
        if solvable != 0 and end < count:
            solve_upper(start, end, tiles_in(end), tiles_in(count), count, system, one)
            subtract_block(start, end, count, system, one)
    return solvable


@func
def solve_upper(
    first: ti.i32, last: ti.i32, tile: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32
):
    """Compute rows first..last of U in the columns of tiles tile..end."""
    row = tiles_in(count)
    for k in range(first + 1, last):
        for e in range(first, k):
            factor = system.matrix[k * TILE * row + e]
            t = tile
            while t < end:
                system.tiles[k * row + t] = system.tiles[k * row + t] - factor * system.tiles[e * row + t]
                t = advance(t, 1, one)


@func
def substitute(count: ti.i32, system: LinearSystem):
    """Solve A x = b in place with the factors."""
    matrix, order, x = ti.static(system.matrix, system.order, system.step)
    row = row_length(count)
    for k in range(count):
        other = x[k]
        x[k] = x[order[k]]
        x[order[k]] = other
    for k in range(count):
        total = x[k]
        for j in range(k):
            total -= matrix[k * row + j] * x[j]
        x[k] = total
    for k_ in range(count):
        k = count - 1 - k_
        total = x[k]
        for j in range(k + 1, count):
            total -= matrix[k * row + j] * x[j]
        x[k] = total / matrix[k * row + k]


@func
def eliminate_panel(first: ti.i32, last: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32) -> ti.i32:
    """Choose pivots and eliminate within columns first..last; the factors stay below the diagonal."""
    matrix, tiles = ti.static(system.matrix, system.tiles)
    row = row_length(count)
    solvable = 1
    for k in range(first, last):
        pivot = k
        for i in range(k + 1, count):
            if ti.abs(matrix[i * row + k]) > ti.abs(matrix[pivot * row + k]):
                pivot = i
        system.order[k] = pivot
        if matrix[pivot * row + k] == 0.0:
            solvable = 0
        if solvable != 0:
            if pivot != k:
                t = 0
                while t < tiles_in(count):
                    swapped = tiles[k * tiles_in(count) + t]
                    tiles[k * tiles_in(count) + t] = tiles[pivot * tiles_in(count) + t]
                    tiles[pivot * tiles_in(count) + t] = swapped
                    t = advance(t, 1, one)
            inverse = 1.0 / matrix[k * row + k]
            for i in range(k + 1, count):
                factor = matrix[i * row + k] * inverse
                matrix[i * row + k] = factor
                if factor != 0.0:
                    for left in range(last - 1 - k & TILE - 1):  # fewer than eight, as LLVM can see
                        j = last - 1 - left
                        matrix[i * row + j] = matrix[i * row + j] - factor * matrix[k * row + j]
    return solvable


@func
def subtract_panel(i: ti.i32, first: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem):
    """Subtract the eight rows from `first` on, times their factors in row i, from row i up to tile `end`."""
    row = tiles_in(count)
    place = i * TILE * row + first
    for t in range(first // TILE + 1, end):
        total = system.tiles[i * row + t]
        for e in ti.static(range(TILE)):
            total -= system.matrix[place + e] * system.tiles[(first + e) * row + t]
        system.tiles[i * row + t] = total


@func
def subtract_block(start: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32):
    """Subtract the product of the block's factors and its rows of U from the rows and columns after `end`."""
    matrix, tiles = ti.static(system.matrix, system.tiles)
    row = tiles_in(count)
    strips = (count - end) // TILE
    for strip in range(strips):
        for t in range(end // TILE, row):
            target = opaque((end + TILE * strip) * row, one)
            total = [tiles[target + r * row + t] for r in range(TILE)]
            e = start
            while e < end:
                above = tiles[e * row + t]
                for r in ti.static(range(TILE)):
                    total[r] -= matrix[TILE * (target + r * row) + e] * above
                e = advance(e, 1, one)
            for r in ti.static(range(TILE)):
                tiles[target + r * row + t] = total[r]
    for i in range(end + TILE * strips, count):
        for t in range(end // TILE, row):
            rest = tiles[i * row + t]
            for e in range(start, end):
                rest -= matrix[i * TILE * row + e] * tiles[e * row + t]
            tiles[i * row + t] = rest


def make_linear_system(capacity: int) -> LinearSystem:
    """Allocate a system of up to `capacity` rows; the padding of the matrix is 0."""
    tiles = np.zeros((capacity * -(-capacity // TILE), TILE))
    rows, order = np.empty(capacity, dtype=np.int32), np.empty(capacity, dtype=np.int32)
    return LinearSystem(rows, tiles.reshape(-1), tiles, order, np.empty(capacity))


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


# Newton steps with a proximal term, their residual, and a sweep from their end.
#
# `contact/contact_solver.py` moves the center of the pull. All steps with one center are one launch, which takes as
# long as a step of a few contacts; steps and check are one kernel, because the Newton step is among the slowest to
# compile.

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
