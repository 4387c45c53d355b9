"""What actuators ask of a step: known loads, or rows of the constraint problem with their bounds."""

import numpy as np

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.bodies.limits import UNLIMITED
from taichisoft.bodies.surfaces import PosesAhead
from taichisoft.model import Model
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

NO_CABLES = np.zeros(0)
# Coordinates, target rates, bounds and first impulses.
NO_ROWS = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, BOUND_COLUMNS)), np.zeros(0)
# Bounds of a coordinate that is imposed, whatever it takes.
IMPOSED = np.zeros(BOUND_COLUMNS)
IMPOSED[[LOWEST, HIGHEST, GRIP]] = -UNLIMITED, UNLIMITED, -1.0


class ActuatorRows:
    """The actuators of a step.

    A pressure that is imposed is a known load, and so is the tension of a cable that nothing else limits. What is found
    together with the contacts has rows: a volume or a pull that is imposed, a cable that has stops, rubs, or runs over
    a rigid body.

    Attributes:
        load: known pressures [kPa] and tensions [mN], 0 for coordinates with rows, shape (coordinate_count,).
        coordinates: the coordinates that have rows, in order, shape (row_count,).
        target_rate: rate that the row's velocity is measured against [mm/s or mm^3/s], shape (row_count,).
        bounds: what the rows obey, see `solver/kernels/actuator_bounds.py`, shape (row_count, 6).
        first_impulse: where to start: the impulse of the last step [mN s, of a volume kPa s], shape (row_count,).
        start_values: of the coordinates at the start of the step [mm^3] and [mm], shape (coordinate_count,).
        lead_rate: how fast they grow along the way to where the geometry is ahead, shape (coordinate_count,).
        stretch: first row, and own compliance [mm/s per mN s], of each cable with rows that stretches.
    """

    def __init__(self, model: Model, geometry: ActuatorGeometry):
        """Make room for the actuators of `model`, whose `geometry` is that of the start of a step."""
        self._model, self._geometry, self._actuators = model, geometry, model.actuators
        self._time_step = model.scene.time.step
        self._cavity_count = len(model.cavities.names)
        self.load = np.zeros(model.actuators.count)

    def begin(self, state: State) -> None:
        """Find out what the state asks for."""
        actuators = self._actuators
        imposed = np.concatenate([state.cavity_volume_imposed, state.cable_pull_imposed])
        target = np.concatenate([state.cavity_target, state.cable_target])
        has_rows = imposed | actuators.always_has_rows
        self.load[actuators.first_coordinate[:-1]] = np.where(has_rows, 0.0, target)
        self.coordinates, self.target_rate, self.bounds, self.first_impulse = NO_ROWS
        self._mean_rate = self.target_rate
        self.stretch: list[tuple[int, np.ndarray]] = []
        if has_rows.any():
            self._make_rows(state, has_rows.nonzero()[0].tolist(), imposed, target)

    def look_ahead(self, state: State, node_lead: np.ndarray) -> None:
        """Take the geometry where bodies that are linearised ahead will be turned to, so that loads turn with them.

        Args:
            state: at the start of the step.
            node_lead: how far ahead along the velocities each node is taken [s], shape (node_count,).
        """
        self.start_values, self.lead_rate = self._geometry.values(), np.zeros(len(self.load))
        if not len(self.load) or not node_lead.any():
            return
        lead = node_lead[:, None] * state.velocity
        ahead = PosesAhead(state.position + lead, state.rigid_position, state.rigid_rotation)
        self._geometry.update(ahead, self._model.placed_pull_points(state))
        self.lead_rate = self._geometry.rates(lead / self._time_step, np.zeros((len(state.rigid_position), 6)))
        if len(self.coordinates):
            growth = self._geometry.values() - self.start_values
            self.linearise_again(growth, self.lead_rate, self.first_impulse)

    def linearise_again(self, growth: np.ndarray, rate: np.ndarray, impulse: np.ndarray) -> None:
        """Ask for the same where the geometry is now, with the impulses last found for a start.

        A row's target rate belongs to the mean rate of its coordinate in the step, (q - q0) / h, which is linear in the
        velocities around the present ones: (q' - q0) / h + dq/dx (v - v').

        Args:
            growth: q' - q0, of the coordinates from the start of the step to the present place, (coordinate_count,).
            rate: dq/dx v' of the velocities that lead there, shape (coordinate_count,).
            impulse: of the rows, shape (row_count,).
        """
        some = self.coordinates
        self.target_rate = self._mean_rate + (rate - growth / self._time_step)[some]
        rubs = self.bounds[:, GRIP] >= 0.0
        self.bounds[rubs, GRIP] = self._geometry.cables.grip[some[rubs] - self._cavity_count]
        self.first_impulse = impulse

    def efforts(self, impulse: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pressures [kPa], tensions [mN] and tensions lost to friction [mN] of all actuators, by the rows' impulses."""
        effort = self.load.copy()
        if not self._model.cables.names and not len(self.coordinates):
            return effort, NO_CABLES, NO_CABLES
        effort[self.coordinates] = impulse / self._time_step
        pressure, of_cables = np.split(effort, [self._cavity_count])
        first = self._model.cables.coordinate_start[:-1]
        return pressure, of_cables[first], np.delete(of_cables, first)

    def _make_rows(self, state: State, with_rows: list[int], imposed: np.ndarray, target: np.ndarray) -> None:
        """A row for each actuator's own coordinate, then one for each inner point of a cable that rubs.

        How far a cable is pulled in is what the bodies give way and what it stretches by; where it sticks at a point,
        the part beyond grows by its stretch alone.
        """
        actuators, step = self._actuators, self._time_step
        growth = state.cavity_volume - self._model.cavities.rest_volume
        now = np.concatenate([growth, self._model.cables.rest_length - self._geometry.cables.length])
        last = self._last_efforts(state)
        coordinates: list[np.ndarray] = []
        rates, bounds = [], []
        for actuator in with_rows:
            own = np.arange(*actuators.first_coordinate[actuator : actuator + 2])
            rate, rows = np.zeros(len(own)), np.tile(IMPOSED, (len(own), 1))
            stretch = actuators.stretch[actuator]
            if stretch is not None:
                if stretch.any():
                    rate += stretch @ last[own] / step
                    self.stretch.append((sum(len(before) for before in coordinates), stretch / step**2))
                rows[1:, GRIP] = self._geometry.cables.grip[own[1:] - self._cavity_count]
            lowest, highest = actuators.effort_range[actuator].tolist()
            if imposed[actuator]:
                reference = target[actuator]
                rows[0, [LOWEST, HIGHEST]] = lowest * step, highest * step
            else:
                low, high = actuators.coordinate_range[actuator].tolist()
                reference = low if low > -UNLIMITED else high if high < UNLIMITED else now[actuator]
                rows[0, [LOWER_END, UPPER_END]] = (low - reference) / step, (high - reference) / step
                rows[0, PREFERRED] = target[actuator] * step
                # What holds a coordinate at a stop is no pump and no motor; but a cable does not push there, either.
                rows[0, LOWEST] = lowest * step if stretch is not None else -UNLIMITED
            rate[0] = (reference - now[actuator]) / step
            coordinates.append(own)
            rates.append(rate)
            bounds.append(rows)
        self.coordinates, self.target_rate = np.concatenate(coordinates), np.concatenate(rates)
        self._mean_rate = self.target_rate
        self.bounds = np.vstack(bounds)
        self.first_impulse = last[self.coordinates] * step

    def _last_efforts(self, state: State) -> np.ndarray:
        """Pressures [kPa], and tensions with those lost [mN], in the last step, shape (coordinate_count,)."""
        cables = self._model.cables
        places = cables.coordinate_start[:-1] - np.arange(len(cables.names))
        of_cables = np.insert(state.cable_tension_loss, places, state.cable_tension)
        return np.concatenate([state.cavity_pressure, of_cables])
