"""The walls of a mesh by the surfaces between which they lie: how thick, and how many elements thick."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.quality.surfaces import OUTER, SurfaceQuality
from taichisoft_meshing.quality.wall_rays import Walls, find_walls

LEFT_OUT = 0.05
"""Share of a wall's area that may be fewer elements thick than is said [-]: an edge of the mesh that happens to lead
straight through a wall of two elements makes none of one."""


@dataclass(frozen=True)
class WallQuality:
    """Figures of all walls between two surfaces.

    Attributes:
        sides: names of the surfaces, a cavity first; both are the same where the outer skin faces itself.
        of_cavity: whether one side is a cavity.
        thinnest: smallest thickness [mm].
        elements_across: number of elements across 95 % of the area, at least; counted up to 5.
        share_of_one: share of the area that is one element thick [-].
    """

    sides: tuple[str, str]
    of_cavity: bool
    thinnest: float
    elements_across: int
    share_of_one: float

    @property
    def name(self) -> str:
        """The name for people: "cavity to outer"."""
        return " to ".join(self.sides)


def measure_walls(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality]) -> tuple[WallQuality, ...]:
    """Find the walls of a mesh of positive elements and sort them by their sides, cavities first."""
    walls = find_walls(mesh.nodes, mesh.elements)
    closed = [surface for surface in surfaces if surface.closed_by_name]
    closed.sort(key=lambda surface: surface.name == OUTER)
    side, opposite = (_surface_of(triangles, closed) for triangles in (walls.triangles, walls.opposite))
    found = []
    for first, surface in enumerate(closed):
        for second in range(first, len(closed)):
            here = ((side == first) & (opposite == second)) | ((side == second) & (opposite == first))
            if here.any():
                found.append(_measure(walls, here, (surface.name, closed[second].name), surface.of_cavity))
    return tuple(found)


def _measure(walls: Walls, here: np.ndarray, sides: tuple[str, str], of_cavity: bool) -> WallQuality:
    areas, across = walls.areas[here], walls.elements_across[here]
    thinner = np.array([areas[across <= count].sum() for count in range(across.max() + 1)]) / areas.sum()
    return WallQuality(
        sides, of_cavity, float(walls.thickness[here].min()), int(np.argmax(thinner > LEFT_OUT)), float(thinner[1])
    )


def _surface_of(triangles: np.ndarray, surfaces: Sequence[SurfaceQuality]) -> np.ndarray:
    """Index of the surface of each triangle, which has all three corners; -1 where no surface has them."""
    found = np.full(len(triangles), -1)
    for number, surface in enumerate(surfaces):
        found[np.isin(triangles, surface.triangles).all(axis=1)] = number
    return found
