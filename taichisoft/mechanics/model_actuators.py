"""The actuators of a model together: the coordinates of all kinds, and their gradients."""

from collections.abc import Sequence

import numpy as np

from taichisoft.mechanics.actuator_kind import (
    UNLIMITED,
    ActuatorBuffers,
    ActuatorKind,
    ActuatorNames,
    ActuatorShapes,
    CoordinateLaw,
    Drive,
)
from taichisoft.mechanics.body_geometry import Poses
from taichisoft.mechanics.cables import CABLES
from taichisoft.mechanics.cavities import CAVITIES
from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.rigid_body_arrays import Obstacle, RigidBody
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.mechanics.state import State
from taichisoft.scene.scene import Scene

# All kinds of actuators: their coordinates stand in this order in every array.

ACTUATOR_KINDS: tuple[ActuatorKind, ...] = (CAVITIES, CABLES)


def kind_called(name: str) -> ActuatorKind:
    """The kind of that name."""
    return next(kind for kind in ACTUATOR_KINDS if kind.name == name)


def kind_of(drive: Drive) -> ActuatorKind:
    """The kind whose actuators are driven so."""
    return next(kind for kind in ACTUATOR_KINDS if drive in (kind.effort, kind.coordinate, *kind.figures))


class Actuators(ActuatorNames):
    """What can be driven: the actuators of all kinds, in the order of the kinds. It never changes.

    Attributes:
        sets: the actuators of each kind, by the kind's name.
        coordinates: what the coordinates depend on.
        first_coordinate: number of each actuator's first coordinate, which is its own, and one past the last of all,
            shape (actuator_count + 1,).
        rest_value, rest_effort, sign, coordinate_range, effort_range, effort_at_stop, compliance, has_law: as of
            `ActuatorSet`, for all kinds; volumes [mm^3] and pressures [kPa], lengths [mm] and tensions [mN].
        always_has_rows: whether an actuator takes part in the constraint problem even where its effort is imposed,
            since it has stops, rubs, acts on a rigid body, or follows a law, shape (actuator_count,).
    """

    def __init__(
        self, scene: Scene, soft: Sequence[SoftBody], rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]
    ):
        """Find the actuators of a scene in its bodies, and lay out the arrays.

        Raises:
            MeshError, SceneError: an actuator does not fit its bodies.
        """
        self.sets = {kind.name: kind.make(scene, soft, rigid, obstacles) for kind in ACTUATOR_KINDS}
        sets = tuple(self.sets.values())
        soft_entries = [nodes for one in sets for nodes in one.soft_entries]
        rigid_entries = [bodies for one in sets for bodies in one.rigid_entries]
        self.coordinates = Coordinates(
            entry_start=_starts(soft_entries).astype(np.int32),
            entry_node=np.concatenate([np.zeros(0), *soft_entries]).astype(np.int32),
            rigid_start=_starts(rigid_entries).astype(np.int32),
            rigid_body=np.concatenate([np.zeros(0), *rigid_entries]).astype(np.int32),
        )
        self._tables = {kind.name: scene.actuators(kind.plural) for kind in ACTUATOR_KINDS}
        super().__init__({kind: found.names for kind, found in self.sets.items()})
        counts = np.concatenate([np.diff(one.coordinate_start) for one in sets])
        self.first_coordinate = np.cumsum([0, *counts])
        self.rest_value = np.concatenate([one.rest_value for one in sets])
        self.rest_effort = np.concatenate([one.rest_effort for one in sets])
        self.sign = np.concatenate([np.full(len(one.names), one.sign) for one in sets])
        self.coordinate_range = np.vstack([one.coordinate_range for one in sets])
        self.effort_range = np.vstack([one.effort_range for one in sets])
        self.effort_at_stop = np.concatenate([one.effort_at_stop for one in sets])
        self.compliance = tuple(compliance for one in sets for compliance in one.compliance)
        self._stretching = tuple(number for number, own in enumerate(self.compliance) if own.any())
        over_rigid = np.diff(self.coordinates.rigid_start)[self.first_coordinate[:-1]] > 0
        rubs = np.concatenate([one.rubs for one in sets])
        stops = (np.abs(self.coordinate_range) < UNLIMITED).any(axis=1)
        self.takes_effort = np.concatenate([one.takes_effort for one in sets])
        self.has_law = np.concatenate([one.has_law for one in sets])
        self.always_has_rows = stops | rubs | over_rigid | self.has_law
        self._has_laws = bool(self.has_law.any())
        present = [kind for kind in ACTUATOR_KINDS if self.names_of(kind)]
        self._present = [(self.sets[kind.name], self.place(kind)) for kind in present]
        self._further = np.setdiff1d(np.arange(self.count), self.first_coordinate[:-1])

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates.entry_start) - 1

    def driven_by(self, kind: ActuatorKind, drive: Drive) -> tuple[str, ...]:
        """The names of a kind's actuators that can be driven so."""
        return tuple(name for name, table in self._tables[kind.name].items() if drive.fits(table))

    def law(self, state: State) -> tuple[np.ndarray, CoordinateLaw] | None:
        """The law that actuators follow in the step from a state, and their numbers; only one kind has any."""
        if not self._has_laws:
            return None
        laws = ((self.place(kind).start, self.sets[kind.name].law(state)) for kind in ACTUATOR_KINDS)
        return next((first + law.numbers, law) for first, law in laws if law is not None)

    def start(self) -> dict[str, np.ndarray]:
        """Fields of the first state that belong to a kind of actuators alone."""
        return {name: values for one in self.sets.values() for name, values in one.start().items()}

    def after(self, start: State, effort: np.ndarray, value: np.ndarray, time_step: float) -> dict[str, np.ndarray]:
        """Fields of the state after a step [s] that belong to a kind of actuators alone, see `ActuatorSet.after`."""
        fields: dict[str, np.ndarray] = {}
        for actuators, place in self._present:
            fields |= actuators.after(start, effort[place], value[place], time_step)
        return fields

    def failure(self, value: np.ndarray) -> tuple[str, str, str] | None:
        """See `ActuatorSet.failure`; values of all actuators, shape (actuator_count,)."""
        failures = (actuators.failure(value[place]) for actuators, place in self._present)
        return next((failure for failure in failures if failure is not None), None)

    def losses_of(self, kind: ActuatorKind, losses: np.ndarray) -> np.ndarray:
        """The part of a kind in `State.actuator_loss`, (..., loss_count)."""
        place = self.place(kind)
        start = self.first_coordinate - np.arange(len(self.first_coordinate))
        return losses[..., start[place.start] : start[place.stop]]

    def split(self, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Efforts of all coordinates as those of actuators, (actuator_count,), and those lost further on,
        (loss_count,).
        """
        own = self.first_coordinate[:-1]
        return effort[own], effort[self._further]

    def joined(self, effort: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Efforts of all coordinates, (coordinate_count,), of what `split` gives."""
        own = self.first_coordinate[:-1]
        return np.insert(loss, own - np.arange(len(own)), effort)

    def own_coordinates(self, state: State) -> np.ndarray:
        """How far each actuator is driven [mm^3] or [mm]: what bodies give way and what it stretches by, by a state."""
        own: np.ndarray = self.sign * (state.actuator_value - self.rest_value)
        if self._stretching:
            efforts = self.joined(state.actuator_effort, state.actuator_loss)
            for number in self._stretching:
                some = slice(*self.first_coordinate[number : number + 2])
                own[number] += self.compliance[number][0] @ efforts[some]
        return own


def _starts(entries: Sequence[np.ndarray]) -> np.ndarray:
    return np.cumsum([0, *map(len, entries)])


class ActuatorGeometry:
    """Values of actuators and gradients of their coordinates at present positions.

    Attributes:
        value: volumes [mm^3] and lengths [mm] where they were last measured, shape (actuator_count,).
        gradient: of all coordinates.
        grip: of each coordinate, see `kernels/actuator_coordinates.py`; 0 where nothing rubs, (coordinate_count,).
    """

    def __init__(self, actuators: Actuators, node_count: int):
        self._coordinates = coordinates = actuators.coordinates
        starts = coordinates.entry_start, coordinates.rigid_start
        self._of_soft, self._of_rigid = (np.repeat(np.arange(actuators.count), np.diff(start)) for start in starts)
        self.gradient = Gradient(
            soft=np.zeros((len(coordinates.entry_node), 3)), rigid=np.zeros((len(coordinates.rigid_body), 6))
        )
        self.value = actuators.rest_value.copy()
        self.grip = np.zeros(actuators.count)
        self._shapes: list[ActuatorShapes] = []
        actuator, first = 0, 0
        for one in actuators.sets.values():
            last_actuator, last = actuator + len(one.names), first + int(one.coordinate_start[-1])
            if one.names:
                buffers = ActuatorBuffers(
                    first=first,
                    coordinates=coordinates,
                    gradient=self.gradient,
                    soft=self.gradient.soft[coordinates.entry_start[first] : coordinates.entry_start[last]],
                    grip=self.grip[first:last],
                    value=self.value[actuator:last_actuator],
                    node_count=node_count,
                )
                self._shapes.append(one.shapes(buffers))
            actuator, first = last_actuator, last

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill values and gradients for these bodies and pull points [mm], shape (cable_count, 3)."""
        for shapes in self._shapes:
            shapes.update(poses, pull_point)

    def values(self) -> np.ndarray:
        """The coordinates as last measured [mm^3] and [mm], but for constants, shape (coordinate_count,)."""
        return np.concatenate([np.zeros(0), *(shapes.coordinates() for shapes in self._shapes)])

    def steepness(self) -> np.ndarray:
        """Norms of the gradients last measured by the soft nodes, [mm^2] and [-], 1 where none, (coordinate_count,)."""
        squares = self._sums(self._of_soft, (self.gradient.soft**2).sum(axis=1))
        return np.where(squares > 0.0, np.sqrt(squares), 1.0)

    def rates(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> np.ndarray:
        """How fast the coordinates grow with velocities of nodes and rigid bodies, by the gradients last measured."""
        coordinates, gradient = self._coordinates, self.gradient
        of_soft = (gradient.soft * node_velocity[coordinates.entry_node]).sum(axis=1)
        of_rigid = (gradient.rigid * rigid_velocity[coordinates.rigid_body]).sum(axis=1)
        return self._sums(self._of_soft, of_soft) + self._sums(self._of_rigid, of_rigid)

    def _sums(self, coordinate: np.ndarray, entries: np.ndarray) -> np.ndarray:
        """Sums of entries by the coordinate of each, shape (coordinate_count,)."""
        return np.bincount(coordinate, entries, len(self.grip))
