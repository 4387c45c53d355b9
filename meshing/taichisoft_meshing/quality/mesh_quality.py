"""Figures of a mesh: of its elements, its surfaces and its walls."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.meshes import VolumeMesh, element_volumes
from taichisoft_meshing.quality.mesh_surfaces import SurfaceQuality, cavities_outside, measure_surfaces
from taichisoft_meshing.quality.tetrahedra import dihedral_angles, edge_lengths, neighbours, radius_ratios
from taichisoft_meshing.quality.walls import WallQuality, measure_walls


@dataclass(frozen=True)
class MeshQuality:
    """Figures of a mesh.

    Attributes:
        node_count: number of nodes.
        order: 1 for tetrahedra of four nodes, 2 for ten.
        volumes: signed volume of each element [mm^3], shape (element_count,).
        radius_ratios: radius ratio of each element [-], shape (element_count,); 1 for a regular one.
        dihedral_angles: angles between the faces of each element [degrees], shape (element_count, 6).
        edges: shortest and longest edge of each element [mm], shape (element_count, 2).
        duplicate_nodes: number of nodes at the position of another node.
        components: number of pieces of the mesh, in which elements are joined by faces.
        surfaces: figures of the outer skin, of every cavity, and of the other surface groups.
        outside: names of cavities that are not fully inside the outer skin.
        walls: figures of the walls between each two surfaces; empty when elements are inverted.
        longest_side: of the box around the body [mm].
    """

    node_count: int
    order: int
    volumes: np.ndarray
    radius_ratios: np.ndarray
    dihedral_angles: np.ndarray
    edges: np.ndarray
    duplicate_nodes: int
    components: int
    surfaces: tuple[SurfaceQuality, ...]
    outside: tuple[str, ...]
    walls: tuple[WallQuality, ...]
    longest_side: float

    @property
    def inverted(self) -> int:
        """Number of elements without a positive volume."""
        return int((self.volumes <= 0).sum())

    @property
    def elements_across_walls(self) -> int | None:
        """Number of elements across the thinnest-meshed wall of a cavity, or of the body when it has none, or None."""
        of_cavities = [wall for wall in self.walls if wall.of_cavity]
        return min((wall.elements_across for wall in of_cavities or self.walls), default=None)


def measure(mesh: VolumeMesh) -> MeshQuality:
    """Measure a mesh, which may be one that is not fit to simulate."""
    volumes = element_volumes(mesh.nodes, mesh.elements)
    surfaces = measure_surfaces(mesh)
    return MeshQuality(
        len(mesh.nodes),
        1 if mesh.elements.shape[1] == 4 else 2,
        volumes,
        radius_ratios(mesh.nodes, mesh.elements),
        dihedral_angles(mesh.nodes, mesh.elements),
        edge_lengths(mesh.nodes, mesh.elements),
        len(mesh.nodes) - len(np.unique(mesh.nodes, axis=0)),
        _component_count(mesh.elements),
        surfaces,
        cavities_outside(mesh.nodes, surfaces),
        measure_walls(mesh, surfaces) if (volumes > 0).all() else (),
        float(np.ptp(mesh.nodes, axis=0).max()),
    )


def _component_count(elements: np.ndarray) -> int:
    behind = neighbours(elements)
    element, face = np.nonzero(behind >= 0)
    graph = coo_matrix((np.ones(len(element)), (element, behind[element, face])), shape=(len(elements),) * 2)
    return int(connected_components(graph, directed=False)[0])
