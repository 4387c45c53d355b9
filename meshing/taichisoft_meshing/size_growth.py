"""Element sizes that grow with the distance from the cavities, and are smaller where surfaces are curved."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles
from taichisoft_meshing.body_tables import FittedSizes
from taichisoft_meshing.closed_shells import Shell, angles_between, area_vectors, joined_sides, undirected_sides
from taichisoft_meshing.gmsh_session import obey_size_fields, tetrahedra
from taichisoft_meshing.size_search import GROWTH, refuse_too_many
from taichisoft_meshing.wall_quality import find_walls

FINEST = 0.25
"""Least size on curves, such as that of a tiny fillet, over the smallest size that was asked for [-]."""
USUAL = 16
"""Edges around a full turn; where more are asked for, the least size is smaller in proportion."""

SAMPLES = 20  # points along each curve and surface, to which distances are measured


def set_sizes(gmsh: Any, sizes: FittedSizes, cavity_surfaces: Sequence[int]) -> None:
    """Tell gmsh the sizes; `cavity_surfaces` are gmsh's numbers of the surfaces of the cavities."""
    largest, smallest = sizes.largest, sizes.smallest
    gmsh.option.setNumber("Mesh.MeshSizeMax", largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", _finest(sizes))
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", sizes.curvature)
    if smallest < largest and cavity_surfaces:
        field = gmsh.model.mesh.field
        distance, growing = field.add("Distance"), field.add("Threshold")
        field.setNumbers(distance, "SurfacesList", list(cavity_surfaces))
        field.setNumber(distance, "Sampling", SAMPLES)
        field.setNumber(growing, "InField", distance)
        for option, value in (
            ("SizeMin", smallest),
            ("SizeMax", largest),
            ("DistMin", 0.0),
            ("DistMax", (largest - smallest) / GROWTH),
        ):
            field.setNumber(growing, option, value)
        obey_size_fields(gmsh)


def follow_curvature(gmsh: Any, sizes: FittedSizes, shells: Sequence[Shell], feature_angle: float) -> None:
    """Set smaller sizes where given triangles are curved, in place of gmsh's own: it finds unrolled flat ones curved.

    Args:
        gmsh: the module, after `set_sizes`.
        sizes: sizes of its elements.
        shells: the given triangles; none when all of them are flat.
        feature_angle: angle between two triangles above which their edge is sharp, not part of a curved surface [rad].
    """
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 0)
    if sizes.curvature == 0 or not shells:
        return
    rows = []
    for shell in shells:
        curvatures = vertex_curvatures(shell.vertices, shell.triangles, feature_angle)
        with np.errstate(divide="ignore"):
            wanted = np.minimum(2 * math.pi / (sizes.curvature * curvatures), sizes.largest)
        rows.append(_size_rows(wanted, shell.vertices, shell.triangles))
    _add_sizes(gmsh, np.vstack(rows))


def follow_walls(gmsh: Any, sizes: FittedSizes, ratio: float, source: str) -> None:
    """Clear the mesh of a session, and set sizes in proportion to the thickness of the walls that were found in it.

    Args:
        gmsh: the module, after `set_sizes`, with a mesh.
        sizes: sizes of its elements.
        ratio: longest edge in a wall over the wall's thickness [-].
        source: begins every error.
    """
    nodes, elements, _ = tetrahedra(gmsh)
    walls = find_walls(nodes, elements)
    size = np.minimum(ratio * walls.thickness, sizes.largest)
    wanted = np.full(len(nodes), sizes.largest)
    np.minimum.at(wanted, walls.triangles, size[:, None])
    count = float((8.5 * walls.areas * walls.thickness / 2 / size**3).sum())  # a wall is seen from both sides
    try:
        refuse_too_many(count, "mesh.wall_ratio", ratio)
    except ValueError as error:
        raise MeshError(f"{source}: {error}") from error
    gmsh.model.mesh.clear()
    gmsh.option.setNumber("Mesh.MeshSizeMin", min(_finest(sizes), wanted.min()))
    _add_sizes(gmsh, _size_rows(wanted, nodes, boundary_triangles(elements)))


def _finest(sizes: FittedSizes) -> float:
    return FINEST * sizes.smallest * min(1.0, USUAL / max(1, sizes.curvature))


def _add_sizes(gmsh: Any, rows: np.ndarray) -> None:
    """Add a field of sizes on triangles, from the result of `_size_rows`."""
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", len(rows), rows.ravel())  # a second call would replace it
    field = gmsh.model.mesh.field
    curved = field.add("PostView")
    field.setNumber(curved, "ViewTag", view)
    field.setNumber(curved, "UseClosest", 0)
    obey_size_fields(gmsh)


def _size_rows(sizes: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Corners of triangles and sizes there [mm], which grow slowly from the smallest, as gmsh takes them."""
    grown = _growing(sizes, vertices, triangles)[triangles]
    return np.concatenate([vertices[triangles].transpose(0, 2, 1).reshape(-1, 9), grown], axis=1)


def _growing(sizes: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The sizes at the vertices [mm], lowered until none is larger than the size and distance of a neighbour allow."""
    ends = np.unique(undirected_sides(triangles), axis=0)
    ends = np.vstack([ends, ends[:, ::-1]])
    reach = GROWTH * np.linalg.norm(np.subtract(*vertices[ends.T]), axis=1)
    sizes = sizes.copy()
    while True:
        allowed = sizes[ends[:, 0]] + reach
        if (allowed >= sizes[ends[:, 1]] * (1 - 1e-9)).all():
            return sizes
        np.minimum.at(sizes, ends[:, 1], allowed)


def vertex_curvatures(vertices: np.ndarray, triangles: np.ndarray, feature_angle: float) -> np.ndarray:
    """The larger principal curvature near each vertex [1/mm], shape (vertex_count,); sharp edges do not count.

    Every edge gives the angle across it times its length, in its direction: a tensor. Over the area around a vertex its
    eigenvalues are the principal curvatures (Cohen-Steiner and Morvan 2003).

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices of a closed surface, shape (triangle_count, 3).
        feature_angle: angle between two triangles above which their edge is sharp [rad].
    """
    normals = area_vectors(vertices[triangles])
    edges, sides = joined_sides(triangles)
    angles = angles_between(normals, sides // 3)
    along = np.subtract(*vertices[edges.T])
    lengths = np.linalg.norm(along, axis=1)
    bent = np.where(angles < feature_angle, angles, 0.0) / lengths
    tensors = np.zeros((len(vertices), 3, 3))
    for end in edges.T:  # half of the angle to either
        np.add.at(tensors, end, 0.5 * np.einsum("e,ei,ej->eij", bent, along, along))
    areas = np.linalg.norm(normals, axis=1) / 6  # a third to each corner
    around = np.bincount(triangles.ravel(), np.repeat(areas, 3), len(vertices))
    largest: np.ndarray = np.linalg.eigvalsh(tensors)[:, -1]
    return largest / around
