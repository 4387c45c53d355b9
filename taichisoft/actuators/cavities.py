"""Air cavities, driven by their pressure or by how far their volume grows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.actuators.kind import ActuatorFigure, ActuatorKind, ActuatorSet, Drive, Room
from taichisoft.actuators.limits import limits
from taichisoft.bodies.body_geometry import Poses
from taichisoft.meshes import curved_walls
from taichisoft.meshes.surface import stacked

if TYPE_CHECKING:
    from taichisoft.bodies.rigid_body_arrays import Obstacle, RigidBody
    from taichisoft.bodies.soft_body_arrays import SoftBody

COLLAPSE_ADVICE = "less suction, or a lowest_volume_growth or lowest_pressure of the cavity"


class Cavities(ActuatorSet):
    """All cavities in one set of arrays.

    Attributes:
        surfaces, curved: what the kernels read; without cavities their arrays are empty.
    """

    def __init__(self, bodies: "Sequence[SoftBody]"):
        """Lay out the arrays."""
        from taichisoft.actuators.kernels import enclosed_volumes as kernels

        found = [(body, cavity) for body in bodies for cavity in body.cavities]
        settings = [body.settings.cavities[cavity.name.partition(".")[2]] for body, cavity in found]
        tables = [(cavity.walls.nodes + body.nodes.start, cavity.walls.weights) for body, cavity in found]
        triangles = [cavity.walls.triangles for _, cavity in found]
        entries, parts = [], []
        vertex_start = np.cumsum([0, *(len(nodes) for nodes, _ in tables)])
        entry_count = 0
        for (nodes, _), first_vertex in zip(tables, vertex_start[:-1], strict=True):
            used, place = np.unique(nodes, return_inverse=True)
            vertex = np.repeat(np.arange(len(nodes)) + first_vertex, nodes.shape[1])
            parts.append(np.column_stack([place.reshape(-1) + entry_count, vertex]))
            entries.append(used)
            entry_count += len(used)
        all_parts = np.vstack([np.zeros((0, 2), dtype=np.int64), *parts])
        by_entry = np.argsort(all_parts[:, 0], kind="stable")
        shifted = [part + first for part, first in zip(triangles, vertex_start[:-1], strict=True)]
        (flat_start, flat), (curved_start, curved) = (_of_corners(shifted, corners) for corners in (3, 6))
        part_start = np.searchsorted(all_parts[by_entry, 0], np.arange(entry_count + 1))
        part_weight = np.concatenate([np.zeros(0), *(weights.reshape(-1) for _, weights in tables)])[by_entry]
        self.surfaces = kernels.CavitySurfaces(
            vertex_nodes=stacked([nodes for nodes, _ in tables]).astype(np.int32),
            vertex_weights=stacked([weights for _, weights in tables]),
            origin=np.array([part[0, 0] for part in shifted], dtype=np.int32),
            triangle_start=flat_start,
            triangles=flat,
            part_start=part_start.astype(np.int32),
            part_vertex=all_parts[by_entry, 1].astype(np.int32),
            part_weight=part_weight,
        )
        super().__init__(
            names=[cavity.name for _, cavity in found],
            rest_value=np.array([cavity.rest_volume for _, cavity in found]),
            coordinate_range=np.array(
                [limits(one.lowest_volume_growth, one.highest_volume_growth) for one in settings]
            ),
            effort_range=np.array([limits(one.lowest_pressure, one.highest_pressure) for one in settings]),
            soft_entries=entries,
        )
        self.curved = kernels.CurvedTriangles(
            start=curved_start,
            vertices=curved,
            weighted_shape=curved_walls.WEIGHTS[:, None] * curved_walls.SHAPES,
            first_slope=np.ascontiguousarray(curved_walls.SLOPES[..., 0]),
            second_slope=np.ascontiguousarray(curved_walls.SLOPES[..., 1]),
        )

    def shapes(self, room: Room) -> "CavityVolumes":
        """What measures their volumes."""
        return CavityVolumes(self, room)

    def failure(self, value: np.ndarray) -> tuple[str, str, str] | None:
        """The first cavity with a volume [mm^3] of less than nothing: that of walls which have changed sides."""
        if value.min() > 0.0:
            return None
        name, volume = self.names[int(np.argmin(value))], value.min()
        cause = f"has a collapsed cavity: the walls of '{name}' went through each other ({volume:.3g} mm^3)"
        return name, cause, COLLAPSE_ADVICE


def _of_corners(parts: list[np.ndarray], corners: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the triangles with so many vertices of each cavity begin, and these triangles."""
    some = [part if part.shape[1] == corners else np.zeros((0, corners)) for part in parts]
    start = np.cumsum([0, *(len(part) for part in some)]).astype(np.int32)
    return start, np.vstack([np.zeros((0, corners)), *some]).astype(np.int32)


class CavityVolumes:
    """Volumes of the cavities, and how they change with the nodes, at present positions."""

    def __init__(self, cavities: Cavities, room: Room):
        """Take the arrays to write to."""
        from taichisoft.actuators.kernels import enclosed_volumes as kernels

        self._surfaces, self._curved, self._kernel = cavities.surfaces, cavities.curved, kernels.volumes_and_gradients
        vertex_count = len(cavities.surfaces.vertex_nodes)
        self._volumes = kernels.CavityVolumeArrays(
            position=np.empty((vertex_count, 3)),
            area_vector=np.empty((vertex_count, 3)),
            volume=room.value,
            gradient=room.soft,
        )
        self._measured: np.ndarray | None = None
        self._node_position = np.empty((room.node_count, 3))

    def update(self, poses: Poses, pull_point: np.ndarray) -> None:
        """Fill the volumes [mm^3] and gradients [mm^2] for node positions that stay as they are."""
        if poses.position is self._measured:
            return  # the volumes at the end of a step come with the gradients for the start of the next
        self._measured = poses.position
        self._node_position[:] = poses.position
        self._kernel(self._node_position, self._surfaces, self._curved, self._volumes)

    def coordinates(self) -> np.ndarray:
        """Volumes where they were last measured [mm^3], shape (cavity_count,)."""
        return self._volumes.volume


def _make(soft: "Sequence[SoftBody]", rigid: "Sequence[RigidBody]", obstacles: "Sequence[Obstacle]") -> Cavities:
    return Cavities(soft)


CAVITIES = ActuatorKind(
    name="cavity",
    plural="cavities",
    effort=Drive(
        "pressure",
        "kPa",
        observed="pressures",
        meaning="mean of all cavities",
        plotted="pressure [kPa]",
        metric="final",
        asked="pressure",
        rate="pressure_rate",
        step=1.0,
        furthest=150.0,
        more="raise the pressure",
        less="lower the pressure",
    ),
    coordinate=Drive("volume_growth", "mm^3", asked="volume_growth"),
    value=ActuatorFigure(
        "volume",
        "mm^3",
        observed="volumes",
        meaning="sum of all cavities",
        total=True,
        plotted="volume [cm³]",
        metric="final",
        plot_factor=1e-3,
    ),
    rate=ActuatorFigure(
        "flow",
        "mm^3/s",
        observed="flows",
        meaning="growth of the volume, sum of all cavities",
        total=True,
        recorded=False,
    ),
    imposed="volume_imposed",
    drawn="walls",
    always_driven=True,
    make=_make,
)
