"""An interior-point method for contact and friction, where sweeps and Newton steps from there go astray.

With De Saxce's change of variables (De Saxce and Feng 1998, The bipotential method), x = (mu l_n, l_t) and
y = (v_n / mu + |v_t|, v_t) of each contact lie in the cone x_0 >= |x_t| and are orthogonal: Signorini's and Coulomb's
laws in one. The method keeps both inside the cone and brings x o y = s e (the cone's product) from a large s to 0, by
Newton steps with Mehrotra's predictor and corrector (Alizadeh and Goldfarb 2003, Second-order cone programming; Acary,
Armand, Nguyen and Shpakovych 2023, Second-order cone programming for frictional contact mechanics using interior point
algorithm). It starts from nothing but the problem, needs 15 to 25 steps whatever the problem, and where many impulses
do equally well it ends in the midst of them, so that W may be singular. Its last digits come slowly: whoever calls it
goes on from its answer with proximal Newton steps (proximal_newton.py).

Actuators' rows that are held keep their coordinate where it is held; those that are not keep their impulse, and so do
moments. Friction takes part as if it stuck. The sweeps that follow find where that was wrong.
"""

from typing import NamedTuple

from taichisoft.runtime.launch import func, kernel
from taichisoft.runtime.taichi_start import Scalars, ti, vec3
from taichisoft.solver.kernels.actuator_bounds import AT_UPPER_END, GRIP, LOWER_END, NOT_HELD, UPPER_END, held_end
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem, copy_iterate, measure_velocity, row_count
from taichisoft.solver.kernels.elimination import LinearSystem, factorise, row_length, substitute
from taichisoft.solver.kernels.friction_cone import cone_product, cone_quotient, way_to_boundary
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS
from taichisoft.solver.kernels.sweep import sweep

STEPS = 40  # those that converge need 15 to 25
# A step so short shows that the corrector did harm: the next goes towards the middle, by half.
SHORT = 0.1
# Where even that is as short as this, a contact is too near the boundary for its x o y: all go inwards.
SHORTEST = 0.02


class Path(NamedTuple):
    """Where the method is, all but the last of shape (row_capacity,).

    Attributes:
        x, y: of each contact and x of each held actuator, in units in which the blocks of W have the size 1.
        scale: what one unit of x is, but for the unit of all; 0 for the tangents of a contact without friction.
        end: velocity of a held actuator's row [mm/s, of a volume mm^3/s], 0 for contacts.
        miss: by how much y is not that of x.
        x_step, y_step: where the next step goes.
        unit: the unit of all, shape (1,).
    """

    x: Scalars
    y: Scalars
    scale: Scalars
    end: Scalars
    miss: Scalars
    x_step: Scalars
    y_step: Scalars
    unit: Scalars


@ti.func
def entries(values: Scalars, k: ti.i32) -> vec3:
    """Those of one contact."""
    return vec3(values[3 * k], values[3 * k + 1], values[3 * k + 2])


@ti.func
def put(values: Scalars, k: ti.i32, entry: vec3):
    """Those of one contact."""
    for i in ti.static(range(3)):
        values[3 * k + i] = entry[i]


@ti.func
def shear(y: vec3, z: vec3) -> vec3:
    """The change of y less that of |y_t| in its first entry, for a change z of y."""
    size = ti.sqrt(y[1] * y[1] + y[2] * y[2])
    first = z[0]
    if size > 1e-12:
        first -= (y[1] * z[1] + y[2] * z[2]) / size
    return vec3(first, z[1], z[2])


@func
def begin(problem: Problem, current: Iterate, system: LinearSystem, path: Path) -> ti.i32:
    """Choose rows, units and the first point; returns the number of rows. `current` keeps the fixed impulses only."""
    rows, contacts = row_count(problem), problem.size[CONTACTS]
    w = ti.static(problem.compliance)
    count = 3 * contacts
    for c in range(contacts):
        mu = problem.friction[c]
        normal = w[3 * c * (rows + 1)]
        tangents = w[(3 * c + 1) * (rows + 1)] + w[(3 * c + 2) * (rows + 1)]
        if mu > 0.0:
            size = ti.sqrt(3.0 / (normal / (mu * mu) + tangents))
            put(path.scale, c, vec3(size / mu, size, size))
        else:
            put(path.scale, c, vec3(1.0 / ti.sqrt(normal), 0.0, 0.0))
        for i in ti.static(range(3)):
            system.row_of[3 * c + i] = 3 * c + i
            path.end[3 * c + i] = 0.0
    for a in range(problem.size[ACTUATORS]):
        row = 3 * contacts + a
        held = held_end(problem.bounds, a, current.impulse[row], current.velocity[row], w[row * (rows + 1)])
        if problem.bounds[a, GRIP] >= 0.0 or held != NOT_HELD:
            path.end[count] = 0.0
            if problem.bounds[a, GRIP] < 0.0:
                path.end[count] = problem.bounds[a, LOWER_END]
                if held == AT_UPPER_END:
                    path.end[count] = problem.bounds[a, UPPER_END]
            path.scale[count] = 1.0 / ti.sqrt(w[row * (rows + 1)])
            system.row_of[count] = row
            count += 1
    for k in range(count):
        current.impulse[system.row_of[k]] = 0.0
    measure_velocity(problem, current)
    unit = 1e-300
    for k in range(count):
        unit = ti.max(unit, path.scale[k] * ti.abs(current.velocity[system.row_of[k]] - path.end[k]))
        path.x[k] = 0.0
        path.y[k] = 0.0
        path.x_step[k] = 0.0
        path.y_step[k] = 0.0
        if k < 3 * contacts and k % 3 == 0:
            path.x[k] = 1.0
            path.y[k] = 1.0
    path.unit[0] = unit
    return count


@func
def measure_miss(count: ti.i32, problem: Problem, current: Iterate, system: LinearSystem, path: Path):
    """By how much y is not the velocity of x with |y_t| added to its normal part; `current` gets the impulses of x."""
    for k in range(count):
        current.impulse[system.row_of[k]] = path.unit[0] * path.scale[k] * path.x[k]
    measure_velocity(problem, current)
    for k in range(count):
        path.miss[k] = path.scale[k] / path.unit[0] * (current.velocity[system.row_of[k]] - path.end[k]) - path.y[k]
    for c in range(problem.size[CONTACTS]):
        path.miss[3 * c] = path.miss[3 * c] + ti.sqrt(path.y[3 * c + 1] ** 2 + path.y[3 * c + 2] ** 2)


@func
def fill_matrix(count: ti.i32, problem: Problem, system: LinearSystem, path: Path):
    """The matrix of a step: W in the units of x, and what x changes in y where x o y stays."""
    rows, length = row_count(problem), row_length(count)
    for a in range(count):
        for b in range(count):
            entry = problem.compliance[system.row_of[a] * rows + system.row_of[b]]
            system.matrix[a * length + b] = path.scale[a] * path.scale[b] * entry
    for c in range(problem.size[CONTACTS]):
        x, y = entries(path.x, c), entries(path.y, c)
        for j in ti.static(range(3)):
            unit = vec3(0.0)
            unit[j] = 1.0
            column = shear(y, cone_quotient(x, cone_product(y, unit)))
            for i in ti.static(range(3)):
                place = (3 * c + i) * length + 3 * c + j
                system.matrix[place] = system.matrix[place] + column[i]


@func
def find_direction(
    count: ti.i32, contacts: ti.i32, target: ti.f64, corrected: ti.f64, system: LinearSystem, path: Path
):
    """Fill in the steps of x and y that aim at x o y = target e, less a share of the product of the last steps."""
    for c in range(contacts):
        x, y = entries(path.x, c), entries(path.y, c)
        product = cone_product(entries(path.x_step, c), entries(path.y_step, c))
        change = cone_quotient(x, vec3(target, 0.0, 0.0) - corrected * product) - y
        put(path.y_step, c, change)
        put(system.step, c, shear(y, change) - entries(path.miss, c))
    for k in range(3 * contacts, count):
        system.step[k] = -path.miss[k]
    substitute(count, system)
    for k in range(count):
        path.x_step[k] = system.step[k]
    for c in range(contacts):
        x, y = entries(path.x, c), entries(path.y, c)
        moved = cone_quotient(x, cone_product(y, entries(path.x_step, c)))
        put(path.y_step, c, entries(path.y_step, c) - moved)


@func
def longest_step(contacts: ti.i32, path: Path) -> ti.f64:
    """How far the steps stay inside the cones."""
    t = 1e30
    for c in range(contacts):
        t = ti.min(t, way_to_boundary(entries(path.x, c), entries(path.x_step, c)))
        t = ti.min(t, way_to_boundary(entries(path.y, c), entries(path.y_step, c)))
    return t


@func
def mean_product(contacts: ti.i32, t: ti.f64, path: Path) -> ti.f64:
    """Mean of x . y over the contacts, t along the steps."""
    total = 0.0
    for c in range(contacts):
        x = entries(path.x, c) + t * entries(path.x_step, c)
        total += x.dot(entries(path.y, c) + t * entries(path.y_step, c))
    return total / contacts


@kernel
def follow_path(
    problem: Problem,
    current: Iterate,
    trial: Iterate,
    system: LinearSystem,
    path: Path,
    figure: Scalars,
    tolerance: ti.f64,
    share: ti.f64,
    one: ti.i32,
):
    """Interior-point steps until a sweep from there finds less than the tolerance to change, which `figure` then has.

    Each step goes at most that share of the way to the boundary. `current` ends with the impulses and velocities after
    that sweep.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        contacts = problem.size[CONTACTS]
        count = begin(problem, current, system, path)
        steps = 0
        while steps < STEPS:
            steps += 1
            measure_miss(count, problem, current, system, path)
            fill_matrix(count, problem, system, path)
            if not factorise(count, system, one):
                steps = STEPS
            # The predictor aims at 0; how far it comes tells where the corrected step should aim. A corrected step that
            # ends at once is replaced by one towards the middle.
            target, corrected, t, attempt = 0.0, 0.0, 0.0, 0
            now = mean_product(contacts, 0.0, path)
            while attempt < 3:
                find_direction(count, contacts, target, corrected, system, path)
                t = ti.min(1.0, longest_step(contacts, path))
                if attempt == 0:
                    left = ti.max(0.0, mean_product(contacts, t, path) / now)
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
                    path.x[3 * c] = path.x[3 * c] + ti.sqrt(now)
                    path.y[3 * c] = path.y[3 * c] + ti.sqrt(now)
            for k in range(count):
                path.x[k] = path.x[k] + t * path.x_step[k]
                path.y[k] = path.y[k] + t * path.y_step[k]
            for k in range(row_count(problem)):
                trial.impulse[k] = current.impulse[k]
            for k in range(count):
                trial.impulse[system.row_of[k]] = path.unit[0] * path.scale[k] * path.x[k]
            measure_velocity(problem, trial)
            figure[0] = sweep(problem, trial)
            if figure[0] < tolerance:
                steps = STEPS
        copy_iterate(row_count(problem), trial, current)
