"""The smallest of all impulses with the same velocities.

If rigid bodies touch each other in many points, W is singular and the impulses of these contacts are not unique: a cube
on a floor could rest on two corners as well as on four, and press them against each other. The sweeps end at any of
these solutions. The solutions with the same velocities form a convex set: W l is given, l_n >= 0 and |l_t| <= mu l_n,
and sliding contacts have l_t = mu l_n d. The element of least norm is unique, so that mirrored scenes get mirrored
impulses, and a body at rest shows no friction.

The element is the limit of Tikhonov's iteration from 0 (Engl, Hanke and Neubauer 1996, Regularization of inverse
problems, section 6.1). If the iteration leaves the set, the impulses go to the boundary and continue along it.
"""

from typing import NamedTuple

from taichisoft.contact.kernels.constraint_problem import (
    Iterate,
    Problem,
    copy_iterate,
    entries,
    measure_velocity,
    row_count,
    way_to_boundary,
)
from taichisoft.contact.kernels.newton_step import LinearSystem, factorise, row_length, substitute
from taichisoft.contact.kernels.sweep import sweep
from taichisoft.runtime.language import Integers, Scalars, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

# Tikhonov's parameter over the largest diagonal entry, and number of iterations: the determined part has then
# converged, since its part of W is far above the parameter, and round-off in the undetermined part stays below 1e-16
# over the parameter.
SHARE = 1e-8
ITERATIONS = 4
# Largest number of times that the impulses reach the boundary.
PASSES = 8
# Sweeps that may confirm them: those of a sum of many small impulses may miss the tolerance by round-off and the ridge,
# and each sweep moves them by no more than what is missed.
CONFIRMING_SWEEPS = 4
# A contact that slides or opens at up to this multiple of the tolerance of velocities counts as sticking.
MARGIN = 10.0
# States of a contact: without impulse, with any impulse, or with an impulse along its present direction.
LEFT_OUT, STICKS, SLIDES = range(3)


class Shares(NamedTuple):
    """The contacts whose impulses may be undetermined, and their unknowns.

    Attributes:
        contact: indices of the contacts, shape (capacity,).
        state: LEFT_OUT, STICKS or SLIDES, shape (capacity,).
        unknown: the contact of each unknown, shape (3 capacity,).
        direction: impulse per unit of each unknown, in the contact's basis, shape (3 capacity, 3).
        aim: unknowns of the impulses of least norm, shape (3 capacity,).
    """

    contact: Integers
    state: Integers
    unknown: Integers
    direction: Vectors
    aim: Scalars


@func
def choose_states(problem: Problem, current: Iterate, shares: Shares, tolerance: ti.f64):
    """Set the states: open contacts are left out, contacts with tangential velocity slide, others stick."""
    for i in range(shares.contact.shape[0]):
        c = shares.contact[i]
        v = entries(current.velocity, c)
        shares.state[i] = STICKS
        if v[0] > MARGIN * tolerance and current.impulse[3 * c] == 0.0:
            shares.state[i] = LEFT_OUT
        elif problem.friction[c] == 0.0 or v[1] * v[1] + v[2] * v[2] > (MARGIN * tolerance) ** 2:
            shares.state[i] = SLIDES
            if current.impulse[3 * c] <= 0.0:
                shares.state[i] = LEFT_OUT


@func
def list_unknowns(current: Iterate, shares: Shares) -> ti.i32:
    """Fill in the unknowns; returns their number."""
    count = 0
    for i in range(shares.contact.shape[0]):
        c = shares.contact[i]
        if shares.state[i] == STICKS:
            for d in ti.static(range(3)):
                unit = vec3(0.0)
                unit[d] = 1.0
                shares.unknown[count + d] = c
                shares.direction[count + d] = unit
            count += 3
        elif shares.state[i] == SLIDES:
            shares.unknown[count] = c
            shares.direction[count] = entries(current.impulse, c).normalized()
            count += 1
    return count


@func
def find_smallest(count: ti.i32, problem: Problem, current: Iterate, system: LinearSystem, shares: Shares, one: ti.i32):
    """Fill in the unknowns of least norm with the present velocities; returns 0 if that fails."""
    w, matrix, x = ti.static(problem.compliance, system.matrix, system.step)
    rows, length = row_count(problem), row_length(count)
    largest = 0.0
    for a in range(count):
        for b in range(count):
            entry = 0.0
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    place = (3 * shares.unknown[a] + i) * rows + 3 * shares.unknown[b] + j
                    entry += shares.direction[a][i] * w[place] * shares.direction[b][j]
            matrix[a * length + b] = entry
        largest = ti.max(largest, matrix[a * length + a])
    # Right-hand side: the matrix times the present unknowns, stored in `aim` until the solution overwrites it.
    for a in range(count):
        total = 0.0
        for b in range(count):
            present = shares.direction[b].dot(entries(current.impulse, shares.unknown[b]))
            total += matrix[a * length + b] * present
        shares.aim[a] = total
        x[a] = 0.0
    ridge = SHARE * largest
    for a in range(count):
        matrix[a * length + a] = matrix[a * length + a] + ridge
    solvable = factorise(count, system, one)
    if solvable != 0:
        for _ in range(ITERATIONS):
            for a in range(count):
                x[a] = shares.aim[a] + ridge * x[a]
            substitute(count, system)
        for a in range(count):
            shares.aim[a] = x[a]
    return solvable


@func
def approach(count: ti.i32, problem: Problem, current: Iterate, trial: Iterate, shares: Shares) -> ti.f64:
    """Move towards the aim as far as the cones allow; returns the fraction. The limiting contact changes its state."""
    for k in range(row_count(problem)):
        trial.impulse[k] = 0.0
    for a in range(count):
        for d in ti.static(range(3)):
            row = 3 * shares.unknown[a] + d
            trial.impulse[row] = trial.impulse[row] + shares.aim[a] * shares.direction[a][d]
    far, stops = 1.0, -1
    for i in range(shares.contact.shape[0]):
        if shares.state[i] != LEFT_OUT:
            c = shares.contact[i]
            now = entries(current.impulse, c)
            step = entries(trial.impulse, c) - now
            limit = 1e30
            if shares.state[i] == SLIDES:
                if step[0] < 0.0:
                    limit = -now[0] / step[0]
            else:
                mu = problem.friction[c]
                limit = way_to_boundary(vec3(mu * now[0], now[1], now[2]), vec3(mu * step[0], step[1], step[2]))
            if limit < far:
                far = limit
                stops = i
    for i in range(shares.contact.shape[0]):
        if shares.state[i] != LEFT_OUT:
            for d in ti.static(range(3)):
                k = 3 * shares.contact[i] + d
                current.impulse[k] = current.impulse[k] + far * (trial.impulse[k] - current.impulse[k])
    if stops >= 0:
        c = shares.contact[stops]
        if shares.state[stops] == STICKS and entries(current.impulse, c).norm() > 1e-12:
            shares.state[stops] = SLIDES
        else:
            shares.state[stops] = LEFT_OUT
            for d in ti.static(range(3)):
                current.impulse[3 * c + d] = 0.0
    return far


@kernel
def choose_smallest(
    problem: Problem,
    current: Iterate,
    point: Iterate,
    trial: Iterate,
    system: LinearSystem,
    shares: Shares,
    figure: Scalars,
    tolerance: ti.f64,
    one: ti.i32,
):
    """Replace the impulses of these contacts by the smallest with the same velocities, if sweeps confirm them.

    `figure` holds the residual of `current`, before and after the call.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = row_count(problem)
        copy_iterate(rows, current, point)
        choose_states(problem, current, shares, tolerance)
        passes = 0
        while passes < PASSES:
            passes += 1
            count = list_unknowns(point, shares)
            goes_on = count > 0
            if goes_on:
                goes_on = find_smallest(count, problem, point, system, shares, one) != 0
            if goes_on:
                goes_on = approach(count, problem, point, trial, shares) < 1.0
            if not goes_on:
                passes = PASSES
        measure_velocity(problem, point)
        residual, sweeps = tolerance, 0
        while residual >= tolerance and sweeps < CONFIRMING_SWEEPS:
            residual = sweep(problem, point)
            sweeps += 1
        if residual < tolerance:
            figure[0] = residual
            copy_iterate(rows, point, current)
