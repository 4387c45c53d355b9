"""The actuators of a model together: coordinates of its cavities and cables, and their gradients."""

import numpy as np

from taichisoft.bodies.cables import Cables, CableShapes
from taichisoft.bodies.cavities import Cavities, CavityVolumes
from taichisoft.bodies.kernels.coordinate_gradients import Coordinates, Gradient
from taichisoft.bodies.limits import UNLIMITED
from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.bodies.surfaces import Poses


class Actuators:
    """What can be driven: a coordinate for each cavity's volume, then those of the cables. It never changes.

    Attributes:
        cavities: the cavities of all soft bodies.
        cables: the cables of all soft bodies.
        coordinates: what the coordinates depend on.
        first_coordinate: number of each actuator's first coordinate, cavities before cables, and one past the last,
            shape (actuator_count + 1,).
        coordinate_range: volume growth [mm^3] or pull [mm] between an actuator's stops, shape (actuator_count, 2).
        effort_range: smallest and largest pressure [kPa] or tension [mN], shape (actuator_count, 2).
        stretch: of each cable, see `Cable`; None for a cavity.
        always_has_rows: whether an actuator takes part in the constraint problem even where its effort is imposed,
            since it has stops, rubs, or acts on a rigid body, shape (actuator_count,).
    """

    def __init__(self, cavities: Cavities, cables: Cables):
        """Lay out the arrays."""
        self.cavities, self.cables = cavities, cables
        walls = cavities.surfaces
        soft = [walls.entry_node, *cables.soft_entries]
        entry_counts = [*np.diff(walls.entry_start), *(len(nodes) for nodes in cables.soft_entries)]
        rigid_counts = [0] * len(cavities.names) + [len(bodies) for bodies in cables.rigid_entries]
        self.coordinates = Coordinates(
            entry_start=np.cumsum([0, *entry_counts]).astype(np.int32),
            entry_node=np.concatenate(soft).astype(np.int32),
            rigid_start=np.cumsum([0, *rigid_counts]).astype(np.int32),
            rigid_body=np.concatenate([np.zeros(0), *cables.rigid_entries]).astype(np.int32),
        )
        count = len(cavities.names)
        self.first_coordinate = np.concatenate([np.arange(count), count + cables.coordinate_start])
        self.coordinate_range = np.vstack([cavities.growth_range, cables.pull_range])
        self.effort_range = np.vstack([cavities.pressure_range, cables.tension_range])
        self.stretch = [*[None] * count, *cables.stretch]
        over_rigid = np.diff(self.coordinates.rigid_start)[self.first_coordinate[:-1]] > 0
        rubs = np.concatenate([np.zeros(count), cables.paths.friction]) > 0.0
        stops = (np.abs(self.coordinate_range) < UNLIMITED).any(axis=1)
        self.always_has_rows = stops | rubs | over_rigid

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates.entry_start) - 1


class ActuatorGeometry:
    """Volumes, lengths and their gradients at present positions.

    Attributes:
        volumes: of the cavities.
        cables: the cables' shapes.
        gradient: of all coordinates.
    """

    def __init__(self, actuators: Actuators, node_count: int):
        """Make room."""
        self._coordinates = coordinates = actuators.coordinates
        self.gradient = Gradient(
            soft=np.zeros((len(coordinates.entry_node), 3)), rigid=np.zeros((len(coordinates.rigid_body), 6))
        )
        walls = actuators.cavities.surfaces
        self.volumes = CavityVolumes(actuators.cavities, node_count, self.gradient.soft[: len(walls.entry_node)])
        cavity_count = len(actuators.cavities.names)
        self.cables = CableShapes(actuators.cables, cavity_count, coordinates, self.gradient)
        self._cables = actuators.cables
        self._node_position = np.empty((node_count, 3))

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill volumes, lengths and gradients for these bodies and pull points [mm], shape (cable_count, 3)."""
        self.volumes.update(poses.position)
        self.measure_cables(poses, pull_point)

    def values(self) -> np.ndarray:
        """The coordinates as last measured [mm^3] and [mm], but for constants of the cables, (coordinate_count,)."""
        if not self._cables.names:
            return self.volumes.measured.copy()
        return np.concatenate([self.volumes.measured, self.cables.coordinates()])

    def steepness(self) -> np.ndarray:
        """Norms of the gradients last measured by the soft nodes, [mm^2] and [-], 1 where none, (coordinate_count,)."""
        squares = self._sums(self._coordinates.entry_start, (self.gradient.soft**2).sum(axis=1))
        return np.where(squares > 0.0, np.sqrt(squares), 1.0)

    def rates(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> np.ndarray:
        """How fast the coordinates grow with these velocities, by the gradients last measured.

        Args:
            node_velocity: [mm/s], shape (node_count, 3).
            rigid_velocity: linear [mm/s] and angular [rad/s], shape (rigid_count, 6).
        """
        coordinates, gradient = self._coordinates, self.gradient
        of_soft = (gradient.soft * node_velocity[coordinates.entry_node]).sum(axis=1)
        of_rigid = (gradient.rigid * rigid_velocity[coordinates.rigid_body]).sum(axis=1)
        return self._sums(coordinates.entry_start, of_soft) + self._sums(coordinates.rigid_start, of_rigid)

    def _sums(self, start: np.ndarray, entries: np.ndarray) -> np.ndarray:
        """Sums of the entries of each coordinate, shape (coordinate_count,)."""
        count = len(start) - 1
        return np.bincount(np.repeat(np.arange(count), np.diff(start)), entries, count)

    def measure_cables(self, poses: Poses, pull_point: np.ndarray) -> np.ndarray:
        """Lengths of the cables [mm], shape (cable_count,)."""
        if self._cables.names:
            self._node_position[:] = poses.position
            turn = matrices_from_quaternions(poses.rigid_rotation)
            self.cables.update(self._node_position, poses.rigid_position.copy(), turn, pull_point)
        return self.cables.length.copy()
