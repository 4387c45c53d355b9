"""Regular meshes of boxes, hollow spheres and tubes, whose deformations are known in closed form."""

from dataclasses import replace
from itertools import permutations

import numpy as np

from taichisoft.mesh import SIDES, VolumeMesh, divided_hexahedra, tetrahedron_volumes, with_middle_nodes

PRISM = np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])
"""Three tetrahedra in a prism with the ends 0, 1, 2 and 3, 4, 5, whose nodes must ascend."""


def hollow_sphere(inner: float, outer: float, parts: int, layers: int) -> VolumeMesh:
    """A sphere about the origin with radii in mm; the sides of an icosahedron are cut into so many parts.

    The inner surface is the group "cavity".
    """
    vertices, triangles = _icosphere(parts)
    radii = np.geomspace(inner, outer, layers + 1)
    nodes = (radii[:, None, None] * vertices).reshape(-1, 3)
    return _extruded("hollow sphere", nodes, triangles, len(vertices), layers, triangles)


def tube(inner: float, outer: float, length: float, around: int, layers: int, along: int) -> VolumeMesh:
    """A tube about the z axis from z = 0 on, with sizes in mm and numbers of cells; "cavity" is closed by flat lids."""
    angles = 2 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    z = np.linspace(0, length, along + 1)
    first = (np.arange(along)[:, None] * around + np.arange(around)).ravel()
    beside = (np.arange(along)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    wall = np.vstack(
        [np.column_stack([first, beside, beside + around]), np.column_stack([first, beside + around, first + around])]
    )
    radii = np.geomspace(inner, outer, layers + 1)
    shell = [np.column_stack([np.tile(r * ring, (along + 1, 1)), np.repeat(z, around)]) for r in radii]
    # Air to silicone is outward from the air: the lids face down at the bottom and up at the top.
    fan = np.column_stack([np.zeros(around - 2, dtype=int), np.arange(1, around - 1), np.arange(2, around)])
    lids = np.vstack([fan[:, ::-1], fan + along * around])
    return _extruded("tube", np.vstack(shell), wall, (along + 1) * around, layers, np.vstack([wall, lids]))


def rounded(mesh: VolumeMesh, axes: int) -> VolumeMesh:
    """The mesh of a sphere (3 axes) or tube (2) with ten nodes an element, whose sides bend as these do."""
    mesh = with_middle_nodes(mesh)
    radius = np.linalg.norm(mesh.nodes[:, :axes], axis=1)
    wanted = radius.copy()
    wanted[mesh.elements[:, 4:]] = radius[mesh.elements[:, SIDES]].mean(axis=2)
    nodes = mesh.nodes.copy()
    nodes[:, :axes] *= (wanted / radius)[:, None]
    return replace(mesh, nodes=nodes).check()


def bar(cells: tuple[int, int, int], size: tuple[float, float, float], element: str = "linear") -> VolumeMesh:
    """A box from the origin on, [mm], of boxes that are cut into six tetrahedra each, or are hexahedra."""
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    if element == "hexahedral":
        ends = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
        nodes = grid / cells * size
        return VolumeMesh("bar", nodes, divided_hexahedra(nodes, (corner[:, None] + ends) @ strides, "bar")).check()
    paths = [
        np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        for order in permutations(range(3))
    ]
    elements = ((corner[:, None, None, :] + np.array(paths)) @ strides).reshape(-1, 4)
    return _righted("bar", grid / cells * size, elements, {})


def _icosphere(parts: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere of outward triangles: the sides of an icosahedron are cut into so many parts."""
    from scipy.spatial import ConvexHull

    golden = (1 + 5**0.5) / 2
    corners = np.array([[s, t * golden, 0.0] for s in (-1, 1) for t in (-1, 1)])
    corners = np.vstack([corners, np.roll(corners, 1, axis=1), np.roll(corners, 2, axis=1)])
    shares = np.array([[i, j, parts - i - j] for i in range(parts + 1) for j in range(parts + 1 - i)]) / parts
    vertices = np.einsum("sc,tci->tsi", shares, corners[ConvexHull(corners).simplices]).reshape(-1, 3)
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    vertices = vertices[np.unique(np.round(vertices, 9), axis=0, return_index=True)[1]]
    triangles = ConvexHull(vertices).simplices
    outward = np.einsum("ti,ti->t", vertices[triangles[:, 0]], _normals(vertices, triangles)) > 0
    return vertices, np.where(outward[:, None], triangles, triangles[:, ::-1])


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    return np.cross(b - a, c - a)


def _extruded(
    name: str, nodes: np.ndarray, triangles: np.ndarray, stride: int, layers: int, cavity: np.ndarray
) -> VolumeMesh:
    """Layers over triangles, whose nodes are `stride` further on in each."""
    ascending = np.sort(triangles, axis=1)
    prisms = np.vstack([np.hstack([ascending, ascending + stride]) + stride * layer for layer in range(layers)])
    return _righted(name, nodes, prisms[:, PRISM].reshape(-1, 4), {"cavity": cavity})


def _righted(name: str, nodes: np.ndarray, elements: np.ndarray, groups: dict[str, np.ndarray]) -> VolumeMesh:
    inverted = tetrahedron_volumes(nodes, elements) < 0
    elements[inverted] = elements[inverted][:, [0, 2, 1, 3]]
    return VolumeMesh(name, nodes, elements, groups).check()
