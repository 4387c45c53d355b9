"""The rows of a step's constraint problem: contacts, requests to actuators, and laws of their coordinates."""

import math
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.contact.contact_solver import ContactSolver
from taichisoft.contact.kernels.constraint_problem import (
    BOUND_COLUMNS,
    GRIP,
    HIGHEST,
    LOWER_END,
    LOWEST,
    PREFERRED,
    UPPER_END,
    Problem,
)
from taichisoft.contact.kernels.row_velocities import Rows
from taichisoft.contact.model import Model
from taichisoft.mechanics.actuator_kind import UNLIMITED, CoordinateLaw
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.kernels.sparse_columns import GROUP, SparseColumns
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.runtime.launch import forget
from taichisoft.scene.scene import Time

# Rows of actuators whose efforts and coordinates follow a law of their own, such as the air in joined cavities.
#
# The law gives the coordinates by the efforts, and falls: the more air is pressed, the less space it takes. The bodies
# give the coordinates by the efforts, too, and there they rise, nearly linearly where contacts stay as they are. So the
# law finds the efforts at which it meets linear bodies, each row of the constraint problem gets the law's own tangent
# there, a compliance as that of a stretchy cable, and the solution of the problem tells where the bodies really are:
# solve, meet, and solve again. That the tangents leave out how efforts act on each other's coordinates keeps the
# problem symmetric. How much bodies give way is what the rows of the actuators alone say, corrected by what was found
# (Broyden 1965, A class of methods for solving nonlinear simultaneous equations).

# Distance from the law at which rows follow it, over the scale of the coordinate, or over the effort: round-off.
FOLLOWS, EFFORT_FOLLOWS = 1e-11, 1e-13
# Where an effort is too low for the law, the next one is so much of the last effort above the lowest.
NEARER = 0.1
# Change of the efforts over the efforts, above which the change of the coordinates is more than round-off.
TELLING = 1e-7


@dataclass(frozen=True)
class FollowedLaw:
    """A law and the lines that stand for it in rows of the constraint problem.

    Attributes:
        rows: numbers of the rows among the actuators', in rising order, shape (n,).
        law: the law.
        effort, coordinate: a point of each line, shape (n,).
        slope: their slopes, shape (n, n): lines of a solver have no slopes by each other's efforts.
        missed: largest distance between line and law where a line was last solved with, over the scale of the
            coordinate or of the effort.
    """

    rows: np.ndarray
    law: CoordinateLaw
    effort: np.ndarray
    coordinate: np.ndarray
    slope: np.ndarray
    missed: float = math.inf

    @classmethod
    def tangent(cls, rows: np.ndarray, law: CoordinateLaw, effort: np.ndarray, whole: bool = False) -> "FollowedLaw":
        """The law's tangents at efforts, or its whole linearisation."""
        coordinate, slope = law.growth(effort)
        return cls(rows, law, effort, coordinate, slope if whole else np.diag(np.diag(slope)))

    @property
    def holds(self) -> bool:
        """Whether the law holds where the lines were last solved with."""
        return self.missed <= FOLLOWS

    @property
    def at_zero(self) -> np.ndarray:
        """Coordinates of the lines where the efforts are 0, shape (n,)."""
        return self.line(np.zeros(len(self.rows)))

    def line(self, effort: np.ndarray) -> np.ndarray:
        """Coordinates of the lines at efforts, shape (n,)."""
        coordinate: np.ndarray = self.coordinate + self.slope @ (effort - self.effort)
        return coordinate

    def moved(self, effort: np.ndarray, whole: bool = False) -> "FollowedLaw":
        """The tangents at other efforts, but where these are too low for the law."""
        return self.tangent(self.rows, self.law, np.where(effort > self.law.lowest_effort, effort, self.effort), whole)

    def compliance(self, stage: float) -> tuple[int, np.ndarray]:
        """First row, and the lines as own compliance from there on by impulses [mm^3/s per kPa s]; see `Time.stage`."""
        first = int(self.rows[0])
        own = np.zeros((int(self.rows[-1]) - first + 1,) * 2)
        own[np.ix_(self.rows - first, self.rows - first)] = -self.slope / stage**2
        return first, own

    def measured(self, effort: np.ndarray) -> "FollowedLaw":
        """These lines with what they miss of the law at the efforts that the rows found, shape (n,)."""
        if not (effort > self.law.lowest_effort).all():
            return replace(self, missed=math.inf)
        coordinate, slope = self.law.growth(effort)
        # Where a coordinate changes fast with the effort, round-off of the effort is much of the coordinate.
        rise = EFFORT_FOLLOWS / FOLLOWS * np.abs(np.diag(slope)) * (effort - self.law.lowest_effort)
        missed = np.abs(self.line(effort) - coordinate) / np.maximum(self.law.scale, rise)
        return replace(self, missed=float(np.nan_to_num(missed, nan=math.inf).max()))

    def next(self, effort: np.ndarray, compliance: np.ndarray) -> "FollowedLaw":
        """The lines to go on with after the problem was solved with these, and the rows found efforts, shape (n,).

        `compliance` is by how much the bodies give way [mm^3/kPa], shape (n, n).
        """
        lowest = self.law.lowest_effort
        possible = np.maximum(effort, lowest + NEARER * (self.effort - lowest))
        here = self.line(effort) + compliance @ (possible - effort)
        return self.moved(self.law.meeting(possible, here, compliance))


# Actuators in a step: known loads, or rows of the constraint problem with their bounds.

# No rows: coordinates, target rates, mean rates, bounds and first impulses.
NO_ROWS = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros((0, BOUND_COLUMNS)), np.zeros(0)
# Bounds of an imposed coordinate of unlimited effort.
IMPOSED = np.zeros(BOUND_COLUMNS)
IMPOSED[[LOWEST, HIGHEST, GRIP]] = -UNLIMITED, UNLIMITED, -1.0


@dataclass(frozen=True)
class ActuatorRequests:
    """The actuators' part of the problem of a step.

    An imposed pressure is a known load, and so is the tension of a cable without limits. Efforts that are solved for
    together with the contacts have rows: imposed volumes and pulls, pressures of air that is shut in or flows through a
    line, and cables with stops, friction, or points on a rigid body.

    Attributes:
        load: known pressures [kPa] and tensions [mN], 0 for coordinates with rows, shape (coordinate_count,).
        coordinates: indices of the coordinates with rows, in rising order, shape (row_count,).
        target_rate: rate subtracted from the rate of the coordinate [mm/s or mm^3/s], shape (row_count,).
        mean_rate: part of `target_rate` that does not depend on the place of the linearisation, shape (row_count,).
        bounds: bounds of the rows, see `contact/kernels/constraint_problem.py`, shape (row_count, 6).
        first_impulse: initial guess of the solver [mN s, of a volume kPa s], shape (row_count,).
        start_values: coordinates at the start of the step [mm^3] and [mm], shape (coordinate_count,).
        lead_rate: rates by the shift to the place of the measurement over `Time.stage`, shape (coordinate_count,).
        compliances: first row and own compliance [mm/s per mN s] of each elastic cable with rows, and of the law.
        law: the law that rows follow, with the lines that stand for it in `mean_rate` and `compliances`.
    """

    load: np.ndarray
    coordinates: np.ndarray
    target_rate: np.ndarray
    mean_rate: np.ndarray
    bounds: np.ndarray
    first_impulse: np.ndarray
    start_values: np.ndarray
    lead_rate: np.ndarray
    compliances: tuple[tuple[int, np.ndarray], ...]
    law: FollowedLaw | None = None

    def linearised(
        self,
        geometry: ActuatorGeometry,
        growth: np.ndarray,
        rate: np.ndarray,
        start: State,
        impulse: np.ndarray,
        time: Time,
    ) -> "ActuatorRequests":
        """The same requests, linearised at another place and with another initial guess.

        A row's target rate belongs to the mean rate of its coordinate in the step, (q - q0) / h, which is linear in the
        velocities around the present ones: (q' - q0) / h + dq/dx (v - v').

        With theta below 1 a law holds where forces are taken, at q0 + theta h dq/dx ((1 - theta) v0 + theta v); all
        other rows belong to dq/dx v, the rate after the step, and what they miss by that is in the next step's q0.

        Args:
            geometry: gradients and lengths at the place of the linearisation.
            growth: q' - q0, growth of the coordinates since the start of the step, shape (coordinate_count,).
            rate: dq/dx u' by the velocities u' that lead there, shape (coordinate_count,).
            start: the state at the start of the step.
            impulse: initial guess of the rows' impulses, shape (row_count,).
            time: time stepping.
        """
        here = self if self.law is None else self.following(self.law.moved(impulse[self.law.rows] / time.step), time)
        rows, bounds = self.coordinates, self.bounds.copy()
        rubs = bounds[:, GRIP] >= 0.0
        bounds[rubs, GRIP] = geometry.grip[rows[rubs]]
        if time.theta == 1.0:
            target_rate = here.mean_rate + (rate - growth / time.step)[rows]
        else:
            target_rate = here.mean_rate.copy()
            own = np.zeros(0, dtype=np.intp) if here.law is None else here.law.rows
            rigid_velocity = np.hstack([start.rigid_velocity, start.rigid_angular_velocity])
            missing = rate - growth / time.stage
            missing -= (1.0 - time.theta) * geometry.rates(start.velocity, rigid_velocity)
            target_rate[own] += missing[rows[own]] / time.theta
        return replace(here, target_rate=target_rate, bounds=bounds, first_impulse=impulse)

    def following(self, law: FollowedLaw, time: Time) -> "ActuatorRequests":
        """The same requests with other lines for the law."""
        assert self.law is not None
        mean_rate, target_rate, compliances = self.mean_rate.copy(), self.target_rate.copy(), dict(self.compliances)
        change = (law.at_zero - self.law.at_zero) / (time.theta * time.stage)
        mean_rate[law.rows] += change
        target_rate[law.rows] += change
        first, compliance = law.compliance(time.stage)
        compliances[first] = compliance
        return replace(
            self,
            mean_rate=mean_rate,
            target_rate=target_rate,
            compliances=tuple(compliances.items()),
            law=law,
        )

    def tangent(self, impulse: np.ndarray, time: Time) -> "ActuatorRequests":
        """The same requests with the whole linearisation of the law at impulses of the rows, shape (row_count,)."""
        if self.law is None:
            return self
        return self.following(self.law.moved(impulse[self.law.rows] / time.step, whole=True), time)

    def efforts(self, impulse: np.ndarray, time_step: float) -> np.ndarray:
        """Pressures [kPa] and tensions [mN] of all coordinates, shape (coordinate_count,), by the rows' impulses."""
        effort = self.load.copy()
        effort[self.coordinates] = impulse / time_step
        return effort


def request(model: Model, state: State, geometry: ActuatorGeometry) -> ActuatorRequests:
    """Make the actuators' requests of the step that begins with `state`.

    If bodies are linearised ahead, see `Elasticity.node_lead`, the geometry is measured at their predicted rotation, so
    that loads rotate with the bodies.

    Args:
        model: the bodies.
        state: state at the start of the step.
        geometry: geometry of the actuators, which this call measures.
    """
    geometry.update(state, model.placed_pull_points(state))
    actuators, count = model.actuators, model.actuators.count
    has_rows = state.actuator_imposed | actuators.always_has_rows
    load = np.zeros(count)
    load[actuators.first_coordinate[:-1]] = np.where(has_rows, 0.0, state.actuator_target)
    if np.count_nonzero(has_rows):
        requests = _rows(model, state, geometry, load, has_rows.nonzero()[0].tolist())
    else:
        requests = ActuatorRequests(load, *NO_ROWS, geometry.values(), np.zeros(count), ())
    if model.elasticity is None or not count or not model.elasticity.turns_ahead:
        return requests
    time, lead = model.scene.time, model.elasticity.node_lead[:, None] * state.velocity
    at_rest = np.zeros((len(state.rigid_position), 6))
    ahead = PosesAhead(state.position + lead, state.rigid_position, state.rigid_rotation)
    geometry.update(ahead, model.placed_pull_points(state))
    requests = replace(requests, lead_rate=geometry.rates(lead / time.stage, at_rest))
    if not len(requests.coordinates):
        return requests
    growth = geometry.values() - requests.start_values
    return requests.linearised(geometry, growth, requests.lead_rate, state, requests.first_impulse, time)


def _rows(
    model: Model, state: State, geometry: ActuatorGeometry, load: np.ndarray, with_rows: list[int]
) -> ActuatorRequests:
    """A row for each actuator's own coordinate, then one for each inner point of a cable that rubs.

    A row that follows a law has the law's tangent at the last effort, and no bounds.

    The pull of a cable is the sum of the bodies' deformation and its stretch; if it sticks at a point, the part beyond
    grows by its stretch alone.
    """
    actuators, step, theta = model.actuators, model.scene.time.step, model.scene.time.theta
    law_of = actuators.law(state)
    numbers, followed = [] if law_of is None else law_of[0].tolist(), None
    coordinates: list[np.ndarray] = []
    rates, bounds = [], []
    compliances: list[tuple[int, np.ndarray]] = []
    imposed, target = state.actuator_imposed, state.actuator_target
    now = actuators.sign * (geometry.value - actuators.rest_value)
    last = actuators.joined(state.actuator_effort, state.actuator_loss)
    if law_of is not None:  # its rows have a coordinate each, as all actuators with rows before them
        rows_before = np.cumsum([0, *(np.diff(actuators.first_coordinate)[with_rows])])
        rows = rows_before[np.searchsorted(with_rows, numbers)]
        followed = FollowedLaw.tangent(rows, law_of[1], last[actuators.first_coordinate[numbers]])
        compliances.append(followed.compliance(theta * step))
        at_zero = dict(zip(numbers, followed.at_zero.tolist(), strict=True))
    for actuator in with_rows:
        own = np.arange(*actuators.first_coordinate[actuator : actuator + 2])
        rate, rows = np.zeros(len(own)), np.tile(IMPOSED, (len(own), 1))
        compliance = actuators.compliance[actuator]
        if compliance.any():
            rate += compliance @ last[own] / step
            compliances.append((sum(len(before) for before in coordinates), compliance / step**2))
        rows[1:, GRIP] = geometry.grip[own[1:]]
        lowest, highest = actuators.effort_range[actuator].tolist()
        if actuator in numbers:
            reference = at_zero[actuator]
        elif imposed[actuator]:
            reference = target[actuator]
            rows[0, [LOWEST, HIGHEST]] = lowest * step, highest * step
        else:
            low, high = actuators.coordinate_range[actuator].tolist()
            reference = low if low > -UNLIMITED else high if high < UNLIMITED else now[actuator]
            rows[0, [LOWER_END, UPPER_END]] = (low - reference) / step, (high - reference) / step
            rows[0, PREFERRED] = target[actuator] * step
            # A stop holds without the limits of pump and motor; but a cable cannot push there either.
            rows[0, LOWEST] = actuators.effort_at_stop[actuator] * step
        rate[0] = (reference - now[actuator]) / (theta * (theta * step) if actuator in numbers else step)
        coordinates.append(own)
        rates.append(rate)
        bounds.append(rows)
    all_coordinates, mean_rate = np.concatenate(coordinates), np.concatenate(rates)
    requests = ActuatorRequests(
        load=load,
        coordinates=all_coordinates,
        target_rate=mean_rate,
        mean_rate=mean_rate,
        bounds=np.vstack(bounds),
        first_impulse=last[all_coordinates] * step,
        start_values=geometry.values(),
        lead_rate=np.zeros(len(load)),
        compliances=tuple(compliances),
        law=followed,
    )
    if theta == 1.0 or followed is None:
        return requests
    here = np.zeros(len(load))
    return requests.linearised(geometry, here, here, state, requests.first_impulse, model.scene.time)


# The arrays of a constraint problem, with spare capacity.

# Little spare capacity, because the arrays are large with several hundred contacts.
GROWTH = 1.25


class ConstraintRows:
    """Three rows per contact, one per actuator coordinate without a known load, and three per moment.

    Attributes:
        contact_capacity: largest number of contacts.
        contact_count, moment_count: numbers of contacts with rows, and of those with rows of moments.
        row_count: number of rows.
        actuators: the rows of the actuators.
        rows: bodies and nodes on which the rows act.
        compliance: W by rows [mm/s per mN s, likewise for volumes], shape (row_capacity^2,).
        columns: work space of the compliance.
        bounds: bounds of the actuator rows, see `contact/kernels/constraint_problem.py`, shape (actuator_capacity, 6).
        solver: contact solver, with the impulses and velocities of the rows.
    """

    def __init__(self, model: Model, contact_capacity: int):
        """Allocate rows for `contact_capacity` contacts and all actuators of the model."""
        actuator_capacity = model.actuators.count
        moments = model.rolling_friction.any() or model.spinning_friction.any()
        moment_capacity = contact_capacity if moments else 0
        row_capacity = 3 * contact_capacity + actuator_capacity + 3 * moment_capacity
        slots = 6 * model.surfaces.carriers.nodes.shape[1]
        self.contact_capacity = contact_capacity
        self.rows = Rows(
            size=np.zeros(3, dtype=np.int32),
            contact=np.empty(contact_capacity, dtype=np.int32),
            on_rigid=np.empty(contact_capacity, dtype=np.int32),
            on_rigid_count=np.zeros(1, dtype=np.int32),
            basis=np.empty((contact_capacity, 3, 3)),
            node=np.empty((contact_capacity, slots), dtype=np.int32),
            weight=np.empty((contact_capacity, slots)),
            rigid=np.empty((contact_capacity, 2), dtype=np.int32),
            rigid_jacobian=np.zeros((3 * contact_capacity, 2, 6)),
            friction=np.empty(contact_capacity),
            gap_rate=np.empty(contact_capacity),
            coordinate=np.empty(actuator_capacity, dtype=np.int32),
            target_rate=np.empty(actuator_capacity),
            moment_contact=np.empty(moment_capacity, dtype=np.int32),
            moment_length=np.empty((moment_capacity, 2)),
            free=np.empty(row_capacity),
        )
        self.compliance = np.empty(row_capacity**2)
        self.bounds = np.empty((actuator_capacity, BOUND_COLUMNS))
        self.solver = ContactSolver(
            Problem(
                self.rows.size,
                self.compliance,
                self.rows.free,
                self.rows.friction,
                self.bounds,
                self.rows.moment_contact,
                self.rows.moment_length,
            )
        )
        self.count_rows()
        self._acts_on_soft = model.elasticity is not None
        if model.elasticity is not None:
            symbolic, groups = model.elasticity.symbolic, -(-row_capacity // GROUP)
            self.columns = SparseColumns.with_room(groups, len(symbolic.tree.parent), 3 * len(symbolic.order))

    def count_rows(self) -> None:
        """Find how many rows there are of each kind, by `rows.size`."""
        contacts, actuators, moments = self.rows.size.tolist()
        self.contact_count, self.moment_count = contacts, moments
        self.row_count = 3 * (contacts + moments) + actuators
        self.actuators = slice(3 * contacts, 3 * contacts + actuators)

    def make_room_for_columns(self, entry_count: int) -> None:
        """Enlarge `columns.y` to at least `entry_count` entries; the old entries are lost."""
        if entry_count > len(self.columns.y):
            forget(self.columns)
            self.columns = self.columns._replace(y=np.empty((int(GROWTH * entry_count), GROUP)))

    def release(self) -> None:
        """Release the arrays from kernels before larger ones replace them."""
        forget(self.rows, *([self.columns] if self._acts_on_soft else []))
        self.solver.release()
