"""Interior-point method for contact and friction, for problems on which sweeps and Newton steps fail.

With De Saxce's change of variables (De Saxce and Feng 1998, The bipotential method), x = (mu l_n, l_t) and
y = (v_n / mu + |v_t|, v_t) of each contact lie in the cone x_0 >= |x_t| and are orthogonal: Signorini's and Coulomb's
laws in one. The method keeps both inside the cone and brings x o y = s e (the cone's product) from a large s to 0, by
Newton steps with Mehrotra's predictor and corrector (Alizadeh and Goldfarb 2003, Second-order cone programming; Acary,
Armand, Nguyen and Shpakovych 2023, Second-order cone programming for frictional contact mechanics using interior point
algorithm). The method needs no initial guess and 15 to 25 steps for any problem. If the impulses are not unique, it
ends in the middle of the solutions, so W may be singular. The last digits converge slowly: the caller continues from
the answer with proximal Newton steps (contact_solver.py).

Held actuator rows keep their coordinate; other actuator rows and moments keep their impulse. Cable friction is treated
as sticking. The sweeps that follow correct these assumptions.
"""

from typing import NamedTuple

from taichisoft.contact.kernels.constraint_problem import (
    AT_UPPER_END,
    GRIP,
    LOWER_END,
    NOT_HELD,
    UPPER_END,
    Iterate,
    Problem,
    cone_product,
    cone_quotient,
    copy_iterate,
    entries,
    held_end,
    measure_velocity,
    row_count,
    way_to_boundary,
)
from taichisoft.contact.kernels.newton_step import LinearSystem, factorise, row_length, substitute
from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS
from taichisoft.contact.kernels.sweep import sweep
from taichisoft.runtime.language import Scalars, func, ti, vec3
from taichisoft.runtime.launch import kernel

STEPS = 40  # 15 to 25 if it converges
# A shorter step shows that the corrector failed: the next step aims at the centre, by half.
SHORT = 0.1
# If even that is shorter than this, a contact is too close to the boundary for its x o y: all aim inwards.
SHORTEST = 0.02


class InteriorPoint(NamedTuple):
    """Iterate of the method; all arrays but `unit` are of shape (row_capacity,).

    Attributes:
        x, y: x and y of each contact and x of each held actuator, in units in which the blocks of W have the size 1.
        scale: unit of x, apart from the common `unit`; 0 for the tangents of a contact without friction.
        end: velocity at which a held actuator row is held [mm/s, of a volume mm^3/s], 0 for contacts.
        miss: difference between y and the y that belongs to x.
        x_step, y_step: next step of x and y.
        unit: common unit, shape (1,).
    """

    x: Scalars
    y: Scalars
    scale: Scalars
    end: Scalars
    miss: Scalars
    x_step: Scalars
    y_step: Scalars
    unit: Scalars


@func
def put(values: Scalars, k: ti.i32, entry: vec3):
    """Set the entries of contact k."""
    for i in ti.static(range(3)):
        values[3 * k + i] = entry[i]


@func
def shear(y: vec3, z: vec3) -> vec3:
    """Change z of y, less the change of |y_t| in its first entry."""
    size = ti.sqrt(y[1] * y[1] + y[2] * y[2])
    first = z[0]
    if size > 1e-12:
        first -= (y[1] * z[1] + y[2] * z[2]) / size
    return vec3(first, z[1], z[2])


@func
def begin(problem: Problem, current: Iterate, system: LinearSystem, interior: InteriorPoint) -> ti.i32:
    """Choose rows, units and the first iterate; returns the number of rows. `current` keeps fixed impulses only."""
    rows, contacts = row_count(problem), problem.size[CONTACTS]
    w = ti.static(problem.compliance)
    count = 3 * contacts
    for c in range(contacts):
        mu = problem.friction[c]
        normal = w[3 * c * (rows + 1)]
        tangents = w[(3 * c + 1) * (rows + 1)] + w[(3 * c + 2) * (rows + 1)]
        if mu > 0.0:
            size = ti.sqrt(3.0 / (normal / (mu * mu) + tangents))
            put(interior.scale, c, vec3(size / mu, size, size))
        else:
            put(interior.scale, c, vec3(1.0 / ti.sqrt(normal), 0.0, 0.0))
        for i in ti.static(range(3)):
            system.row_of[3 * c + i] = 3 * c + i
            interior.end[3 * c + i] = 0.0
    for a in range(problem.size[ACTUATORS]):
        row = 3 * contacts + a
        held = held_end(problem.bounds, a, current.impulse[row], current.velocity[row], w[row * (rows + 1)])
        if problem.bounds[a, GRIP] >= 0.0 or held != NOT_HELD:
            interior.end[count] = 0.0
            if problem.bounds[a, GRIP] < 0.0:
                interior.end[count] = problem.bounds[a, LOWER_END]
                if held == AT_UPPER_END:
                    interior.end[count] = problem.bounds[a, UPPER_END]
            interior.scale[count] = 1.0 / ti.sqrt(w[row * (rows + 1)])
            system.row_of[count] = row
            count += 1
    for k in range(count):
        current.impulse[system.row_of[k]] = 0.0
    measure_velocity(problem, current)
    unit = 1e-300
    for k in range(count):
        unit = ti.max(unit, interior.scale[k] * ti.abs(current.velocity[system.row_of[k]] - interior.end[k]))
        interior.x[k] = 0.0
        interior.y[k] = 0.0
        interior.x_step[k] = 0.0
        interior.y_step[k] = 0.0
        if k < 3 * contacts and k % 3 == 0:
            interior.x[k] = 1.0
            interior.y[k] = 1.0
    interior.unit[0] = unit
    return count


@func
def measure_miss(count: ti.i32, problem: Problem, current: Iterate, system: LinearSystem, interior: InteriorPoint):
    """Fill in `miss`, by the velocity of x plus |y_t| in its normal part; `current` gets the impulses of x."""
    for k in range(count):
        current.impulse[system.row_of[k]] = interior.unit[0] * interior.scale[k] * interior.x[k]
    measure_velocity(problem, current)
    for k in range(count):
        interior.miss[k] = (
            interior.scale[k] / interior.unit[0] * (current.velocity[system.row_of[k]] - interior.end[k])
            - interior.y[k]
        )
    for c in range(problem.size[CONTACTS]):
        interior.miss[3 * c] = interior.miss[3 * c] + ti.sqrt(interior.y[3 * c + 1] ** 2 + interior.y[3 * c + 2] ** 2)


@func
def fill_matrix(count: ti.i32, problem: Problem, system: LinearSystem, interior: InteriorPoint):
    """Fill in the matrix of a step: W in the units of x, less the derivative of y by x at constant x o y."""
    rows, length = row_count(problem), row_length(count)
    for a in range(count):
        for b in range(count):
            entry = problem.compliance[system.row_of[a] * rows + system.row_of[b]]
            system.matrix[a * length + b] = interior.scale[a] * interior.scale[b] * entry
    for c in range(problem.size[CONTACTS]):
        x, y = entries(interior.x, c), entries(interior.y, c)
        for j in ti.static(range(3)):
            unit = vec3(0.0)
            unit[j] = 1.0
            column = shear(y, cone_quotient(x, cone_product(y, unit)))
            for i in ti.static(range(3)):
                place = (3 * c + i) * length + 3 * c + j
                system.matrix[place] = system.matrix[place] + column[i]


@func
def find_direction(
    count: ti.i32, contacts: ti.i32, target: ti.f64, corrected: ti.f64, system: LinearSystem, interior: InteriorPoint
):
    """Fill in the steps of x and y towards x o y = target e, less `corrected` times the product of the last steps."""
    for c in range(contacts):
        x, y = entries(interior.x, c), entries(interior.y, c)
        product = cone_product(entries(interior.x_step, c), entries(interior.y_step, c))
        change = cone_quotient(x, vec3(target, 0.0, 0.0) - corrected * product) - y
        put(interior.y_step, c, change)
        put(system.step, c, shear(y, change) - entries(interior.miss, c))
    for k in range(3 * contacts, count):
        system.step[k] = -interior.miss[k]
    substitute(count, system)
    for k in range(count):
        interior.x_step[k] = system.step[k]
    for c in range(contacts):
        x, y = entries(interior.x, c), entries(interior.y, c)
        moved = cone_quotient(x, cone_product(y, entries(interior.x_step, c)))
        put(interior.y_step, c, entries(interior.y_step, c) - moved)


@func
def longest_step(contacts: ti.i32, interior: InteriorPoint) -> ti.f64:
    """Largest fraction of the steps that stays inside the cones."""
    t = 1e30
    for c in range(contacts):
        t = ti.min(t, way_to_boundary(entries(interior.x, c), entries(interior.x_step, c)))
        t = ti.min(t, way_to_boundary(entries(interior.y, c), entries(interior.y_step, c)))
    return t


@func
def mean_product(contacts: ti.i32, t: ti.f64, interior: InteriorPoint) -> ti.f64:
    """Mean of x . y over the contacts, at fraction t of the steps."""
    total = 0.0
    for c in range(contacts):
        x = entries(interior.x, c) + t * entries(interior.x_step, c)
        total += x.dot(entries(interior.y, c) + t * entries(interior.y_step, c))
    return total / contacts


@kernel
def follow_path(
    problem: Problem,
    current: Iterate,
    trial: Iterate,
    system: LinearSystem,
    interior: InteriorPoint,
    figure: Scalars,
    tolerance: ti.f64,
    share: ti.f64,
    one: ti.i32,
):
    """Take interior-point steps until the residual of a sweep, written to `figure`, is below the tolerance.

    Each step goes at most `share` of the distance to the boundary. `current` gets the impulses and velocities after the
    sweep.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        contacts = problem.size[CONTACTS]
        count = begin(problem, current, system, interior)
        steps = 0
        while steps < STEPS:
            steps += 1
            measure_miss(count, problem, current, system, interior)
            fill_matrix(count, problem, system, interior)
            if not factorise(count, system, one):
                steps = STEPS
            # The predictor aims at 0; its length determines the target of the corrected step. A corrected step of
            # almost no length is replaced by a step towards the centre.
            target, corrected, t, attempt = 0.0, 0.0, 0.0, 0
            now = mean_product(contacts, 0.0, interior)
            while attempt < 3:
                find_direction(count, contacts, target, corrected, system, interior)
                t = ti.min(1.0, longest_step(contacts, interior))
                if attempt == 0:
                    left = ti.max(0.0, mean_product(contacts, t, interior) / now)
                    target = ti.min(1.0, left**3) * now
                    corrected = 1.0
                else:
                    if t >= SHORT:
                        attempt = 3
                    target, corrected = 0.5 * now, 0.0
                attempt += 1
            t = ti.min(1.0, share * t)
            if t < SHORTEST:
                t = 0.0
                for c in range(contacts):
                    interior.x[3 * c] = interior.x[3 * c] + ti.sqrt(now)
                    interior.y[3 * c] = interior.y[3 * c] + ti.sqrt(now)
            for k in range(count):
                interior.x[k] = interior.x[k] + t * interior.x_step[k]
                interior.y[k] = interior.y[k] + t * interior.y_step[k]
            for k in range(row_count(problem)):
                trial.impulse[k] = current.impulse[k]
            for k in range(count):
                trial.impulse[system.row_of[k]] = interior.unit[0] * interior.scale[k] * interior.x[k]
            measure_velocity(problem, trial)
            figure[0] = sweep(problem, trial)
            if figure[0] < tolerance:
                steps = STEPS
        copy_iterate(row_count(problem), trial, current)
