"""A volume mesh, checked before anything is computed with it; its orders, walls and hexahedra."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from taichisoft.errors import MeshError

# Limits of coordinates: finite, and not so large that products of lengths overflow.

LARGEST = 1e9
"""Largest coordinate [mm], a thousand kilometres: beyond 1e38 mm the quality of an element overflows."""


def refuse_coordinates(points: np.ndarray, source: object, what: str) -> None:
    """Raise MeshError for the first point with a coordinate that is not finite, or larger than LARGEST."""
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(points) <= LARGEST)
    if not wrong.any():
        return
    index = int(np.argmax(wrong.any(axis=1)))
    value = float(points[index][wrong[index]][0])
    problem = f"of {value:g} mm; {LARGEST:g} mm is the most" if np.isfinite(value) else "that is not finite"
    raise MeshError(f"{source}: {what} {index} has a coordinate {problem}")


# The ten-node tetrahedron, whose sides may be curved: its order of nodes, its slopes, its volume, its parts.

SIDES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
"""The corners between which the nodes 4 to 9 of a tetrahedron lie, in VTK's order."""

QUADRATURE_POINTS = np.full((4, 4), (5.0 - 5.0**0.5) / 20.0) + np.eye(4) * 5.0**-0.5
"""Four points that integrate quadratic functions over a tetrahedron exactly, as barycentric coordinates."""

CUBIC_POINTS = np.vstack([np.full(4, 1 / 4), np.full((4, 4), 1 / 6) + np.eye(4) / 3])
CUBIC_WEIGHTS = np.array([-4 / 5, 9 / 20, 9 / 20, 9 / 20, 9 / 20])
"""Points and weights that integrate cubic functions, such as the determinant of the Jacobian, exactly (Zienkiewicz)."""

NODES = np.vstack([np.eye(4), np.eye(4)[SIDES].mean(axis=1)])
"""Barycentric coordinates of the ten nodes."""


def slopes(points: np.ndarray) -> np.ndarray:
    """Slopes of the ten shape functions along the last three barycentric coordinates, shape (point_count, 10, 3).

    Points are given by their four barycentric coordinates.
    """
    first, second = SIDES.T
    unit = np.eye(4)
    at_corners = (4.0 * points - 1.0)[:, :, None] * unit
    at_middles = 4.0 * (points[:, first, None] * unit[second] + points[:, second, None] * unit[first])
    along_all = np.concatenate([at_corners, at_middles], axis=1)
    return np.asarray(along_all[..., 1:] - along_all[..., :1])


def jacobians(nodes: np.ndarray, elements: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Slopes of the positions [mm] along the last three barycentric coordinates, (element_count, point_count, 3, 3)."""
    return np.asarray(np.einsum("eai,qaj->eqij", nodes[elements], slopes(points)))


def curved_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Signed volumes [mm^3] between the curved sides, exact but for rounding, shape (element_count,)."""
    return np.asarray(np.linalg.det(jacobians(nodes, elements, CUBIC_POINTS)) @ CUBIC_WEIGHTS / 6.0)


def least_volumes(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """How near each element is to being turned over somewhere: not positive where it is [mm^3], (element_count,).

    The least determinant of the Jacobian, as the volume of a straight element that has it everywhere, at the nodes and
    at the points where strains are computed; or eight times the least volume of the eight parts of `linear_parts`, in
    which points are embedded. Both are the volume of an element with straight sides.
    """
    points = np.vstack([NODES, QUADRATURE_POINTS, CUBIC_POINTS])
    determinants = np.linalg.det(jacobians(nodes, elements, points))
    corners = nodes[linear_parts(elements)]
    parts = np.linalg.det(corners[:, 1:] - corners[:, :1]).reshape(-1, 8)
    return np.asarray(np.minimum(determinants.min(axis=1) / 6.0, 8.0 * parts.min(axis=1) / 6.0))


def linear_parts(elements: np.ndarray) -> np.ndarray:
    """Each ten-node tetrahedron as eight of four nodes, shape (8 element_count, 4); four-node ones as they are."""
    if elements.shape[1] == 4:
        return elements
    parts = [
        [0, 4, 6, 7],
        [4, 1, 5, 8],
        [6, 5, 2, 9],
        [7, 8, 9, 3],
        [4, 9, 5, 6],
        [4, 9, 6, 7],
        [4, 9, 7, 8],
        [4, 9, 8, 5],
    ]
    return elements[:, parts].reshape(-1, 4)


# Hexahedra as a volume mesh has them: each is six of its tetrahedra, one after another, around a diagonal.
#
# So all that works on tetrahedra (boundaries, points inside, groups, pictures, files) works on them; elements of eight
# nodes are found again by `hexahedra_of`. Corners are in VTK's order: around one face, then around the opposite one.

SIX_TETRAHEDRA = np.array([[0, 5, 1, 6], [0, 1, 3, 6], [1, 3, 6, 2], [6, 3, 0, 7], [6, 7, 0, 5], [7, 5, 4, 0]])
"""Corners of the six tetrahedra of a hexahedron."""
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
"""Corners of the six faces, facing outward."""
SIGNS = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
"""Corners of the cube with edges of 2 to which a hexahedron is mapped."""
OPPOSITE = [1, 0, 3, 2, 5, 4, 7, 6]
"""Corners with both ends of the first edges exchanged, which turns a hexahedron inside out."""
PLACES = [(0, 0), (0, 2), (2, 3), (1, 2), (5, 2), (0, 1), (0, 3), (3, 3)]
"""For each corner of a hexahedron: a tetrahedron that has it, and which of its nodes it is."""


def divided_hexahedra(nodes: np.ndarray, hexahedra: np.ndarray, source: str) -> np.ndarray:
    """Six positive tetrahedra for each hexahedron, shape (6 * count, 4).

    Args:
        nodes: positions [mm], shape (node_count, 3).
        hexahedra: node indices, shape (count, 8); inverted ones are turned.
        source: what errors begin with.

    Raises:
        MeshError: neighbours are numbered so that they are divided along different diagonals of a face, or a node index
            is not there.
    """
    if ((hexahedra < 0) | (hexahedra >= len(nodes))).any():
        raise MeshError(f"{source}: a hexahedron has a node index outside 0..{len(nodes) - 1}")
    edges = nodes[hexahedra[:, [1, 3, 4]]] - nodes[hexahedra[:, :1]]
    turned = np.where((np.linalg.det(edges) < 0.0)[:, None], hexahedra[:, OPPOSITE], hexahedra)
    tetrahedra: np.ndarray = turned[:, SIX_TETRAHEDRA].reshape(-1, 4)
    faces = np.sort(tetrahedra[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3), axis=1)
    outside = int((np.unique(faces, axis=0, return_counts=True)[1] == 1).sum())
    if outside != 2 * len(boundary_quads(turned)):
        raise MeshError(
            f"{source}: neighbouring hexahedra are divided along different diagonals of their faces; number the nodes "
            "of all hexahedra alike, as structured meshes have them, or mesh with tetrahedra"
        )
    return tetrahedra


def hexahedra_of(elements: np.ndarray) -> np.ndarray | None:
    """The hexahedra of which the tetrahedra (element_count, 4) of a mesh are parts, shape (count, 8), or None."""
    if len(elements) % 6 or elements.shape[1] != 4:
        return None
    six = elements.reshape(-1, 6, 4)
    found = np.column_stack([six[:, part, corner] for part, corner in PLACES])
    return found if (found[:, SIX_TETRAHEDRA] == six).all() else None


def boundary_quads(hexahedra: np.ndarray) -> np.ndarray:
    """Faces of hexahedra that belong to one of them alone, facing outward, shape (count, 4)."""
    quads = hexahedra[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True)
    return quads[np.sort(first[count == 1])]


# A volume mesh as read from a file or made by a mesher, checked before anything is computed with it.


@dataclass(frozen=True)
class VolumeMesh:
    """Nodes, elements and named groups.

    Attributes:
        source: file or mesher that made the mesh; errors begin with it.
        nodes: rest positions [mm], shape (node_count, 3).
        elements: node indices, shape (element_count, 4), or (element_count, 10) with nodes in the middles of the sides,
            or on a curved surface near them, in the order of VTK.
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
        """The mesh, not checked yet; `source` begins its errors."""
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


# Walls of one element, without a node inside, which are too stiff.

BENDS = {0.3: 0.78, 0.4: 0.73, 0.45: 0.62, 0.49: 0.41, 0.499: 0.31}
"""By Poisson's ratio, how far a bar of 60 x 5 x 5 mm of 12 x 1 x 1 cells of smoothed elements bends, over theory."""
GROWS = {0.3: 0.97, 0.4: 0.96, 0.45: 0.94, 0.49: 0.82, 0.499: 0.59}
"""The same of the growth of a sphere of 10 and 13 mm under pressure, 162 nodes on each side (Lame)."""
TOO_STIFF = (
    "walls of one element, too stiff where they bend: linear ones much, smoothed ones bend as little as 78, 62 and "
    "31 % of what is right at Poisson's ratios of 0.3, 0.45 and 0.499, and grow as little as 97, 94 and 59 %"
)
ADVICE = "try a smaller size, elements_across_walls = 2, or order = 2"


def too_stiff(poisson_ratio: float) -> str:
    """The most that smoothed elements make of such a wall at a Poisson's ratio, between those that were measured."""
    bends, grows = (np.interp(poisson_ratio, list(one), list(one.values())) for one in (BENDS, GROWS))
    return (
        f"walls of one element, which smoothed ones hold too stiff where they bend: at a Poisson's ratio of "
        f"{poisson_ratio:g} a bar of them alone bends as little as {bends:.0%} of what is right, and a thin sphere "
        f"grows as little as {grows:.0%}; `taichisoft converge` has the error of this body"
    )


def share_of_thin_walls(mesh: VolumeMesh, cavity: np.ndarray) -> float:
    """Share of a cavity's area that one element lies behind: each corner has an edge to a node of the outer surface."""
    corners = mesh.elements[:, :4]
    inside, outside, near = np.zeros((3, len(mesh.nodes)), dtype=bool)
    inside[cavity] = True
    outside[boundary_triangles(corners)] = True
    outside &= ~inside
    near[corners[outside[corners].any(axis=1)]] = True
    a, b, c = np.moveaxis(mesh.nodes[cavity], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(areas[near[cavity].all(axis=1)].sum() / areas.sum())


def share_without_nodes_inside(mesh: VolumeMesh) -> float:
    """Share of a body's volume in elements whose corners all lie on its surface."""
    corners = mesh.elements[:, :4]
    outside = np.zeros(len(mesh.nodes), dtype=bool)
    outside[boundary_triangles(corners)] = True
    volumes = np.abs(tetrahedron_volumes(mesh.nodes, corners))
    return float(volumes[outside[corners].all(axis=1)].sum() / volumes.sum())


# Meshes of ten-node tetrahedra: with nodes in the middles of the sides of four-node ones.


def with_middle_nodes(mesh: VolumeMesh) -> VolumeMesh:
    """The mesh with straight-sided ten-node tetrahedra, its own nodes first; a mesh that has them is returned as it is.

    Each triangle of a surface becomes four; of one with sides that no tetrahedron has, only the others are halved.
    """
    if mesh.elements.shape[1] == 10:
        return mesh
    node_count = len(mesh.nodes)
    sides = np.sort(mesh.elements[:, SIDES], axis=2).astype(np.int64)
    keys, side = np.unique(sides @ [node_count, 1], return_inverse=True)
    ends = np.column_stack(np.divmod(keys, node_count))

    def quartered(triangles: np.ndarray) -> np.ndarray:
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).astype(np.int64) @ [node_count, 1]
        place = np.minimum(np.searchsorted(keys, pairs), len(keys) - 1)
        middle = np.where(keys[place] == pairs, node_count + place, -1)
        whole = (middle >= 0).all(axis=1)
        parts = [four_triangles(np.hstack([triangles, middle])[whole])]
        parts += [_halved(three, its) for three, its in zip(triangles[~whole], middle[~whole], strict=True)]
        return np.vstack(parts).astype(np.int32)

    return VolumeMesh(
        mesh.source,
        np.vstack([mesh.nodes, mesh.nodes[ends].mean(axis=1)]),
        np.hstack([mesh.elements, node_count + side.reshape(-1, 6)]),
        {name: quartered(triangles) for name, triangles in mesh.surface_groups.items()},
        mesh.element_groups,
    )


def _halved(triangle: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """A triangle in parts: its sides 01, 12, 20 have nodes in the middle where `middle` is not -1, but not all."""
    whole = int(np.argmin(middle))  # the parts meet in a corner of a side that has none
    ring = [node for k in range(3) for node in (triangle[(whole + k) % 3], middle[(whole + k) % 3]) if node >= 0]
    return np.array([[ring[0], *ring[k : k + 2]] for k in range(1, len(ring) - 1)])
