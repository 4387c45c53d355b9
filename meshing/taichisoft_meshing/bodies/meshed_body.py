"""The tetrahedra of a gmsh session as a mesh, with named surfaces, and volumes compared with the drawing."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh, boundary_triangles, element_volumes, enclosed_volume
from taichisoft_meshing.bodies.tables import BasePlane
from taichisoft_meshing.gmsh_session import TRIANGLE, GmshFailure, tetrahedra
from taichisoft_meshing.quality.mesh_surfaces import cavity_names

SAID, REFUSED = 0.1, 0.25
"""Errors of a curved volume as shares of it [-], at which a warning is given, and at which the mesh is refused: flat
triangles cut some of it off."""


def meshed_body(gmsh: Any, shells: Sequence[Sequence[int]], source: str) -> VolumeMesh:
    """The tetrahedra of a session, with the groups "silicone", "outer" and one for each cavity.

    Args:
        gmsh: the module, with a mesh.
        shells: gmsh's numbers of the surfaces of the outside, then of each cavity.
        source: begins every error.

    Raises:
        GmshFailure: there are no tetrahedra, or they do not end at these surfaces.
    """
    nodes, elements, used = tetrahedra(gmsh)
    surfaces = _surfaces(elements, [_triangles(gmsh.model.mesh, shell, used) for shell in shells])
    names = ["outer", *cavity_names(len(shells) - 1)]
    groups = {"outer": surfaces[0]}
    # A boundary triangle faces out of the silicone; a cavity encloses a positive volume if it faces into it.
    groups |= {name: np.ascontiguousarray(wall[:, ::-1]) for name, wall in zip(names[1:], surfaces[1:], strict=True)}
    silicone = {"silicone": np.arange(len(elements), dtype=np.int32)}
    return VolumeMesh(source, nodes, elements, groups, silicone).check()


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


def with_base(mesh: VolumeMesh, base: BasePlane | None) -> VolumeMesh:
    """The mesh with the part of its outside that `base` selects as the group "base"; unchanged when `base` is None.

    Raises:
        MeshError: nothing is selected.
    """
    if base is None:
        return mesh
    outer = mesh.surface_groups["outer"]
    try:
        chosen = outer[base.select(mesh.nodes, outer)]
    except ValueError as error:
        raise MeshError(f"{mesh.source}: {error}") from error
    return replace(mesh, surface_groups={**mesh.surface_groups, "base": chosen})


def compare_volumes(mesh: VolumeMesh, silicone: float, cavities: Sequence[float], tolerance: float | None) -> None:
    """Compare the volumes of a mesh with its body's [mm^3].

    Args:
        mesh: the result of `meshed_body`.
        silicone: volume of the body's silicone.
        cavities: volumes of the body's cavities, in their order.
        tolerance: share of each that may be missing [-]; None for curved surfaces, which flat triangles cut short.

    Raises:
        MeshError: a volume differs too much.
    """
    meshed = [float(element_volumes(mesh.nodes, mesh.elements).sum())]
    meshed += [enclosed_volume(mesh.nodes, mesh.surface_groups[name]) for name in cavity_names(len(cavities))]
    names = ["silicone", *cavity_names(len(cavities))]
    for refused in (True, False):  # all are looked at before any is only said
        for name, got, wanted in zip(names, meshed, [silicone, *cavities], strict=True):
            off = abs(got - wanted) / wanted
            amount = f"{got:.6g} mm^3 in the mesh instead of {wanted:.6g}, {100 * off:.2g} % off"
            what = f"{mesh.source}: {name} has {amount}"
            if refused and off > (REFUSED if tolerance is None else tolerance):
                raise MeshError(f"{what}; try another size")
            if not refused and tolerance is None and off > SAID:
                warnings.warn(f"{what}: the curved surfaces are meshed coarsely", stacklevel=2)


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
    every = np.sort(np.vstack([boundary, *shells]), axis=1)
    number = np.unique(every, axis=0, return_inverse=True)[1].ravel()
    place = np.full(number.max() + 1, -1)
    place[number[: len(boundary)]] = np.arange(len(boundary))
    found = np.split(place[number[len(boundary) :]], np.cumsum([len(shell) for shell in shells])[:-1])
    together = np.concatenate(found)
    if (together < 0).any() or len(together) != len(boundary):
        raise GmshFailure("the tetrahedra do not end at the surfaces")
    return [boundary[where] for where in found]


def _extent(occ: Any, faces: list[int]) -> float:
    boxes = np.array([occ.getBoundingBox(2, face) for face in faces])
    return float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
