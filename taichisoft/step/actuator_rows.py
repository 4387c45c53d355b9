"""What actuators ask of a step: known loads, or rows of the constraint problem with their bounds."""

import numpy as np

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.bodies.cables import UNLIMITED
from taichisoft.kernels.actuator_rows import BOUND_COLUMNS, GRIP, HIGHEST, LOWER_END, LOWEST, PREFERRED, UPPER_END
from taichisoft.model import Model
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
        bounds: what the rows obey, see `kernels/actuator_rows.py`, shape (row_count, 6).
        first_impulse: where to start: the impulse of the last step [mN s, of a volume kPa s], shape (row_count,).
        stretch: first row, and own compliance [mm/s per mN s], of each cable with rows that stretches.
    """

    def __init__(self, model: Model, geometry: ActuatorGeometry):
        """Make room for the actuators of `model`, whose `geometry` is that of the start of a step."""
        self._model, self._geometry = model, geometry
        self._time_step = model.scene.time.step
        self._cavity_count = len(model.cavities.names)
        cables = model.cables
        over_rigid = [len(bodies) > 0 for bodies in cables.rigid_entries]
        self._always_has_rows = (
            (np.abs(cables.pull_range) < UNLIMITED).any(axis=1)
            | (cables.paths.friction > 0.0)
            | np.array(over_rigid, dtype=bool)[cables.coordinate_start[:-1]]
        )
        self.load = np.zeros(model.actuators.count)

    def begin(self, state: State) -> None:
        """Find out what the state asks for."""
        np.multiply(state.cavity_target, ~state.cavity_volume_imposed, out=self.load[: self._cavity_count])
        self.coordinates, self.target_rate, self.bounds, self.first_impulse = NO_ROWS
        self.stretch: list[tuple[int, np.ndarray]] = []
        if state.cavity_volume_imposed.any():
            self._add_cavities(state)
        if self._model.cables.names:
            self._add_cables(state)

    def efforts(self, impulse: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pressures [kPa], tensions [mN] and tensions lost to friction [mN] of all actuators, by the rows' impulses."""
        effort = self.load.copy()
        if not self._model.cables.names and not len(self.coordinates):
            return effort, NO_CABLES, NO_CABLES
        effort[self.coordinates] = impulse / self._time_step
        pressure, of_cables = np.split(effort, [self._cavity_count])
        first = self._model.cables.coordinate_start[:-1]
        return pressure, of_cables[first], np.delete(of_cables, first)

    def _add_cavities(self, state: State) -> None:
        """Rows of the cavities whose volumes are imposed."""
        cavities = state.cavity_volume_imposed.nonzero()[0]
        missing = self._model.cavities.rest_volume + state.cavity_target - state.cavity_volume
        self.coordinates = cavities
        self.target_rate = missing[cavities] / self._time_step
        self.bounds = np.tile(IMPOSED, (len(cavities), 1))
        self.first_impulse = state.cavity_pressure[cavities] * self._time_step

    def _add_cables(self, state: State) -> None:
        """Rows of the cables: how far each is pulled in, then the inner points of one that rubs.

        How far a cable is pulled in is what the bodies give way and what it stretches by; where it sticks at a point,
        the part beyond grows by its stretch alone.
        """
        cables, step = self._model.cables, self._time_step
        pull = cables.rest_length - self._geometry.cables.length
        last = np.insert(
            state.cable_tension_loss, cables.coordinate_start[:-1] - np.arange(len(pull)), state.cable_tension
        )
        coordinates, rates, bounds = [self.coordinates], [self.target_rate], [self.bounds]
        row = len(self.coordinates)
        for cable, target in enumerate(state.cable_target.tolist()):
            own = np.arange(*cables.coordinate_start[cable : cable + 2])
            by_pull = bool(state.cable_pull_imposed[cable])
            self.load[self._cavity_count + own] = 0.0
            if not by_pull and not self._always_has_rows[cable]:
                self.load[self._cavity_count + own[0]] = target
                continue
            low, high = (target, target) if by_pull else cables.pull_range[cable].tolist()
            lowest, highest = cables.tension_range[cable].tolist()
            reference = low if low > -UNLIMITED else high if high < UNLIMITED else float(pull[cable])
            rows = np.tile(IMPOSED, (len(own), 1))
            rows[0, PREFERRED] = 0.0 if by_pull else target * step
            rows[0, LOWER_END], rows[0, UPPER_END] = (low - reference) / step, (high - reference) / step
            # What holds a cable at a stop is not its motor.
            rows[0, LOWEST], rows[0, HIGHEST] = lowest * step, (highest if by_pull else UNLIMITED) * step
            rows[1:, GRIP] = self._geometry.cables.grip[own[1:]]
            coordinates.append(self._cavity_count + own)
            rate = cables.stretch[cable] @ last[own] / step
            rate[0] = (reference - pull[cable]) / step
            if cables.stretch[cable].any():
                self.stretch.append((row, cables.stretch[cable] / step**2))
            rates.append(rate)
            bounds.append(rows)
            row += len(own)
        self.coordinates = np.concatenate(coordinates)
        self.target_rate = np.concatenate(rates)
        self.bounds = np.vstack(bounds)
        own = self.coordinates[len(self.first_impulse) :] - self._cavity_count
        self.first_impulse = np.concatenate([self.first_impulse, last[own] * step])
