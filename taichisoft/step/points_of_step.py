"""Where nodes and rigid bodies are in a step, copied once into arrays that all kernels of the step read."""

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.mechanics.state import State


class PointsOfStep:
    """Nodes, then centres of mass of the rigid bodies; a kernel is launched fastest with the arrays of the last step.

    Attributes:
        before, velocity: positions [mm] and velocities [mm/s] at the start, shape (point_count, 3).
        after: positions at the end [mm], shape (point_count, 3).
        node_before, node_velocity, node_after: the parts of the nodes, shape (node_count, 3).
    """

    def __init__(self, model: Model):
        shape, nodes = (model.node_count + len(model.rigid_bodies), 3), slice(0, model.node_count)
        self.before, self.velocity, self.after = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.node_before, self.node_velocity = self.before[nodes], self.velocity[nodes]
        self.node_after = self.after[nodes]
        self._rigid = slice(model.node_count, None)
        self._start: State | None = None
        self._end: np.ndarray | None = None

    def begin(self, state: State) -> None:
        """Hold the start of a step."""
        if state is not self._start:
            self._start = state
            self.node_before[:], self.before[self._rigid] = state.position, state.rigid_position
            self.node_velocity[:], self.velocity[self._rigid] = state.velocity, state.rigid_velocity

    def end(self, position: np.ndarray, rigid_position: np.ndarray | None = None) -> None:
        """Hold positions of the nodes that stay as they are [mm], shape (node_count, 3), and of rigid bodies."""
        if position is not self._end:
            self._end = position
            self.node_after[:] = position
        if rigid_position is not None:
            self.after[self._rigid] = rigid_position
