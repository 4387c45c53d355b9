"""The rows of a step's constraint problem: contacts, requests to actuators, and laws of their coordinates."""

import math
from collections.abc import Sequence
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
from taichisoft.contact.kernels.row_velocities import CONTACTS, MOMENTS, Rows
from taichisoft.contact.model import Model
from taichisoft.mechanics.actuator_kind import UNLIMITED, CoordinateLaw
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.kernels.sparse_columns import GROUP, SparseColumns
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.runtime.launch import forget
from taichisoft.scene.scene import Time

# Rows of actuators whose effort and coordinate follow a law of their own, such as the air in a cavity.
#
# A law gives the coordinate by the effort, and falls: the more air is pressed, the less space it takes. The bodies give
# the coordinate by the effort, too, and there it rises. The row of the constraint problem is the law's tangent, an own
# compliance as that of a stretchy cable, and where law and bodies meet is found by Newton's method: solve, take the
# tangent at the effort found, and solve again. Where a tangent leads out of the bracket of efforts known to be too low
# and too high, or hardly shrinks it, the chord between them takes its place, whose solution lies inside (as in Dekker's
# method for one unknown).

# Distance from the law at which a row follows it, over the scale of the coordinate, or over the effort: round-off.
FOLLOWS, EFFORT_FOLLOWS = 1e-11, 1e-13
# A tangent that leaves more than this share of a bracket gives way to the chord.
SHRINKS = 0.5
# Where an effort is too low for the law, the next tangent is so much of the last effort above the lowest.
NEARER = 0.1


@dataclass(frozen=True)
class FollowedLaw:
    """A law and the line that stands for it in a row of the constraint problem.

    Attributes:
        row: number of the row among the actuators'.
        law: the law.
        effort, coordinate, slope: a point of the line, and its slope.
        too_low, too_high: bracket of efforts.
        missed: distance between line and law where a line was last solved with, over the scale of the coordinate or of
            the effort.
        is_chord: whether the line is the chord of the bracket instead of a tangent.
    """

    row: int
    law: CoordinateLaw
    effort: float
    coordinate: float
    slope: float
    too_low: float = -math.inf
    too_high: float = math.inf
    missed: float = math.inf
    is_chord: bool = False

    @classmethod
    def tangent(cls, row: int, law: CoordinateLaw, effort: float) -> "FollowedLaw":
        """The law's tangent at an effort."""
        return cls(row, law, effort, *law.growth(effort))

    @property
    def holds(self) -> bool:
        """Whether the law holds where the line was last solved with."""
        return self.missed <= FOLLOWS

    @property
    def at_zero(self) -> float:
        """Coordinate of the line where the effort is 0."""
        return self.coordinate - self.slope * self.effort

    def moved(self, effort: float) -> "FollowedLaw":
        """The tangent at another effort; this line where the effort is too low for the law."""
        return self.tangent(self.row, self.law, float(effort)) if effort > self.law.lowest_effort else self

    def compliance(self, stage: float) -> np.ndarray:
        """The line as own compliance of the row, by impulses [mm^3/s per kPa s], shape (1, 1); see `Time.stage`."""
        return np.array([[-self.slope / stage**2]])

    def solved(self, effort: float) -> "FollowedLaw":
        """The line to go on with after the problem was solved with this one, and the row found an effort."""
        if not effort > self.law.lowest_effort:
            nearer = self.law.lowest_effort + NEARER * (self.effort - self.law.lowest_effort)
            return replace(self.tangent(self.row, self.law, nearer), too_high=self.too_high)
        coordinate, slope = self.law.growth(effort)
        above = self.coordinate + self.slope * (effort - self.effort) - coordinate
        # Where the coordinate changes fast with the effort, round-off of the effort is much of the coordinate.
        missed = abs(above) / max(self.law.scale, -EFFORT_FOLLOWS / FOLLOWS * slope * (effort - self.law.lowest_effort))
        if missed <= FOLLOWS:
            return replace(self, missed=missed)
        if self._is_outside(effort) and not self.is_chord:
            return replace(self._chord(), missed=missed)
        # What lies outside although a chord was solved with tells that other rows have moved the bracket.
        low, high = (-math.inf, math.inf) if self._is_outside(effort) else (self.too_low, self.too_high)
        low, high = (low, effort) if above > 0.0 else (effort, high)
        line = FollowedLaw(self.row, self.law, effort, coordinate, slope, low, high, missed)
        # Where a law is steepest, as that of a valve between equal pressures, tangents lead to and fro across it.
        is_slow = not self.is_chord and high - low > SHRINKS * (self.too_high - self.too_low)
        return line._chord() if is_slow and high - low < math.inf else line

    def _is_outside(self, effort: float) -> bool:
        """Whether an effort lies outside a bracket with two ends."""
        has_ends = -math.inf < self.too_low < self.too_high < math.inf
        return has_ends and not self.too_low < effort < self.too_high

    def _chord(self) -> "FollowedLaw":
        """The line through the law at both ends of the bracket."""
        (low, _), (high, _) = self.law.growth(self.too_low), self.law.growth(self.too_high)
        slope = (high - low) / (self.too_high - self.too_low)
        return replace(self, effort=self.too_low, coordinate=low, slope=slope, is_chord=True)


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
        compliances: first row and own compliance [mm/s per mN s] of each elastic cable with rows, and of each law.
        laws: laws that rows follow, with the lines that stand for them in `mean_rate` and `compliances`.
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
    laws: tuple[FollowedLaw, ...] = ()

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
        here = self.following([law.moved(impulse[law.row] / time.step) for law in self.laws], time)
        rows, bounds = self.coordinates, self.bounds.copy()
        rubs = bounds[:, GRIP] >= 0.0
        bounds[rubs, GRIP] = geometry.grip[rows[rubs]]
        if time.theta == 1.0:
            target_rate = here.mean_rate + (rate - growth / time.step)[rows]
        else:
            target_rate, own = here.mean_rate.copy(), [law.row for law in here.laws]
            rigid_velocity = np.hstack([start.rigid_velocity, start.rigid_angular_velocity])
            missing = rate - growth / time.stage
            missing -= (1.0 - time.theta) * geometry.rates(start.velocity, rigid_velocity)
            target_rate[own] += missing[rows[own]] / time.theta
        return replace(here, target_rate=target_rate, bounds=bounds, first_impulse=impulse)

    def following(self, laws: Sequence[FollowedLaw], time: Time) -> "ActuatorRequests":
        """The same requests with other lines for the laws, in the same order."""
        if not laws:
            return self
        mean_rate, target_rate, compliances = self.mean_rate.copy(), self.target_rate.copy(), dict(self.compliances)
        for before, law in zip(self.laws, laws, strict=True):
            change = (law.at_zero - before.at_zero) / (time.theta * time.stage)
            mean_rate[law.row] += change
            target_rate[law.row] += change
            compliances[law.row] = law.compliance(time.stage)
        return replace(
            self,
            mean_rate=mean_rate,
            target_rate=target_rate,
            compliances=tuple(compliances.items()),
            laws=tuple(laws),
        )

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
    all_laws, laws = actuators.laws(state, step), []
    coordinates: list[np.ndarray] = []
    rates, bounds = [], []
    compliances: list[tuple[int, np.ndarray]] = []
    imposed, target = state.actuator_imposed, state.actuator_target
    now = actuators.sign * (geometry.value - actuators.rest_value)
    last = actuators.joined(state.actuator_effort, state.actuator_loss)
    for actuator in with_rows:
        own = np.arange(*actuators.first_coordinate[actuator : actuator + 2])
        rate, rows = np.zeros(len(own)), np.tile(IMPOSED, (len(own), 1))
        compliance = actuators.compliance[actuator]
        if compliance.any():
            rate += compliance @ last[own] / step
            compliances.append((sum(len(before) for before in coordinates), compliance / step**2))
        rows[1:, GRIP] = geometry.grip[own[1:]]
        lowest, highest = actuators.effort_range[actuator].tolist()
        if actuator in all_laws:
            row = sum(len(before) for before in coordinates)
            laws.append(FollowedLaw.tangent(row, all_laws[actuator], float(last[own[0]])))
            compliances.append((row, laws[-1].compliance(theta * step)))
            reference = laws[-1].at_zero
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
        rate[0] = (reference - now[actuator]) / (theta * (theta * step) if actuator in all_laws else step)
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
        laws=tuple(laws),
    )
    if theta == 1.0 or not laws:
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
        self._acts_on_soft = model.elasticity is not None
        if model.elasticity is not None:
            symbolic, groups = model.elasticity.symbolic, -(-row_capacity // GROUP)
            self.columns = SparseColumns.with_room(groups, len(symbolic.tree.parent), 3 * len(symbolic.order))

    @property
    def contact_count(self) -> int:
        """Number of contacts with rows."""
        return int(self.rows.size[CONTACTS])

    @property
    def moment_count(self) -> int:
        """Number of contacts with rows of moments."""
        return int(self.rows.size[MOMENTS])

    @property
    def row_count(self) -> int:
        """Number of rows."""
        contacts, actuators, moments = self.rows.size.tolist()
        return 3 * (contacts + moments) + actuators

    @property
    def actuators(self) -> slice:
        """The rows of the actuators."""
        contacts, actuators, _ = self.rows.size.tolist()
        return slice(3 * contacts, 3 * contacts + actuators)

    def make_room_for_columns(self, entry_count: int) -> None:
        """Enlarge `columns.y` to at least `entry_count` entries; the old entries are lost."""
        if entry_count > len(self.columns.y):
            forget(self.columns)
            self.columns = self.columns._replace(y=np.empty((int(GROWTH * entry_count), GROUP)))

    def release(self) -> None:
        """Release the arrays from kernels before larger ones replace them."""
        forget(self.rows, *([self.columns] if self._acts_on_soft else []))
        self.solver.release()
