"""The tetrahedra of a gmsh session as a mesh, with named surfaces, and volumes compared with the drawing."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.base import warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, boundary_triangles, element_volumes, enclosed_volume
from taichisoft_meshing.body_tables import BasePlane
from taichisoft_meshing.gmsh_session import TETRAHEDRON, TRIANGLE, GmshFailure, tetrahedra
from taichisoft_meshing.wall_quality import cavity_names

SAID, REFUSED = 0.1, 0.25
"""Errors of a curved volume as shares of it [-], at which a warning is given, and at which the mesh is refused: flat
triangles cut some of it off."""

SILICONE = "silicone"
"""Name of the group of all elements."""
NO_GROUPS: Mapping[str, Any] = MappingProxyType({})


def meshed_body(
    gmsh: Any,
    shells: Sequence[Sequence[int]],
    source: str,
    parts: Mapping[str, int] = NO_GROUPS,
    faces: Mapping[str, Sequence[int]] = NO_GROUPS,
) -> VolumeMesh:
    """The tetrahedra of a session, with the groups "silicone", "outer" and one for each cavity.

    Args:
        gmsh: the module, with a mesh.
        shells: gmsh's numbers of the surfaces of the outside, then of each cavity.
        source: begins every error.
        parts: further element groups, and gmsh's number of the volume of each.
        faces: further surface groups, and gmsh's numbers of the surfaces of each; those inside the body face any way.

    Raises:
        GmshFailure: there are no tetrahedra, or they do not end at these surfaces.
    """
    nodes, elements, used = tetrahedra(gmsh)
    surfaces = _surfaces(elements, [_triangles(gmsh.model.mesh, shell, used) for shell in shells])
    names = ["outer", *cavity_names(len(shells) - 1)]
    groups = {"outer": surfaces[0]}
    # A boundary triangle faces out of the silicone; a cavity encloses a positive volume if it faces into it.
    groups |= {name: np.ascontiguousarray(wall[:, ::-1]) for name, wall in zip(names[1:], surfaces[1:], strict=True)}
    groups |= {name: _outward(elements, _triangles(gmsh.model.mesh, its, used)) for name, its in faces.items()}
    every = gmsh.model.mesh.getElementsByType(TETRAHEDRON)[0]
    element_groups = {SILICONE: np.arange(len(elements), dtype=np.int32)}
    for name, volume in parts.items():
        its = gmsh.model.mesh.getElementsByType(TETRAHEDRON, volume)[0]
        element_groups[name] = np.flatnonzero(np.isin(every, its)).astype(np.int32)
    return VolumeMesh(source, nodes, elements, groups, element_groups).check()


def shells_of_solid(occ: Any, solid: int) -> list[list[int]]:
    """Faces of the outside of a solid, then the faces of each void, in OpenCASCADE's order.

    Args:
        occ: `gmsh.model.occ`.
        solid: gmsh's number of the solid.

    Raises:
        GmshFailure: the solid has no surface.
    """
    shells = [faces.tolist() for faces in occ.getSurfaceLoops(solid)[1]]
    if not shells:
        raise GmshFailure("the body has no closed surface")
    outside = max(range(len(shells)), key=lambda number: _extent(occ, shells[number]))
    return [shells.pop(outside), *shells]


def with_base(mesh: VolumeMesh, base: BasePlane | Sequence[BasePlane] | None) -> VolumeMesh:
    """The mesh with the part of its outside in one or several planes as the group "base"; unchanged without a plane.

    Raises:
        MeshError: no triangle lies in one of the planes.
    """
    planes = [base] if isinstance(base, BasePlane) else list(base or ())
    if not planes:
        return mesh
    outer = mesh.surface_groups["outer"]
    try:
        chosen = outer[np.any([plane.select(mesh.nodes, outer) for plane in planes], axis=0)]
    except ValueError as error:
        raise MeshError(f"{mesh.source}: {error}") from error
    return replace(mesh, surface_groups={**mesh.surface_groups, "base": chosen})


def compare_volumes(
    mesh: VolumeMesh,
    silicone: float,
    cavities: Sequence[float],
    tolerance: float | None,
    parts: Mapping[str, float] = NO_GROUPS,
) -> None:
    """Compare the volumes of a mesh with its body's [mm^3].

    Args:
        mesh: the result of `meshed_body`.
        silicone: volume of the body's silicone.
        cavities: volumes of the body's cavities, in their order.
        tolerance: share of each that may be missing [-]; None for curved surfaces, which flat triangles cut short.
        parts: volumes of the body's element groups.
    """
    volumes = element_volumes(mesh.nodes, mesh.elements)
    meshed = [float(volumes.sum()), *(float(volumes[mesh.element_groups[name]].sum()) for name in parts)]
    meshed += [enclosed_volume(mesh.nodes, mesh.surface_groups[name]) for name in cavity_names(len(cavities))]
    names = [SILICONE, *parts, *cavity_names(len(cavities))]
    drawn = [silicone, *parts.values(), *cavities]
    for refused in (True, False):  # all are looked at before any is only said
        for name, got, wanted in zip(names, meshed, drawn, strict=True):
            off = abs(got - wanted) / wanted
            amount = f"{got:.6g} mm^3 in the mesh instead of {wanted:.6g}, {100 * off:.2g} % off"
            what = f"{mesh.source}: {name} has {amount}"
            if refused and off > (REFUSED if tolerance is None else tolerance):
                raise MeshError(f"{what}; try another size")
            if not refused and tolerance is None and off > SAID:
                warn_caller(f"{what}: the curved surfaces are meshed coarsely")


def _triangles(gmsh_mesh: Any, surfaces: Sequence[int], used: np.ndarray) -> np.ndarray:
    """Triangles on some of gmsh's surfaces as node indices, shape (count, 3); `used` has gmsh's number of each node."""
    corners = np.concatenate([gmsh_mesh.getElementsByType(TRIANGLE, surface)[1] for surface in surfaces])
    at = np.searchsorted(used, corners)
    if len(corners) == 0 or (used[np.minimum(at, len(used) - 1)] != corners).any():
        raise GmshFailure("the tetrahedra do not reach a surface")
    return at.reshape(-1, 3)


def _surfaces(elements: np.ndarray, shells: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The shells, turned to face out of the silicone; together they must be the boundary of the tetrahedra."""
    boundary = boundary_triangles(elements)
    together = _places(boundary, np.vstack(shells))
    if (together < 0).any() or len(together) != len(boundary):
        raise GmshFailure("the tetrahedra do not end at the surfaces")
    return np.split(boundary[together], np.cumsum([len(shell) for shell in shells])[:-1])


def _outward(elements: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles, those on the boundary turned to face out of the silicone."""
    boundary = boundary_triangles(elements)
    place = _places(boundary, triangles)
    return np.where(place[:, None] >= 0, boundary[place], triangles).astype(np.int32)


def _places(boundary: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The row of the boundary that has the corners of each triangle, -1 where none has."""
    every = np.sort(np.vstack([boundary, triangles]), axis=1)
    number = np.unique(every, axis=0, return_inverse=True)[1].ravel()
    place = np.full(number.max() + 1, -1)
    place[number[: len(boundary)]] = np.arange(len(boundary))
    found: np.ndarray = place[number[len(boundary) :]]
    return found


def _extent(occ: Any, faces: list[int]) -> float:
    boxes = np.array([occ.getBoundingBox(2, face) for face in faces])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
