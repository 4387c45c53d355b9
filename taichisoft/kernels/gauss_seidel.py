"""Projected Gauss-Seidel on contact impulses and cavity multipliers, accelerated by nonlinear conjugate gradients.

The blocks: a contact has three rows, one normal with lambda_n >= 0 and two tangential with |lambda_t| <= mu lambda_n
(Coulomb's cone, exactly); a cavity has one row, free (its volume is imposed) or fixed (its pressure is).
Acceleration: Silcowitz, Niebe, Erleben 2010, A nonsmooth nonlinear conjugate gradient method for interactive contact
force problems; the step of one sweep plays the gradient.
"""

from taichisoft.kernels.runtime import Integers, Scalars, ScalarTable, ti


@ti.func
def row_velocity(row: ti.i32, w: ScalarTable, free: Scalars, impulse: Scalars) -> ti.f64:
    total = free[row]
    for k in range(w.shape[1]):
        total += w[row, k] * impulse[k]
    return total


@ti.func
def sweep(w: ScalarTable, free: Scalars, friction: Scalars, cavity_is_free: Integers, impulse: Scalars) -> ti.f64:
    """Visit every block once; returns the largest change of a block's own velocity [mm/s, of a cavity mm^3/s]."""
    residual = 0.0
    for c in range(friction.shape[0]):
        n = 3 * c
        old_n, old_t, old_s = impulse[n], impulse[n + 1], impulse[n + 2]
        v_n = row_velocity(n, w, free, impulse)
        v_t = row_velocity(n + 1, w, free, impulse)
        v_s = row_velocity(n + 2, w, free, impulse)
        new_n = ti.max(0.0, old_n - v_n / w[n, n])
        d_n = new_n - old_n
        mobility = 0.5 * (w[n + 1, n + 1] + w[n + 2, n + 2])
        new_t = old_t - (v_t + w[n + 1, n] * d_n) / mobility
        new_s = old_s - (v_s + w[n + 2, n] * d_n) / mobility
        size = ti.sqrt(new_t * new_t + new_s * new_s)
        limit = friction[c] * new_n
        if size > limit:
            new_t *= limit / size
            new_s *= limit / size
        d_t, d_s = new_t - old_t, new_s - old_s
        impulse[n], impulse[n + 1], impulse[n + 2] = new_n, new_t, new_s
        for i in ti.static(range(3)):
            change = w[n + i, n] * d_n + w[n + i, n + 1] * d_t + w[n + i, n + 2] * d_s
            residual = ti.max(residual, ti.abs(change))
    for k in range(cavity_is_free.shape[0]):
        if cavity_is_free[k] != 0:
            row = 3 * friction.shape[0] + k
            velocity = row_velocity(row, w, free, impulse)
            impulse[row] -= velocity / w[row, row]
            residual = ti.max(residual, ti.abs(velocity))
    return residual


@ti.kernel
def solve(
    w: ScalarTable,
    free: Scalars,
    friction: Scalars,
    cavity_is_free: Integers,
    tolerance: ti.f64,
    max_iterations: ti.i32,
    impulse: Scalars,
    last: Scalars,
    direction: Scalars,
    outcome: Scalars,
):
    """Sweep until the residual is below the tolerance; `outcome` gets the number of sweeps and the residual.

    The result is always that of a sweep, so that it satisfies every inequality exactly.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        rows = impulse.shape[0]
        residual = 2.0 * tolerance
        last_norm = 0.0
        iterations = 0
        for k in range(rows):
            direction[k] = 0.0
        while iterations < max_iterations and residual >= tolerance:
            for k in range(rows):
                last[k] = impulse[k]
            residual = sweep(w, free, friction, cavity_is_free, impulse)
            iterations += 1
            if residual >= tolerance and iterations < max_iterations:
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
