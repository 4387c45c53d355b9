"""The mesher of bodies between closed surfaces, which gmsh remeshes, or keeps triangle by triangle."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh
from taichisoft_meshing.bodies.closed_shells import Shell
from taichisoft_meshing.bodies.hollow_body import HollowBody
from taichisoft_meshing.bodies.meshed_body import compare_volumes, meshed_body
from taichisoft_meshing.bodies.size_growth import follow_curvature, set_sizes
from taichisoft_meshing.bodies.surface_geometry import NEAR, angles_between, area_vectors, diagonal, joined_sides
from taichisoft_meshing.bodies.tables import FittedSizes
from taichisoft_meshing.gmsh_session import SURFACE_ALGORITHMS, TRIANGLE, first_success, gmsh_session

KEPT_TOLERANCE = 1e-9
"""Largest error of a volume between the given surfaces, as a share of it [-]: only rounding may be missing."""

FLAT_TOLERANCE = 1e-6
"""Largest error of a volume between flat faces [-], whose corners have the rounding of single precision."""


def keep_surfaces(body: HollowBody, sizes: FittedSizes, source: str) -> VolumeMesh:
    """Fill a body and keep its surfaces: vertices of the outside, then of each cavity, are the first nodes.

    Args:
        body: body that is filled.
        sizes: sizes of its elements, of which only the largest has an effect.
        source: begins every error.

    Raises:
        MeshError: gmsh fails, or cannot fill it without changing a surface.
    """
    shells = (body.outer, *body.cavities)
    with gmsh_session(source) as gmsh:
        surfaces = _add_surfaces(gmsh.model, shells)
        _add_volume(gmsh.model, [[surface] for surface in surfaces])
        gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
        gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, [[surface] for surface in surfaces], source)
    given = np.vstack([shell.vertices for shell in shells])
    faces = sum(len(shell.triangles) for shell in shells)
    on_surfaces = sum(len(triangles) for triangles in mesh.surface_groups.values())
    if on_surfaces != faces or not np.array_equal(mesh.nodes[: len(given)], given):
        raise MeshError(f"{source}: gmsh cannot fill the body without changing its surface; remove keep_surface")
    compare_volumes(mesh, body.volume, [cavity.volume for cavity in body.cavities], KEPT_TOLERANCE)
    return mesh


def remesh_surfaces(body: HollowBody, sizes: FittedSizes, feature_angle: float, source: str) -> VolumeMesh:
    """Mesh a body with surface triangles of new sizes, which lie on the given ones.

    Args:
        body: body that is meshed.
        sizes: sizes of its elements.
        feature_angle: angle between two triangles above which their edge stays an edge [degrees].
        source: begins every error.

    Raises:
        MeshError: gmsh fails, or a volume comes out wrong.
    """
    angle = math.radians(feature_angle)
    flat = all(_flat_faced(shell, angle) for shell in (body.outer, *body.cavities))
    # gmsh cuts surfaces in parts that it can unroll, which flat faces need not be; the cuts stay edges of the mesh.
    ways = [(False, algorithm) for algorithm in SURFACE_ALGORITHMS[:1] if flat]
    ways += [(True, algorithm) for algorithm in SURFACE_ALGORITHMS]

    def make(gmsh: Any, way: tuple[bool, int]) -> VolumeMesh:
        cut, algorithm = way
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        return _remesh(gmsh, body, sizes, angle, cut, flat, source)

    return first_success(source, ways, make)


def _remesh(
    gmsh: Any, body: HollowBody, sizes: FittedSizes, angle: float, cut: bool, flat: bool, source: str
) -> VolumeMesh:
    shells = (body.outer, *body.cavities)
    surfaces = _classify(gmsh.model, shells, angle, cut)
    gmsh.option.setNumber("Mesh.MinimumCurveNodes", 1 if flat else 3)
    set_sizes(gmsh, sizes, [surface for wall in surfaces[1:] for surface in wall])
    follow_curvature(gmsh, sizes, [] if flat else shells, angle)
    gmsh.model.mesh.generate(3)
    mesh = meshed_body(gmsh, surfaces, source)
    compare_volumes(mesh, body.volume, [cavity.volume for cavity in body.cavities], FLAT_TOLERANCE if flat else None)
    return mesh


def _add_surfaces(model: Any, shells: Sequence[Shell]) -> list[int]:
    """Give gmsh each shell as a surface of triangles."""
    surfaces, first_node, first_triangle = [], 1, 1
    for shell in shells:
        surface = model.addDiscreteEntity(2)
        node_tags = np.arange(first_node, first_node + len(shell.vertices))
        triangle_tags = np.arange(first_triangle, first_triangle + len(shell.triangles))
        model.mesh.addNodes(2, surface, node_tags, shell.vertices.ravel())
        model.mesh.addElementsByType(surface, TRIANGLE, triangle_tags, (shell.triangles + first_node).ravel())
        surfaces.append(surface)
        first_node += len(node_tags)
        first_triangle += len(triangle_tags)
    return surfaces


def _add_volume(model: Any, shells: Sequence[Sequence[int]]) -> None:
    model.geo.addVolume([model.geo.addSurfaceLoop(list(shell)) for shell in shells])
    model.geo.synchronize()


def _classify(model: Any, shells: Sequence[Shell], angle: float, cut: bool) -> list[list[int]]:
    """Part the shells into faces at sharp edges, and make geometry of them; gmsh's surfaces of each shell."""
    _add_surfaces(model, shells)
    model.mesh.classifySurfaces(angle, True, cut, math.pi)
    model.mesh.createGeometry()
    last_nodes = np.cumsum([len(shell.vertices) for shell in shells])
    surfaces: list[list[int]] = [[] for _ in shells]
    for _, surface in model.getEntities(2):
        node = model.mesh.getElementsByType(TRIANGLE, surface)[1][0]
        surfaces[int(np.searchsorted(last_nodes, node))].append(surface)
    _add_volume(model, surfaces)
    return surfaces


def _flat_faced(shell: Shell, angle: float) -> bool:
    """Whether all faces between sharp edges are flat."""
    corners = shell.vertices[shell.triangles]
    normals = area_vectors(corners)
    neighbours = joined_sides(shell.triangles)[1] // 3
    smooth = neighbours[angles_between(normals, neighbours) < angle]
    graph = coo_matrix((np.ones(len(smooth)), smooth.T), shape=(len(normals), len(normals)))
    count, face = connected_components(graph, directed=False)
    mean_normal = np.column_stack([np.bincount(face, normals[:, axis], count) for axis in range(3)])
    lengths = np.linalg.norm(mean_normal, axis=1, keepdims=True)
    if (lengths == 0).any():
        return False
    mean_normal = mean_normal / lengths
    middles = np.einsum("tcd,td->t", corners, mean_normal[face]) / 3
    offset = np.bincount(face, middles, count) / np.bincount(face, minlength=count)
    heights = np.einsum("tcd,td->tc", corners, mean_normal[face]) - offset[face, None]
    return bool((np.abs(heights) <= 10 * NEAR * diagonal(shell.vertices)).all())
