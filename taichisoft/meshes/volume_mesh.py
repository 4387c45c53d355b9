"""A volume mesh as read from a file or made by a mesher, checked before anything is computed with it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.coordinates import refuse_coordinates
from taichisoft.meshes.hexahedra import divided_hexahedra
from taichisoft.meshes.ten_nodes import curved_volumes, least_volumes


@dataclass(frozen=True)
class VolumeMesh:
    """Nodes, elements and named groups.

    Attributes:
        source: file or mesher that made the mesh; errors begin with it.
        nodes: rest positions [mm], shape (node_count, 3).
        elements: node indices, shape (element_count, 4), or (element_count, 10) with nodes in the middles of the sides,
            or on a curved surface near them, see `ten_nodes.py`.
        surface_groups: named boundary triangles ("outer", "cavity", "base", ...), each (count, 3) node indices.
        element_groups: named sets of elements, each (count,) element indices.
    """

    source: str
    nodes: np.ndarray
    elements: np.ndarray
    surface_groups: dict[str, np.ndarray] = field(default_factory=dict)
    element_groups: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", np.ascontiguousarray(self.nodes, dtype=np.float64))
        object.__setattr__(self, "elements", np.ascontiguousarray(self.elements, dtype=np.int32))

    def check(self) -> "VolumeMesh":
        """Return the mesh itself when it is fit to simulate.

        Raises:
            MeshError: no elements, coordinates that are not finite or beyond all measure, indices out of range, unused
                nodes, flat, inverted or duplicate elements, or one that curved sides turn over.
        """
        if self.elements.size == 0:
            raise self._error("has no tetrahedra; a volume mesh (.vtk, .vtu, .msh) is needed, not a surface")
        refuse_coordinates(self.nodes, self.source, "node")
        outside = np.asarray((self.elements < 0) | (self.elements >= len(self.nodes)))
        _refuse(self, np.any(outside, axis=1), "element", f"has a node index outside 0..{len(self.nodes) - 1}")
        used = np.zeros(len(self.nodes), dtype=bool)
        used[self.elements] = True
        _refuse(self, ~used, "node", "belongs to no element; remove it or mesh again")
        _, first = np.unique(np.sort(self.elements, axis=1), axis=0, return_index=True)
        duplicate = np.ones(len(self.elements), dtype=bool)
        duplicate[first] = False
        _refuse(self, duplicate, "element", "stands twice in the mesh")
        volumes = tetrahedron_volumes(self.nodes, self.elements)
        flat = np.abs(volumes) <= 1e-12 * np.abs(volumes).max()
        _refuse(self, flat, "element", "has no volume")
        _refuse(self, volumes < 0, "element", "is inverted (its volume is negative); swap two of its nodes")
        if self.elements.shape[1] == 10:
            turned = least_volumes(self.nodes, self.elements) <= 1e-12 * volumes.max()
            _refuse(self, turned, "element", "is turned over by its curved sides; mesh more finely, or with order = 1")
        return self

    def _error(self, what: str) -> MeshError:
        return MeshError(f"{self.source}: {what}")


@dataclass(frozen=True)
class MeshContent:
    """Content of a mesh file of any format, before anything is checked.

    Attributes:
        nodes: positions [mm], shape (node_count, 3).
        tetrahedra: node indices, shape (element_count, 4), or (element_count, 10) in VTK's order.
        triangles: node indices, shape (triangle_count, 3); of one with six nodes, its four parts.
        element_groups: indices of tetrahedra by name, each (count,).
        surface_groups: indices of triangles by name, each (count,).
        others: number of cells with a volume that are no such tetrahedra, by meshio's name of their type.
        hexahedra, hexahedron_groups: node indices of hexahedra in VTK's order, shape (count, 8), and indices of these
            by name.
    """

    nodes: np.ndarray
    tetrahedra: np.ndarray
    triangles: np.ndarray
    element_groups: Mapping[str, np.ndarray]
    surface_groups: Mapping[str, np.ndarray]
    others: Mapping[str, int]
    hexahedra: np.ndarray = field(default_factory=lambda: np.zeros((0, 8), dtype=np.int64))
    hexahedron_groups: Mapping[str, np.ndarray] = field(default_factory=dict)

    def mesh(self, source: str) -> VolumeMesh:
        """The mesh, not checked yet; `source` begins its errors.

        Raises:
            MeshError: there are other cells with a volume than tetrahedra of four or ten nodes, or than hexahedra, or
                hexahedra that cannot be divided.
        """
        others = dict(self.others)
        if len(self.hexahedra) and (len(self.tetrahedra) or others):
            others["hexahedron"] = len(self.hexahedra)
        if others:
            found = ", ".join(f"{count} of {name}" for name, count in others.items())
            raise MeshError(
                f"{source}: has cells that are no tetrahedra ({found}); mesh again with tetrahedra, or hexahedra, only"
            )
        if len(self.hexahedra):
            tetrahedra = divided_hexahedra(self.nodes, self.hexahedra, source)
            groups = {
                name: (6 * group[:, None] + np.arange(6)).ravel() for name, group in self.hexahedron_groups.items()
            }
            alone = replace(self, tetrahedra=tetrahedra, element_groups=groups, hexahedra=self.hexahedra[:0])
            return alone.mesh(source)
        element_groups = {name: np.sort(group).astype(np.int32) for name, group in self.element_groups.items()}
        triangles = self.triangles.astype(np.int32)
        surface_groups = {name: triangles[group] for name, group in self.surface_groups.items()}
        return VolumeMesh(source, self.nodes, self.tetrahedra, surface_groups, element_groups)


def tetrahedron_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] of the tetrahedra spanned by each element's first four nodes, shape (element_count,)."""
    edges = nodes[elements[:, 1:4]] - nodes[elements[:, :1]]
    return np.linalg.det(edges) / 6.0


def element_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] of four-node or ten-node tetrahedra, these between their curved sides, (element_count,)."""
    return (curved_volumes if elements.shape[1] == 10 else tetrahedron_volumes)(nodes, elements)


def boundary_triangles(elements: np.ndarray) -> np.ndarray:
    """Faces that belong to one tetrahedron only, outward for positive elements, shape (count, 3) node indices.

    Of ten-node tetrahedra each is four triangles.
    """
    faces = elements[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[counts == 1])
    if elements.shape[1] == 4:
        return faces[outer]
    middles = elements[:, [[6, 5, 4], [4, 8, 7], [7, 9, 6], [5, 9, 8]]].reshape(-1, 3)
    return four_triangles(np.hstack([faces, middles])[outer])


def four_triangles(six_nodes: np.ndarray) -> np.ndarray:
    """Each six-node triangle as four of three nodes: (4 count, 3); nodes 3 to 5 are the middles of 01, 12, 20."""
    return six_nodes[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)


def _refuse(mesh: VolumeMesh, bad: np.ndarray, what: str, why: str) -> None:
    """Raise for the first flagged item, saying how many there are."""
    if bad.any():
        count = int(bad.sum())
        more = f" ({count} such {what}s)" if count > 1 else ""
        raise mesh._error(f"{what} {int(np.argmax(bad))} {why}{more}")
