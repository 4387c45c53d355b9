"""Projected Gauss-Seidel on contact impulses and cavity multipliers, accelerated by nonlinear conjugate gradients.

The blocks: a contact has three rows, one normal with lambda_n >= 0 and two tangential with |lambda_t| <= mu lambda_n
(Coulomb's cone, exactly); a cavity of imposed volume has one row, its pressure, without a bound.
Acceleration: Silcowitz, Niebe, Erleben 2010, A nonsmooth nonlinear conjugate gradient method for interactive contact
force problems; the step of one sweep plays the gradient.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Scalars, ScalarTable, mat3, ti, vec3

PATIENCE = 600  # sweeps; less would switch it off in a grasp, where it does help


@ti.func
def row_velocity(row: ti.i32, w: ScalarTable, free: Scalars, impulse: Scalars) -> ti.f64:
    total = free[row]
    for k in range(w.shape[1]):
        total += w[row, k] * impulse[k]
    return total


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
def sweep(w: ScalarTable, free: Scalars, friction: Scalars, impulse: Scalars) -> ti.f64:
    """Visit every block once; returns the largest change of a block's own velocity [mm/s, of a cavity mm^3/s]."""
    residual = 0.0
    for c in range(friction.shape[0]):
        n = 3 * c
        old = vec3(impulse[n], impulse[n + 1], impulse[n + 2])
        velocity = vec3(0.0)
        block = ti.Matrix.zero(ti.f64, 3, 3)
        for i in ti.static(range(3)):
            velocity[i] = row_velocity(n + i, w, free, impulse)
            for j in ti.static(range(3)):
                block[i, j] = w[n + i, n + j]
        new = solve_contact(block, velocity, old, friction[c])
        for i in ti.static(range(3)):
            impulse[n + i] = new[i]
            residual = ti.max(residual, ti.abs((block @ (new - old))[i]))
    for row in range(3 * friction.shape[0], impulse.shape[0]):
        velocity = row_velocity(row, w, free, impulse)
        impulse[row] -= velocity / w[row, row]
        residual = ti.max(residual, ti.abs(velocity))
    return residual


@kernel
def solve(
    w: ScalarTable,
    free: Scalars,
    friction: Scalars,
    tolerance: ti.f64,
    max_iterations: ti.i32,
    impulse: Scalars,
    last: Scalars,
    direction: Scalars,
    outcome: Scalars,
):
    """Sweep until the residual is below the tolerance; `outcome` gets the number of sweeps and the residual.

    The result is always that of a sweep, so that it satisfies every inequality exactly. On some problems (a cylinder
    on a plane, whose many contacts share its weight in many ways) the acceleration restarts for ever where plain
    sweeps converge: whenever the residual has not halved in PATIENCE sweeps, it is switched off, or on again.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = impulse.shape[0]
        residual = 2.0 * tolerance
        last_norm = 0.0
        best = 1e300
        since_best = 0
        accelerate = 1
        iterations = 0
        for k in range(rows):
            direction[k] = 0.0
        while iterations < max_iterations and residual >= tolerance:
            for k in range(rows):
                last[k] = impulse[k]
            residual = sweep(w, free, friction, impulse)
            iterations += 1
            since_best += 1
            if residual < 0.5 * best:
                best = residual
                since_best = 0
            if since_best > PATIENCE:
                accelerate = 1 - accelerate
                best = residual
                since_best = 0
                last_norm = 0.0
                for k in range(rows):
                    direction[k] = 0.0
            if accelerate != 0 and residual >= tolerance and iterations < max_iterations:
                # Step of the sweep, measured in energy: impulses of different bodies are not alike.
                norm = 0.0
                for k in range(rows):
                    norm += w[k, k] * (impulse[k] - last[k]) ** 2
                beta = 0.0
                if last_norm > 0.0:
                    beta = norm / last_norm
                last_norm = norm
                if beta > 1.0:
                    for k in range(rows):
                        direction[k] = 0.0
                else:
                    for k in range(rows):
                        step = impulse[k] - last[k]
                        impulse[k] += beta * direction[k]
                        direction[k] = beta * direction[k] + step
        outcome[0] = iterations
        outcome[1] = residual
