"""Projected Gauss-Seidel on the impulses of contacts and actuators, accelerated in two ways.

The blocks: a contact has three rows, one normal with lambda_n >= 0 and two tangential with |lambda_t| <= mu lambda_n
(Coulomb's cone, exactly); an actuator's coordinate has one row (actuator_rows.py).

The sweeps find out which contacts are open, stick or slip; while they do, nonlinear conjugate gradients speed them up
(Silcowitz, Niebe, Erleben 2010, A nonsmooth nonlinear conjugate gradient method for interactive contact force
problems; the step of one sweep plays the gradient). Now and then it stops for the caller to try a few Newton steps on
the closed contacts (step/gauss_seidel.py), which are taken where a sweep from there finds less than half as much to
change. So the answer is always that of a sweep, and satisfies every inequality exactly.

On some problems (a cylinder on a plane, whose many contacts share its weight in many ways) the conjugate gradients
restart for ever where plain sweeps converge. On a few others sweeps go to and fro for ever: where the normal direction
of a contact is much softer than the tangential ones and coupled with them, friction lifts what the normal impulse
pressed; half the change at each visit then converges. So whenever the residual has not halved in PATIENCE sweeps, the
next of the three ways is taken.
"""

from typing import NamedTuple

from taichisoft.kernels.constraint_problem import Iterate, Problem, measure_velocity, row_count
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS, MOMENTS
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.runtime import Integers, Scalars, ti
from taichisoft.kernels.sweep import ACCELERATED, sweep

PATIENCE = 600  # sweeps; less would switch the conjugate gradients off in a grasp, where they do help
# Sweeps before the first Newton steps.
FIRST_NEWTON = 4
# One after the other before the sweeps go on: those from a wrong guess of which contacts are closed mend the guess.
NEWTON_STEPS = 2

# Entries of `Progress.count`: sweeps in all, since the residual last halved, and since the last Newton steps; how many
# to wait for the next ones; which of the ways below the sweeps take; what is with Newton steps.
SWEEPS, SINCE_BEST, SINCE_NEWTON, WAIT, WAY, NEWTON = range(6)
# Whether they are not due, should be tried now, or have been taken.
NOT_DUE, DUE, TAKEN = range(3)
# Entries of `Progress.figure`: the residual; when it last halved; squared length of the last sweep's step.
RESIDUAL, BEST, LAST_NORM = range(3)


class Search(NamedTuple):
    """Work space of the conjugate gradients, each of shape (row_capacity,).

    Attributes:
        last_impulse, last_velocity: before the sweep.
        direction, direction_velocity: where the last step went.
    """

    last_impulse: Scalars
    last_velocity: Scalars
    direction: Scalars
    direction_velocity: Scalars


class Progress(NamedTuple):
    """How far the solution has come.

    Attributes:
        count: numbers of sweeps and the like, shape (6,); its entries stand above.
        figure: residual and the like, shape (3,); its entries stand above.
    """

    count: Integers
    figure: Scalars


@func
def restart_search(rows: ti.i32, search: Search, progress: Progress):
    """Forget where the last steps went."""
    progress.figure[LAST_NORM] = 0.0
    for k in range(rows):
        search.direction[k] = 0.0
        search.direction_velocity[k] = 0.0


@func
def newton_pays(problem: Problem, current: Iterate, progress: Progress) -> ti.i32:
    """Whether Newton steps are due: after so many sweeps as take about as long.

    They need 2 m^3 / 3 operations on the m rows of closed contacts and of actuators that act, a sweep 2 m n on all n.
    """
    pays = 0
    if progress.count[SINCE_NEWTON] >= progress.count[WAIT]:
        m = 0
        for c in range(problem.size[CONTACTS]):
            if current.impulse[3 * c] > 0.0:
                m += 3
        for a in range(problem.size[ACTUATORS]):
            if current.impulse[3 * problem.size[CONTACTS] + a] != 0.0:
                m += 1
        for moment in range(problem.size[MOMENTS]):
            if current.impulse[3 * problem.moment_contact[moment]] > 0.0:
                m += 3
        if progress.count[SINCE_NEWTON] >= NEWTON_STEPS * m * m // (3 * row_count(problem)):
            pays = 1
    return pays


@func
def change_way(progress: Progress) -> ti.i32:
    """Take the next way when the residual has not halved for long; returns whether."""
    switched = 0
    if progress.figure[RESIDUAL] < 0.5 * progress.figure[BEST]:
        progress.figure[BEST] = progress.figure[RESIDUAL]
        progress.count[SINCE_BEST] = 0
    if progress.count[SINCE_BEST] > PATIENCE:
        progress.count[WAY] = (progress.count[WAY] + 1) % 3
        progress.figure[BEST] = progress.figure[RESIDUAL]
        progress.count[SINCE_BEST] = 0
        switched = 1
    return switched


@func
def accelerate(problem: Problem, current: Iterate, search: Search, progress: Progress):
    """Go on in the direction of the last steps, as far as the conjugate gradients say."""
    rows = row_count(problem)
    # Step of the sweep, measured in energy: impulses of different bodies are not alike.
    norm = 0.0
    for k in range(rows):
        norm += problem.compliance[k * rows + k] * (current.impulse[k] - search.last_impulse[k]) ** 2
    beta = 0.0
    if progress.figure[LAST_NORM] > 0.0:
        beta = norm / progress.figure[LAST_NORM]
    progress.figure[LAST_NORM] = norm
    if beta > 1.0:
        for k in range(rows):
            search.direction[k] = 0.0
            search.direction_velocity[k] = 0.0
    else:
        for k in range(rows):
            moved = current.impulse[k] - search.last_impulse[k]
            current.impulse[k] = current.impulse[k] + beta * search.direction[k]
            search.direction[k] = beta * search.direction[k] + moved
        for k in range(rows):
            gained = current.velocity[k] - search.last_velocity[k]
            current.velocity[k] = current.velocity[k] + beta * search.direction_velocity[k]
            search.direction_velocity[k] = beta * search.direction_velocity[k] + gained


@func
def begin(problem: Problem, current: Iterate, search: Search, progress: Progress, tolerance: ti.f64):
    """Velocities of the first impulses; counters at their start."""
    measure_velocity(problem, current)
    restart_search(row_count(problem), search, progress)
    progress.figure[RESIDUAL] = 2.0 * tolerance
    progress.figure[BEST] = 1e300
    for k in ti.static(range(6)):
        progress.count[k] = 0
    progress.count[WAIT] = FIRST_NEWTON
    progress.count[WAY] = ACCELERATED


@func
def go_on(problem: Problem, current: Iterate, search: Search, progress: Progress):
    """From the end of a sweep, or of Newton steps, to where the next sweep begins."""
    restarts = change_way(progress)
    if progress.count[NEWTON] == TAKEN:
        restarts = 1
    progress.count[NEWTON] = NOT_DUE
    if restarts != 0:
        restart_search(row_count(problem), search, progress)
    elif progress.count[WAY] == ACCELERATED:
        accelerate(problem, current, search, progress)


@kernel
def solve(
    problem: Problem,
    current: Iterate,
    search: Search,
    progress: Progress,
    tolerance: ti.f64,
    max_iterations: ti.i32,
    pause: ti.i32,
):
    """Improve the impulses of `current` until the residual is below the tolerance; its velocities follow.

    It pauses after that many sweeps in all, and where Newton steps are due; launched again with a later pause it goes
    on as if it had not paused. The first launch is that with no sweep counted.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        if progress.count[SWEEPS] == 0:
            begin(problem, current, search, progress, tolerance)
        goes_on = progress.figure[RESIDUAL] >= tolerance and progress.count[SWEEPS] < max_iterations
        while goes_on and progress.count[SWEEPS] < pause:
            if progress.count[SWEEPS] > 0:
                go_on(problem, current, search, progress)
            for k in range(row_count(problem)):
                search.last_impulse[k] = current.impulse[k]
                search.last_velocity[k] = current.velocity[k]
            progress.figure[RESIDUAL] = sweep(problem, current, progress.count[WAY])
            progress.count[SWEEPS] += 1
            progress.count[SINCE_BEST] += 1
            progress.count[SINCE_NEWTON] += 1
            goes_on = progress.figure[RESIDUAL] >= tolerance and progress.count[SWEEPS] < max_iterations
            if goes_on and newton_pays(problem, current, progress) != 0:
                progress.count[NEWTON] = DUE
                goes_on = False
