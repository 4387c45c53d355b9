"""The air cavities of a model: their volumes, and how the volumes change with the nodes."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.soft_body import SoftBody
from taichisoft.kernels import cavities as kernels


class Cavities:
    """All cavities in one set of arrays.

    Attributes:
        names: "body.cavity", in order.
        rest_volume: [mm^3], shape (cavity_count,).
        entry_start: where each cavity's nodes stand in `entry_node` and `gradient`, shape (cavity_count + 1,).
        entry_node: the soft nodes that each cavity's volume depends on.
        gradient: dV/dx [mm^2] for each entry, shape (entry_count, 3).
    """

    def __init__(self, bodies: Sequence[SoftBody]):
        """Lay out the arrays."""
        found = [(body, cavity) for body in bodies for cavity in body.cavities]
        self.names = tuple(cavity.name for _, cavity in found)
        self.rest_volume = np.array([cavity.rest_volume for _, cavity in found])
        nodes, weights, triangles, entries, parts = [], [], [], [], []
        vertex_count = entry_count = 0
        for body, cavity in found:
            surface = cavity.surface
            global_nodes = surface.nodes + body.nodes.start
            used, place = np.unique(global_nodes, return_inverse=True)
            vertex = np.repeat(np.arange(len(global_nodes)) + vertex_count, global_nodes.shape[1])
            parts.append(np.column_stack([place.reshape(-1) + entry_count, vertex]))
            entries.append(used)
            nodes.append(global_nodes)
            weights.append(surface.weights)
            triangles.append(surface.triangles + vertex_count)
            vertex_count += len(global_nodes)
            entry_count += len(used)
        self.entry_start = np.cumsum([0, *(len(used) for used in entries)]).astype(np.int32)
        self.gradient = np.zeros((entry_count, 3))
        self.entry_node = np.concatenate([*entries, np.zeros(0)]).astype(np.int32)
        self._volume, self._flow = np.zeros(len(found)), np.zeros(len(found))
        self._entry_velocity = np.zeros((entry_count, 3))
        self._node_position = np.full((sum(len(body.rest_position) for body in bodies), 3), np.nan)
        if not found:
            return
        most = max(table.shape[1] for table in nodes)
        self._vertex_nodes = np.vstack([_padded(table, most) for table in nodes]).astype(np.int32)
        self._vertex_weights = np.vstack([_padded(table, most) for table in weights])
        self._triangle_start = np.cumsum([0, *(len(part) for part in triangles)]).astype(np.int32)
        self._triangles = np.vstack(triangles).astype(np.int32)
        self._position, self._area_vector = np.empty((vertex_count, 3)), np.empty((vertex_count, 3))
        all_parts = np.vstack(parts)
        by_entry = np.argsort(all_parts[:, 0], kind="stable")
        self._part_start = np.searchsorted(all_parts[by_entry, 0], np.arange(entry_count + 1)).astype(np.int32)
        self._part_vertex = all_parts[by_entry, 1].astype(np.int32)
        self._part_weight = np.concatenate([weight.reshape(-1) for weight in weights])[by_entry]

    def update(self, node_position: np.ndarray) -> None:
        """Fill `gradient` for node positions [mm], shape (node_count, 3)."""
        if not self.names or np.array_equal(node_position, self._node_position):
            return  # the volumes at the end of a step come with the gradients for the start of the next
        self._node_position[:] = node_position
        kernels.volumes_and_gradients(
            self._node_position,
            self._vertex_nodes,
            self._vertex_weights,
            self._triangle_start,
            self._triangles,
            self._part_start,
            self._part_vertex,
            self._part_weight,
            self._position,
            self._area_vector,
            self._volume,
            self.gradient,
        )

    def volumes(self, node_position: np.ndarray) -> np.ndarray:
        """Enclosed volumes [mm^3], shape (cavity_count,), for node positions [mm], shape (node_count, 3)."""
        self.update(node_position)
        return self._volume.copy()

    def flows(self, node_position: np.ndarray, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of change of the volumes [mm^3/s], shape (cavity_count,), at these positions and velocities (N, 3)."""
        if not self.names:
            return np.zeros(0)
        self.update(node_position)
        # mode="raise" would copy once more.
        np.take(node_velocity, self.entry_node, axis=0, out=self._entry_velocity, mode="clip")
        kernels.flows(self.entry_start, self.gradient, self._entry_velocity, self._flow)
        return self._flow.copy()


def _padded(table: np.ndarray, columns: int) -> np.ndarray:
    """Fill up with node 0 of weight 0."""
    return np.pad(table, ((0, 0), (0, columns - table.shape[1])))
