"""The air cavities of a model: their volumes, and how the volumes change with the nodes."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.kernels import enclosed_volumes as kernels
from taichisoft.bodies.limits import limits
from taichisoft.bodies.soft_body import SoftBody
from taichisoft.meshes import curved_walls
from taichisoft.meshes.surface import stacked


class Cavities:
    """All cavities in one set of arrays, which never change.

    Attributes:
        names: "body.cavity", in order.
        rest_volume: [mm^3], shape (cavity_count,).
        growth_range, pressure_range: smallest and largest [mm^3] and [kPa], shape (cavity_count, 2).
        surfaces, curved: what the kernels read; without cavities their arrays are empty.
    """

    def __init__(self, bodies: Sequence[SoftBody]):
        """Lay out the arrays."""
        found = [(body, cavity) for body in bodies for cavity in body.cavities]
        self.names = tuple(cavity.name for _, cavity in found)
        self.rest_volume = np.array([cavity.rest_volume for _, cavity in found])
        settings = [body.settings.cavities[cavity.name.partition(".")[2]] for body, cavity in found]
        self.growth_range, self.pressure_range = (
            np.array(
                [limits(getattr(one, f"lowest_{what}"), getattr(one, f"highest_{what}")) for one in settings]
            ).reshape(-1, 2)
            for what in ("volume_growth", "pressure")
        )
        tables = [(cavity.walls.nodes + body.nodes.start, cavity.walls.weights) for body, cavity in found]
        triangles = [cavity.walls.triangles for _, cavity in found]
        entries, parts = [], []
        vertex_start = np.cumsum([0, *(len(nodes) for nodes, _ in tables)])
        entry_start = [0]
        for (nodes, _), first_vertex in zip(tables, vertex_start[:-1], strict=True):
            used, place = np.unique(nodes, return_inverse=True)
            vertex = np.repeat(np.arange(len(nodes)) + first_vertex, nodes.shape[1])
            parts.append(np.column_stack([place.reshape(-1) + entry_start[-1], vertex]))
            entries.append(used)
            entry_start.append(entry_start[-1] + len(used))
        all_parts = np.vstack([np.zeros((0, 2), dtype=np.int64), *parts])
        by_entry = np.argsort(all_parts[:, 0], kind="stable")
        shifted = [part + first for part, first in zip(triangles, vertex_start[:-1], strict=True)]
        (flat_start, flat), (curved_start, curved) = (_of_corners(shifted, corners) for corners in (3, 6))
        part_start = np.searchsorted(all_parts[by_entry, 0], np.arange(entry_start[-1] + 1))
        part_weight = np.concatenate([np.zeros(0), *(weights.reshape(-1) for _, weights in tables)])[by_entry]
        self.surfaces = kernels.CavitySurfaces(
            vertex_nodes=stacked([nodes for nodes, _ in tables]).astype(np.int32),
            vertex_weights=stacked([weights for _, weights in tables]),
            origin=np.array([part[0, 0] for part in shifted], dtype=np.int32),
            triangle_start=flat_start,
            triangles=flat,
            entry_start=np.array(entry_start, dtype=np.int32),
            entry_node=np.concatenate([*entries, np.zeros(0)]).astype(np.int32),
            part_start=part_start.astype(np.int32),
            part_vertex=all_parts[by_entry, 1].astype(np.int32),
            part_weight=part_weight,
        )
        self.curved = kernels.CurvedTriangles(
            start=curved_start,
            vertices=curved,
            weighted_shape=curved_walls.WEIGHTS[:, None] * curved_walls.SHAPES,
            first_slope=np.ascontiguousarray(curved_walls.SLOPES[..., 0]),
            second_slope=np.ascontiguousarray(curved_walls.SLOPES[..., 1]),
        )


def _of_corners(parts: list[np.ndarray], corners: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the triangles with so many vertices of each cavity begin, and these triangles."""
    some = [part if part.shape[1] == corners else np.zeros((0, corners)) for part in parts]
    start = np.cumsum([0, *(len(part) for part in some)]).astype(np.int32)
    return start, np.vstack([np.zeros((0, corners)), *some]).astype(np.int32)


class CavityVolumes:
    """Volumes of the cavities, and how they change with the nodes, at present positions.

    Attributes:
        gradient: dV/dx [mm^2] for each entry of the cavities' surfaces, shape (entry_count, 3).
    """

    def __init__(self, cavities: Cavities, node_count: int, gradient: np.ndarray | None = None):
        """Make room; `gradient` is an array to use, of shape (entry_count, 3)."""
        self._surfaces = surfaces = cavities.surfaces
        self._curved = cavities.curved
        vertex_count, cavity_count = len(surfaces.vertex_nodes), len(cavities.names)
        self.gradient = np.zeros((len(surfaces.entry_node), 3)) if gradient is None else gradient
        self._volumes = kernels.CavityVolumes(
            position=np.empty((vertex_count, 3)),
            area_vector=np.empty((vertex_count, 3)),
            volume=np.zeros(cavity_count),
            gradient=self.gradient,
            flow=np.zeros(cavity_count),
        )
        self._measured: np.ndarray | None = None
        self._node_position, self._node_velocity = np.empty((node_count, 3)), np.empty((node_count, 3))

    def update(self, node_position: np.ndarray) -> None:
        """Fill `gradient` and the volumes for node positions [mm], shape (node_count, 3), that stay as they are."""
        if node_position is self._measured or not len(self._volumes.volume):
            return  # the volumes at the end of a step come with the gradients for the start of the next
        self._measured = node_position
        self._node_position[:] = node_position
        kernels.volumes_and_gradients(self._node_position, self._surfaces, self._curved, self._volumes)

    def volumes(self, node_position: np.ndarray) -> np.ndarray:
        """Enclosed volumes [mm^3], shape (cavity_count,), for node positions [mm] as in `update`."""
        self.update(node_position)
        return self._volumes.volume.copy()

    @property
    def measured(self) -> np.ndarray:
        """Volumes where they were last measured [mm^3], shape (cavity_count,)."""
        return self._volumes.volume

    def flows(self, node_position: np.ndarray, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of change of the volumes [mm^3/s], shape (cavity_count,), at these positions and velocities (N, 3)."""
        self.update(node_position)
        if len(self._volumes.flow):
            self._node_velocity[:] = node_velocity
            kernels.flows(self._node_velocity, self._surfaces, self._volumes)
        return self._volumes.flow.copy()
