"""The air cavities of a model: their volumes, and how the volumes change with the nodes."""

from collections.abc import Sequence

import numpy as np

from taichisoft.kernels import surfaces as kernels
from taichisoft.soft_body import SoftBody


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
        self._surfaces = list(zip(nodes, weights, strict=True))
        self._triangle_start = np.cumsum([0, *(len(part) for part in triangles)])
        if not found:
            self.entry_node, self.gradient = np.zeros(0, dtype=np.int32), np.zeros((0, 3))
            return
        self.entry_node = np.concatenate(entries).astype(np.int32)
        self.gradient = np.zeros((entry_count, 3))
        self._triangles = np.vstack(triangles).astype(np.int32)
        self._area_vector = np.zeros((vertex_count, 3))
        corners = self._triangles.reshape(-1)
        self._fan = np.argsort(corners, kind="stable").astype(np.int32)
        self._fan_start = np.searchsorted(corners[self._fan], np.arange(vertex_count + 1)).astype(np.int32)
        all_parts = np.vstack(parts)
        by_entry = np.argsort(all_parts[:, 0], kind="stable")
        self._part_start = np.searchsorted(all_parts[by_entry, 0], np.arange(entry_count + 1)).astype(np.int32)
        self._part_vertex = all_parts[by_entry, 1].astype(np.int32)
        self._part_weight = np.concatenate([weight.reshape(-1) for weight in weights])[by_entry]

    def update(self, node_position: np.ndarray) -> None:
        """Fill `gradient` for node positions [mm], shape (node_count, 3)."""
        if self.names:
            kernels.cavity_gradients(
                self._fan_start,
                self._fan,
                self._triangles,
                self._vertices(node_position),
                self._area_vector,
                self._part_start,
                self._part_vertex,
                self._part_weight,
                self.gradient,
            )

    def volumes(self, node_position: np.ndarray) -> np.ndarray:
        """Enclosed volumes [mm^3], shape (cavity_count,), for node positions [mm], shape (node_count, 3)."""
        if not self.names:
            return np.zeros(0)
        # Relative to the first vertex of its cavity, a large distance from the origin costs no digits.
        corners = self._vertices(node_position)[self._triangles]
        origin = corners[self._triangle_start[:-1], 0]
        corners = corners - np.repeat(origin, np.diff(self._triangle_start), axis=0)[:, None]
        parts = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        return np.add.reduceat(parts, self._triangle_start[:-1])

    def node_impulse(self, cavity_impulse: np.ndarray, node_count: int) -> np.ndarray:
        """Impulses on the nodes [mN s], shape (node_count, 3), of pressures times time [kPa s], (cavity_count,)."""
        result = np.zeros((node_count, 3))
        for cavity, impulse in enumerate(cavity_impulse):
            entries = slice(self.entry_start[cavity], self.entry_start[cavity + 1])
            result[self.entry_node[entries]] += impulse * self.gradient[entries]
        return result

    def _vertices(self, node_position: np.ndarray) -> np.ndarray:
        return np.vstack([np.einsum("vk,vkd->vd", weights, node_position[nodes]) for nodes, weights in self._surfaces])
