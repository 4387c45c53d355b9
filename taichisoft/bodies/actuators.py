"""The actuators of a model together: coordinates of its cavities and cables, and their gradients."""

import numpy as np

from taichisoft.bodies.cables import Cables, CableShapes
from taichisoft.bodies.cavities import Cavities, CavityVolumes
from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.bodies.surfaces import Poses
from taichisoft.kernels.actuators import Coordinates, Gradient


class Actuators:
    """What can be driven: a coordinate for each cavity's volume, then those of the cables. It never changes.

    Attributes:
        cavities: the cavities of all soft bodies.
        cables: the cables of all soft bodies.
        coordinates: what the coordinates depend on.
        cable_coordinate: number of each cable's first coordinate, shape (cable_count,).
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
        self.cable_coordinate = len(cavities.names) + cables.coordinate_start[:-1]

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
        coordinates = actuators.coordinates
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

    def measure_cables(self, poses: Poses, pull_point: np.ndarray) -> np.ndarray:
        """Lengths of the cables [mm], shape (cable_count,)."""
        if self._cables.names:
            self._node_position[:] = poses.position
            turn = matrices_from_quaternions(poses.rigid_rotation)
            self.cables.update(self._node_position, poses.rigid_position.copy(), turn, pull_point)
        return self.cables.length.copy()
