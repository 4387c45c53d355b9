"""The constraint problem of a step, its iterate, the cone of friction, and bounds of actuators."""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS, contact_basis
from taichisoft.contact.kernels.separation import BEFORE, Choice
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, ScalarTable, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

# The cone x_0 >= |(x_1, x_2)| and its algebra (Alizadeh and Goldfarb 2003, Second-order cone programming).


@func
def entries(values: Scalars, k: ti.i32) -> vec3:
    """Entries of contact k."""
    return vec3(values[3 * k], values[3 * k + 1], values[3 * k + 2])


@func
def cone_product(a: vec3, b: vec3) -> vec3:
    """Product a o b of the cone's algebra."""
    return vec3(a.dot(b), a[0] * b[1] + b[0] * a[1], a[0] * b[2] + b[0] * a[2])


@func
def cone_quotient(a: vec3, b: vec3) -> vec3:
    """Solution z of a o z = b, for a inside the cone."""
    first = (a[0] * b[0] - a[1] * b[1] - a[2] * b[2]) / (a[0] * a[0] - a[1] * a[1] - a[2] * a[2])
    return vec3(first, (b[1] - a[1] * first) / a[0], (b[2] - a[2] * first) / a[0])


@func
def way_to_boundary(x: vec3, step: vec3) -> ti.f64:
    """Largest t with x + t step in the cone, at most 1e30."""
    a = step[0] * step[0] - step[1] * step[1] - step[2] * step[2]
    b = x[0] * step[0] - x[1] * step[1] - x[2] * step[2]
    c = x[0] * x[0] - x[1] * x[1] - x[2] * x[2]
    t = 1e30
    if step[0] < 0.0:
        t = -x[0] / step[0]
    root = b * b - a * c
    if root >= 0.0:
        q = -(b + ti.sqrt(root))
        if b < 0.0:
            q = -(b - ti.sqrt(root))
        if q != 0.0 and c / q > 0.0:
            t = ti.min(t, c / q)
        if a != 0.0 and q / a > 0.0:
            t = ti.min(t, q / a)
    return t


# y = y + a x for vectors within arrays, by tiles of eight numbers.
#
# A plain loop over Taichi's arrays is not vectorised: LLVM must assume that a store changes the pointers that it loads.
# Here a tile is computed in registers before any of it is stored.
#
# LLVM unrolls a loop with a countable number of turns up to eight times. For tiles and the few remaining numbers this
# only costs time, in compilation and in code generation at every start. So the loops are written such that LLVM sees
# fewer than eight remaining numbers and cannot count the tiles (`next_tile`).

TILE = 8
Tile = ti.types.vector(TILE, ti.f64)


@func
def next_tile(place: ti.i32, first: ti.i32) -> ti.i32:
    """Start of the next tile, which is after `first`."""
    return ti.max(place + TILE, first)


@func
def add_multiple(y: Scalars, at: ti.i32, factor: ti.f64, x: Scalars, first: ti.i32, count: ti.i32):
    """Add `factor` times x[first : first + count] to y[at : at + count]."""
    i, beside = at, count & TILE - 1
    while i < at + count - beside:
        j = first + i - at
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = y[i + a] + factor * x[j + a]
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
        i = next_tile(i, at)
    for left in range(beside):
        k = count - 1 - left
        y[at + k] = y[at + k] + factor * x[first + k]


@func
def add_three_multiples(y: Scalars, factors: ti.types.vector(3, ti.f64), x: Scalars, first: ti.i32, count: ti.i32):
    """Add three rows of x, `count` long and one after the other from `first`, each times its factor, to y[:count]."""
    i, beside = 0, count & TILE - 1
    while i < count - beside:
        j = first + i
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = (
                y[i + a] + factors[0] * x[j + a] + factors[1] * x[j + count + a] + factors[2] * x[j + 2 * count + a]
            )
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
        i = next_tile(i, 0)
    for left in range(beside):
        k = count - 1 - left
        j = first + k
        y[k] = y[k] + factors[0] * x[j] + factors[1] * x[j + count] + factors[2] * x[j + 2 * count]


# Bounds of actuator rows in the constraint problem: imposed coordinates, stops and cable friction.
#
# With v the rate of the coordinate after the step less a target rate, and l the impulse of its effort (pressure or
# tension times the time step), a row has three conditions, each overruled by the next:
#
# - l is the preferred impulse;
# - v lies between two ends, both 0 for an imposed coordinate;
# - l stays within its own range: a cable does not push, a motor has a largest force.
#
# A row of friction belongs to an inner point of a cable. Its l is the tension lost at the point, times the time step,
# and its v the rate at which the length beyond the point grows. Euler's and Eytelwein's law for a rope around a post
# bounds the ratio of the tensions on both sides by exp(mu theta), theta being the angle by which the cable turns: with
# T the tension on the pulled side and g = exp(mu theta) - 1, -T g <= l <= T g / (1 + g), and l opposes the sliding.

# Columns of the table of bounds. GRIP is g for a row of friction, which uses no other column, and -1 for other rows.
PREFERRED, LOWER_END, UPPER_END, LOWEST, HIGHEST, GRIP = range(6)
BOUND_COLUMNS = 6
# End at which a coordinate is held.
NOT_HELD, AT_LOWER_END, AT_UPPER_END = range(3)


@func
def tension_before(bounds: ScalarTable, a: ti.i32, first_row: ti.i32, impulse: Scalars) -> ti.f64:
    """Tension on the pulled side of the inner point of actuator row a, times the time step; 0 for other rows.

    The impulses of the actuators begin at `first_row`. The row of the cable itself and the rows of the inner points
    before this one directly precede row a.
    """
    tension = 0.0
    if bounds[a, GRIP] >= 0.0:
        above = a - 1
        while bounds[above, GRIP] >= 0.0:
            tension -= impulse[first_row + above]
            above -= 1
        tension += impulse[first_row + above]
    return tension


@func
def best_impulse(
    bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64, tension: ti.f64
) -> ti.f64:
    """Impulse of row a that obeys its bounds with all others fixed; `velocity` belongs to the present `impulse`.

    `tension` is the result of `tension_before`.
    """
    best = impulse + (bounds[a, LOWER_END] - velocity) / compliance
    lowest, highest = bounds[a, LOWEST], bounds[a, HIGHEST]
    if bounds[a, GRIP] >= 0.0:
        size = ti.abs(tension)
        lowest = -size * bounds[a, GRIP]
        highest = size * bounds[a, GRIP] / (1.0 + bounds[a, GRIP])
    else:
        at_upper_end = impulse + (bounds[a, UPPER_END] - velocity) / compliance
        best = ti.max(best, ti.min(bounds[a, PREFERRED], at_upper_end))
    return ti.max(lowest, ti.min(best, highest))


@func
def held_end(bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64) -> ti.i32:
    """Whether v determines l of row a: AT_LOWER_END or AT_UPPER_END; not for rows of friction.

    NOT_HELD: the impulse is a bound or the preferred impulse.
    """
    at_lower_end = impulse + (bounds[a, LOWER_END] - velocity) / compliance
    at_upper_end = impulse + (bounds[a, UPPER_END] - velocity) / compliance
    lowest, highest, preferred = bounds[a, LOWEST], bounds[a, HIGHEST], bounds[a, PREFERRED]
    where = NOT_HELD
    if preferred <= at_lower_end:
        if lowest < at_lower_end and at_lower_end < highest:
            where = AT_LOWER_END
    elif preferred >= at_upper_end and lowest < at_upper_end and at_upper_end < highest:
        where = AT_UPPER_END
    return where


@func
def sliding_share(
    bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64, tension: ti.f64
) -> ti.f64:
    """Share of the tension that is lost at the point of friction row a while the cable slides; 0 while it sticks.

    Negative while the cable is paid out. The arguments are as for `best_impulse`.
    """
    sticking = impulse - velocity / compliance
    share = 0.0
    if sticking >= ti.abs(tension) * bounds[a, GRIP] / (1.0 + bounds[a, GRIP]):
        share = bounds[a, GRIP] / (1.0 + bounds[a, GRIP])
    elif sticking <= -ti.abs(tension) * bounds[a, GRIP]:
        share = -bounds[a, GRIP]
    if tension < 0.0:
        share = -share
    return share


# The constraint problem of a step, and its iterate.


class Problem(NamedTuple):
    """The constraint problem: v = free + W l, with the conditions of contact, friction and actuators.

    Rows of contacts come first, then rows of actuators, whose impulses are efforts times the time step, then rows of
    moments, whose impulses are moments times the time step.

    Attributes:
        size: number of contacts, of actuator rows, and of contacts with moments, shape (3,).
        compliance: W by rows [mm/s per mN s, likewise for volumes], shape (row_capacity^2,).
        free: velocities without impulses [mm/s, of a volume mm^3/s], shape (row_capacity,).
        friction: coefficient of each contact, shape (contact_capacity,).
        bounds: bounds of each actuator row, columns PREFERRED to GRIP, shape (actuator_capacity, 6).
        moment_contact, moment_length: contact of each moment, and bounds of the moment, see `row_velocities.Rows`.
    """

    size: Integers
    compliance: Scalars
    free: Scalars
    friction: Scalars
    bounds: ScalarTable
    moment_contact: Integers
    moment_length: ScalarTable

    @classmethod
    def without_moments(
        cls, size: np.ndarray, compliance: np.ndarray, free: np.ndarray, friction: np.ndarray, bounds: np.ndarray
    ) -> "Problem":
        """A problem of contacts and actuators."""
        return cls(size, compliance, free, friction, bounds, np.zeros(0, dtype=np.int32), np.zeros((0, 2)))


class Iterate(NamedTuple):
    """Impulses [mN s, of a volume kPa s] and their velocities [mm/s, of a volume mm^3/s], each (row_capacity,)."""

    impulse: Scalars
    velocity: Scalars


@func
def row_count(problem: Problem) -> ti.i32:
    """Number of rows: three per contact, one per actuator coordinate, three per moment."""
    return first_moment(problem) + 3 * problem.size[MOMENTS]


@func
def first_moment(problem: Problem) -> ti.i32:
    """Index of the first row of the moments."""
    return 3 * problem.size[CONTACTS] + problem.size[ACTUATORS]


@func
def measure_velocity(problem: Problem, iterate: Iterate):
    """Compute velocity = free + W impulse."""
    count = row_count(problem)
    for k in range(count):
        iterate.velocity[k] = problem.free[k]
    for row in range(count):
        if iterate.impulse[row] != 0.0:
            add_multiple(iterate.velocity, 0, iterate.impulse[row], problem.compliance, row * count, count)


@func
def copy_iterate(rows: ti.i32, source: Iterate, target: Iterate):
    """Copy impulses and velocities of the first `rows` rows."""
    for k in range(rows):
        target.impulse[k] = source.impulse[k]
        target.velocity[k] = source.velocity[k]


# The contacts that a step reports, with their impulses and sliding velocities.

# Values of `closest` for a pair of bodies without a closest contact to report.
NONE, TAKES_PART = -1, -2


class ReportedContacts(NamedTuple):
    """The contacts that take part, and the closest contact of other bodies near each other, with spare capacity.

    Attributes:
        count: number of contacts, shape (1,).
        bodies: numbers of the two bodies, shape (capacity, 2).
        point: middle of the two points [mm], shape (capacity, 3).
        normal: unit vector from the first body to the second, shape (capacity, 3).
        impulse: impulse on the second body [mN s], shape (capacity, 3).
        slip: sliding velocity of the second body on the first if pressed, else 0 [mm/s], shape (capacity, 3).
        closest: work space: the closest contact of each pair of bodies, shape (body_count, body_count).
    """

    count: Integers
    bodies: IntegerTable
    point: Vectors
    normal: Vectors
    impulse: Vectors
    slip: Vectors
    closest: IntegerTable

    @classmethod
    def with_room(cls, capacity: int, body_count: int) -> "ReportedContacts":
        """Empty arrays for `capacity` contacts."""
        return cls(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            point=np.zeros((capacity, 3)),
            normal=np.zeros((capacity, 3)),
            impulse=np.zeros((capacity, 3)),
            slip=np.zeros((capacity, 3)),
            closest=np.zeros((body_count, body_count), dtype=np.int32),
        )


@kernel
def report_contacts(
    alarm_distance: ti.f64,
    contacts: Contacts,
    choice: Choice,
    contact_impulse: Vectors,
    solved: Iterate,
    reported: ReportedContacts,
):
    """Fill in the contacts in their order; bodies are near each other within `alarm_distance` [mm]."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        for first in range(reported.closest.shape[0]):
            for second in range(reported.closest.shape[1]):
                reported.closest[first, second] = NONE
        for c in range(contacts.count[0]):
            first, second = contacts.bodies[c, 0], contacts.bodies[c, 1]
            best = reported.closest[first, second]
            if choice.status[c] >= BEFORE:
                reported.closest[first, second] = TAKES_PART
            elif best != TAKES_PART:
                closest = alarm_distance
                if best != NONE:
                    closest = contacts.distance[best]
                if contacts.distance[c] < closest:
                    reported.closest[first, second] = c
        reported.count[0] = 0
        row = 0
        for c in range(contacts.count[0]):
            takes_part = choice.status[c] >= BEFORE
            if takes_part or reported.closest[contacts.bodies[c, 0], contacts.bodies[c, 1]] == c:
                k = reported.count[0]
                reported.count[0] = k + 1
                reported.bodies[k, 0] = contacts.bodies[c, 0]
                reported.bodies[k, 1] = contacts.bodies[c, 1]
                reported.point[k] = 0.5 * (contacts.points[c, 0] + contacts.points[c, 1])
                reported.normal[k] = contacts.normal[c]
                reported.impulse[k] = vec3(0.0)
                reported.slip[k] = vec3(0.0)
                if takes_part:
                    reported.impulse[k] = contact_impulse[c]
                    if solved.impulse[3 * row] > 0.0:
                        along_first, along_second = solved.velocity[3 * row + 1], solved.velocity[3 * row + 2]
                        basis = contact_basis(contacts.normal[c])
                        for d in ti.static(range(3)):
                            reported.slip[k][d] = along_first * basis[1, d] + along_second * basis[2, d]
            if takes_part:
                row += 1
