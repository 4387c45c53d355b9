"""The surfaces of a run in progress, and where they are in one of its states."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.bodies.rotations import matrices_from_quaternions
from taichisoft.meshes.surface import MappedSurface
from taichisoft_plugins.web.frame import Cast, PagePlane, PageSurface

if TYPE_CHECKING:
    from taichisoft.model import Model


@dataclass(frozen=True)
class LiveBodies:
    """What moves the surfaces of a cast; it goes to the process of the page, so it holds arrays and nothing else.

    Attributes:
        cast: who appears.
        soft: of the first surfaces, by nodes of all soft bodies.
        rigid: vertices [mm] of the next surfaces, in the frames of the rigid bodies.
        fixed: vertices [mm] of the last surfaces.
    """

    cast: Cast
    soft: tuple[MappedSurface, ...]
    rigid: tuple[np.ndarray, ...]
    fixed: tuple[np.ndarray, ...]

    def vertices(
        self, position: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Vertex positions [mm] of every surface, for arrays of a `State`."""
        rotation = matrices_from_quaternions(rigid_rotation)
        return (
            *(surface.positions(position) for surface in self.soft),
            *(own @ rotation[body].T + rigid_position[body] for body, own in enumerate(self.rigid)),
            *self.fixed,
        )


def live_bodies(model: "Model") -> LiveBodies:
    """The surfaces of a model."""
    soft: list[tuple[PageSurface, MappedSurface]] = []
    for body in model.soft_bodies:
        parts = [(body.name, "soft", body.surface), *((c.name, "cavity", c.surface) for c in body.cavities)]
        for name, kind, surface in parts:
            moved = MappedSurface(surface.nodes + body.nodes.start, surface.weights, surface.triangles)
            soft.append((PageSurface(name, kind, surface.triangles), moved))
    rigid = [(PageSurface(b.name, "rigid", b.triangles), b.vertices) for b in model.rigid_bodies]
    fixed = [
        (PageSurface(obstacle.name, "obstacle", obstacle.triangles), obstacle.vertices)
        for obstacle in model.obstacles
        if obstacle.vertices is not None and obstacle.triangles is not None
    ]
    planes = [
        PagePlane(obstacle.name, obstacle.point, obstacle.normal)
        for obstacle in model.obstacles
        if obstacle.point is not None and obstacle.normal is not None
    ]
    scene = model.scene
    names = [body.name for body in model.rigid_bodies]
    gripped = scene.goal.object if scene.goal is not None else names[0] if names else None
    gravity = np.array(scene.gravity)
    strength = np.linalg.norm(gravity)
    cast = Cast(
        title=scene.title,
        up=-gravity / strength if strength > 0.0 else np.array([0.0, 0.0, 1.0]),
        surfaces=tuple(surface for surface, _ in (*soft, *rigid, *fixed)),
        planes=tuple(planes),
        cavities=tuple(model.cavities.names),
        soft_bodies=tuple(body.name for body in model.soft_bodies),
        gripped=gripped,
        gripped_index=names.index(gripped) if gripped is not None else 0,
    )
    return LiveBodies(cast, *(tuple(moved for _, moved in part) for part in (soft, rigid, fixed)))  # type: ignore[arg-type]
