"""Actuators in a step: known loads, or rows of the constraint problem with their bounds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.actuators.finite_limits import UNLIMITED
from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.bodies.body_geometry import PosesAhead
from taichisoft.model import Model
from taichisoft.scenes.time_stepping import Time
from taichisoft.solver.coordinate_laws import FollowedLaw
from taichisoft.solver.kernels.actuator_bounds import (
    BOUND_COLUMNS,
    GRIP,
    HIGHEST,
    LOWER_END,
    LOWEST,
    PREFERRED,
    UPPER_END,
)
from taichisoft.state import State

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
        bounds: bounds of the rows, see `solver/kernels/actuator_bounds.py`, shape (row_count, 6).
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
    if has_rows.any():
        requests = _rows(model, state, geometry, load, has_rows.nonzero()[0].tolist())
    else:
        requests = ActuatorRequests(load, *NO_ROWS, geometry.values(), np.zeros(count), ())
    if model.elasticity is None or not count or not model.elasticity.node_lead.any():
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
