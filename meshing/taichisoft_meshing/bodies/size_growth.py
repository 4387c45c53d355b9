"""Element sizes that grow with the distance from the cavities, and shrink where surfaces are curved."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft_meshing.bodies.closed_shells import Shell, undirected_sides
from taichisoft_meshing.bodies.surface_curvature import vertex_curvatures
from taichisoft_meshing.bodies.tables import FittedSizes

GROWTH = 0.5
"""How much larger elements may be for each millimetre that they are farther away [-]."""

FINEST = 0.25
"""Of the smallest size: no curve, such as that of a tiny fillet, is meshed finer [-]."""

SAMPLES = 20  # points along each curve and surface that distances are measured to


def set_sizes(gmsh: Any, sizes: FittedSizes, cavity_surfaces: Sequence[int]) -> None:
    """Tell gmsh the sizes; `cavity_surfaces` are its numbers of the cavities' surfaces."""
    largest, smallest = sizes.largest, sizes.smallest
    gmsh.option.setNumber("Mesh.MeshSizeMax", largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", FINEST * smallest)
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
        _use_smallest(gmsh)


def follow_curvature(gmsh: Any, sizes: FittedSizes, shells: Sequence[Shell], feature_angle: float) -> None:
    """Smaller sizes where given triangles are curved, in place of gmsh's own: it finds unrolled flat ones curved.

    Args:
        gmsh: the module, after `set_sizes`.
        sizes: of its elements.
        shells: the given triangles; none when all of them are flat.
        feature_angle: above which edges are no curved surface [rad].
    """
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 0)
    if sizes.curvature == 0 or not shells:
        return
    rows = []
    for shell in shells:
        curvatures = vertex_curvatures(shell.vertices, shell.triangles, feature_angle)
        with np.errstate(divide="ignore"):
            wanted = np.minimum(2 * math.pi / (sizes.curvature * curvatures), sizes.largest)
        wanted = _growing(wanted, shell)
        corners = shell.vertices[shell.triangles]
        rows.append(np.concatenate([corners.transpose(0, 2, 1).reshape(-1, 9), wanted[shell.triangles]], axis=1))
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", sum(map(len, rows)), np.vstack(rows).ravel())  # a second call would replace it
    field = gmsh.model.mesh.field
    curved = field.add("PostView")
    field.setNumber(curved, "ViewTag", view)
    field.setNumber(curved, "UseClosest", 0)
    _use_smallest(gmsh)


def _growing(sizes: np.ndarray, shell: Shell) -> np.ndarray:
    """Sizes at vertices of which none is larger than what a neighbour's allows."""
    ends = np.unique(undirected_sides(shell.triangles), axis=0)
    ends = np.vstack([ends, ends[:, ::-1]])
    reach = GROWTH * np.linalg.norm(np.subtract(*shell.vertices[ends.T]), axis=1)
    sizes = sizes.copy()
    while True:
        allowed = sizes[ends[:, 0]] + reach
        if (allowed >= sizes[ends[:, 1]] * (1 - 1e-9)).all():
            return sizes
        np.minimum.at(sizes, ends[:, 1], allowed)


def _use_smallest(gmsh: Any) -> None:
    """Let the smallest of all fields so far rule."""
    field = gmsh.model.mesh.field
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", [tag for tag in field.list() if field.getType(tag) != "Distance"])
    field.setAsBackgroundMesh(smallest)
