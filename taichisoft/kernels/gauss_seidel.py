"""Projected Gauss-Seidel on contact impulses and cavity multipliers, accelerated in two ways.

The blocks: a contact has three rows, one normal with lambda_n >= 0 and two tangential with |lambda_t| <= mu lambda_n
(Coulomb's cone, exactly); a cavity of imposed volume has one row, its pressure, without a bound.

The sweeps find out which contacts are open, stick or slip; while they do, nonlinear conjugate gradients speed them up
(Silcowitz, Niebe, Erleben 2010, A nonsmooth nonlinear conjugate gradient method for interactive contact force
problems; the step of one sweep plays the gradient). Now and then a few Newton steps on the closed contacts (newton.py)
are tried, and taken where a sweep from there finds less than half as much to change. So the answer is always that of a
sweep, and satisfies every inequality exactly.
"""

from taichisoft.kernels.axpy import add_multiple, add_three_multiples
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.newton import choose_rows, newton_step
from taichisoft.kernels.runtime import Integers, Scalars, ScalarTable, mat3, ti, vec3

PATIENCE = 600  # sweeps; less would switch the conjugate gradients off in a grasp, where they do help
# Sweeps before the first Newton steps, and how many more to wait after each time that they failed.
FIRST_NEWTON = 4
LONGEST_WAIT = 32
# One after the other before the sweeps go on: those from a wrong guess of which contacts are closed mend the guess.
NEWTON_STEPS = 2

# Rows of the work space.
LAST, LAST_VELOCITY, DIRECTION, DIRECTION_VELOCITY, WORK_ROWS = range(5)


@ti.func
def measure(w: Scalars, free: Scalars, impulse: Scalars, velocity: Scalars):
    """velocity = free + W impulse."""
    count = free.shape[0]
    for k in range(count):
        velocity[k] = free[k]
    for row in range(count):
        if impulse[row] != 0.0:
            add_multiple(velocity, 0, impulse[row], w, row * count, count)


@ti.func
def solve_contact(block: mat3, velocity: vec3, old: vec3, friction: ti.f64) -> vec3:
    """Better impulse of one contact with all others fixed: `velocity` belongs to the impulse `old`.

    The normal part, then the tangential one with the larger eigenvalue of its block as scale: the mean of the two
    (as in SOFA) may overshoot for ever in a direction of little mobility. More turns per visit do not pay: in a
    grasp the sweeps hardly became fewer.
    """
    mean = 0.5 * (block[1, 1] + block[2, 2])
    largest = mean + ti.sqrt((0.5 * (block[1, 1] - block[2, 2])) ** 2 + block[1, 2] ** 2)
    impulse = old
    impulse[0] = ti.max(0.0, old[0] - velocity[0] / block[0, 0])
    change = impulse[0] - old[0]
    impulse[1] -= (velocity[1] + block[1, 0] * change) / largest
    impulse[2] -= (velocity[2] + block[2, 0] * change) / largest
    size = ti.sqrt(impulse[1] * impulse[1] + impulse[2] * impulse[2])
    limit = friction * impulse[0]
    if size > limit:
        impulse[1] *= limit / size
        impulse[2] *= limit / size
    return impulse


@ti.func
def sweep(w: Scalars, friction: Scalars, impulse: Scalars, velocity: Scalars) -> ti.f64:
    """Visit every block once; returns the largest change of a block's own velocity [mm/s, of a cavity mm^3/s].

    `velocity` follows every change of an impulse (W is symmetric: a row is a column), so that an open contact that
    stays open costs nothing.
    """
    residual = 0.0
    row_count = impulse.shape[0]
    for c in range(friction.shape[0]):
        n = 3 * c
        # The conjugate gradients may have moved the impulse of an open contact to anywhere.
        acts = impulse[n] != 0.0 or impulse[n + 1] != 0.0 or impulse[n + 2] != 0.0
        if acts or velocity[n] < 0.0:
            old, speed = vec3(0.0), vec3(0.0)
            block = ti.Matrix.zero(ti.f64, 3, 3)
            for i in ti.static(range(3)):
                old[i] = impulse[n + i]
                speed[i] = velocity[n + i]
                for j in ti.static(range(3)):
                    block[i, j] = w[(n + i) * row_count + n + j]
            new = solve_contact(block, speed, old, friction[c])
            change = new - old
            own = block @ change
            for i in ti.static(range(3)):
                impulse[n + i] = new[i]
                residual = ti.max(residual, ti.abs(own[i]))
            add_three_multiples(velocity, change, w, n * row_count, row_count)
    for row in range(3 * friction.shape[0], row_count):
        correction = -velocity[row] / w[row * row_count + row]
        residual = ti.max(residual, ti.abs(velocity[row]))
        impulse[row] = impulse[row] + correction
        add_multiple(velocity, 0, correction, w, row * row_count, row_count)
    return residual


@ti.func
def newton_cost(closed: ti.i32, rows: ti.i32) -> ti.i32:
    """Sweeps that take about as long as the Newton steps, which need 2 m^3 / 3 operations on m rows, a sweep 2 m n."""
    return NEWTON_STEPS * closed * closed // (3 * rows)


@kernel
def solve(
    w: Scalars,
    free: Scalars,
    friction: Scalars,
    tolerance: ti.f64,
    max_iterations: ti.i32,
    impulse: Scalars,
    velocity: Scalars,
    work: ScalarTable,
    point: Scalars,
    point_velocity: Scalars,
    trial: Scalars,
    trial_velocity: Scalars,
    step: Scalars,
    matrix: Scalars,
    row_of: Integers,
    outcome: Scalars,
):
    """Sweep until the residual is below the tolerance; `outcome` gets the number of sweeps and the residual.

    On some problems (a cylinder on a plane, whose many contacts share its weight in many ways) the conjugate gradients
    restart for ever where plain sweeps converge: whenever the residual has not halved in PATIENCE sweeps, they are
    switched off, or on again.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = impulse.shape[0]
        residual = 2.0 * tolerance
        last_norm = 0.0
        best = 1e300
        since_best = 0
        accelerate = 1
        since_newton = 0
        wait = FIRST_NEWTON
        iterations = 0
        measure(w, free, impulse, velocity)
        for k in range(rows):
            work[DIRECTION, k] = 0.0
            work[DIRECTION_VELOCITY, k] = 0.0
        while iterations < max_iterations and residual >= tolerance:
            for k in range(rows):
                work[LAST, k] = impulse[k]
                work[LAST_VELOCITY, k] = velocity[k]
            residual = sweep(w, friction, impulse, velocity)
            iterations += 1
            since_best += 1
            since_newton += 1
            jumped = 0
            if (
                residual >= tolerance
                and iterations < max_iterations
                and since_newton >= wait
                and since_newton >= newton_cost(choose_rows(w, velocity, friction, impulse, row_of), rows)
            ):
                since_newton = 0
                wait = ti.max(FIRST_NEWTON, ti.min(wait + FIRST_NEWTON, LONGEST_WAIT))
                for k in range(rows):
                    point[k] = impulse[k]
                    point_velocity[k] = velocity[k]
                steps = 0
                while jumped == 0 and steps < NEWTON_STEPS and iterations < max_iterations:
                    newton_step(w, point_velocity, friction, point, matrix, step, row_of, trial)
                    measure(w, free, trial, trial_velocity)
                    for k in range(rows):
                        point[k] = trial[k]
                        point_velocity[k] = trial_velocity[k]
                    trial_residual = sweep(w, friction, trial, trial_velocity)
                    steps += 1
                    iterations += 1
                    if trial_residual < 0.5 * residual:
                        jumped = 1
                        wait = 1
                        residual = trial_residual
                        for k in range(rows):
                            impulse[k] = trial[k]
                            velocity[k] = trial_velocity[k]
            if residual < 0.5 * best:
                best = residual
                since_best = 0
            if since_best > PATIENCE:
                accelerate = 1 - accelerate
                best = residual
                since_best = 0
                jumped = 1
            if jumped != 0:
                last_norm = 0.0
                for k in range(rows):
                    work[DIRECTION, k] = 0.0
                    work[DIRECTION_VELOCITY, k] = 0.0
            elif accelerate != 0 and residual >= tolerance and iterations < max_iterations:
                # Step of the sweep, measured in energy: impulses of different bodies are not alike.
                norm = 0.0
                for k in range(rows):
                    norm += w[k * rows + k] * (impulse[k] - work[LAST, k]) ** 2
                beta = 0.0
                if last_norm > 0.0:
                    beta = norm / last_norm
                last_norm = norm
                if beta > 1.0:
                    for k in range(rows):
                        work[DIRECTION, k] = 0.0
                        work[DIRECTION_VELOCITY, k] = 0.0
                else:
                    for k in range(rows):
                        moved = impulse[k] - work[LAST, k]
                        impulse[k] = impulse[k] + beta * work[DIRECTION, k]
                        work[DIRECTION, k] = beta * work[DIRECTION, k] + moved
                    for k in range(rows):
                        gained = velocity[k] - work[LAST_VELOCITY, k]
                        velocity[k] = velocity[k] + beta * work[DIRECTION_VELOCITY, k]
                        work[DIRECTION_VELOCITY, k] = beta * work[DIRECTION_VELOCITY, k] + gained
        outcome[0] = iterations
        outcome[1] = residual
