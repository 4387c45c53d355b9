"""What gmsh has filled with tetrahedra, with its surfaces named and its volumes compared with those asked for."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.surface import enclosed_volume
from taichisoft.meshes.volume_mesh import VolumeMesh, boundary_triangles, tetrahedron_volumes
from taichisoft_meshing.bodies.tables import Base
from taichisoft_meshing.gmsh_session import GmshFailure

TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers for the linear ones

# Of a curved volume: chords cut it off, and more than this changes what a finger does.
SAID, REFUSED = 0.1, 0.25


def meshed_body(gmsh: Any, shells: Sequence[Sequence[int]], source: str) -> VolumeMesh:
    """The tetrahedra of a session, with the groups "silicone", "outer" and those of the cavities.

    Args:
        gmsh: the module, with a mesh.
        shells: gmsh's surfaces of the outside first, then those of each cavity.
        source: begins every error.

    Raises:
        GmshFailure: there are no tetrahedra, or they do not end at these surfaces.
    """
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    corner_tags = gmsh.model.mesh.getElementsByType(TETRAHEDRON)[1]
    if len(corner_tags) == 0:
        raise GmshFailure("no tetrahedra came out")
    order = np.argsort(tags)
    used, corners = np.unique(corner_tags, return_inverse=True)
    nodes = coordinates.reshape(-1, 3)[order[np.searchsorted(tags[order], used)]]
    elements = corners.reshape(-1, 4).astype(np.int32)
    surfaces = _surfaces(elements, [_triangles(gmsh.model.mesh, shell, used) for shell in shells])
    names = ["outer", *cavity_names(len(shells) - 1)]
    groups = {"outer": surfaces[0]}
    # A boundary triangle faces out of the silicone; a cavity encloses a positive volume if it faces into it.
    groups |= {name: np.ascontiguousarray(wall[:, ::-1]) for name, wall in zip(names[1:], surfaces[1:], strict=True)}
    silicone = {"silicone": np.arange(len(elements), dtype=np.int32)}
    return VolumeMesh(source, nodes, elements, groups, silicone).check()


def cavity_names(count: int) -> list[str]:
    """Names of the surface groups of cavities: "cavity" alone; "cavity_0", "cavity_1", ... where there are more."""
    return ["cavity"] if count == 1 else [f"cavity_{number}" for number in range(count)]


def with_base(mesh: VolumeMesh, base: Base | None) -> VolumeMesh:
    """The mesh with the part of its outside that `base` selects as the group "base"; without it, as it is.

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
    """Compare a mesh with the volumes [mm^3] of what was to be meshed.

    Args:
        mesh: of `meshed_body`.
        silicone: asked for.
        cavities: asked for, in their order.
        tolerance: share of each that may be missing; None for curved surfaces: chords cut some off, which is said.

    Raises:
        MeshError: one differs too much.
    """
    meshed = [float(tetrahedron_volumes(mesh.nodes, mesh.elements).sum())]
    meshed += [enclosed_volume(mesh.nodes, mesh.surface_groups[name]) for name in cavity_names(len(cavities))]
    names = ["silicone", *cavity_names(len(cavities))]
    for refused in (True, False):  # all are looked at before any is only said
        for name, got, wanted in zip(names, meshed, [silicone, *cavities], strict=True):
            off = abs(got - wanted) / wanted
            amount = f"{got:.6g} mm^3 in the mesh instead of {wanted:.6g}, {100 * off:.2g} % off"
            what = f"{mesh.source}: {name} has {amount}"
            if refused and off > (REFUSED if tolerance is None else tolerance):
                raise MeshError(f"{what}; choose a smaller size")
            if not refused and tolerance is None and off > SAID:
                warnings.warn(f"{what}: the curved surfaces are meshed coarsely", stacklevel=2)


def _triangles(gmsh_mesh: Any, surfaces: Sequence[int], used: np.ndarray) -> np.ndarray:
    """Triangles on some of gmsh's surfaces, of node indices, shape (count, 3)."""
    corners = np.concatenate([gmsh_mesh.getElementsByType(TRIANGLE, surface)[1] for surface in surfaces])
    at = np.searchsorted(used, corners)
    if len(corners) == 0 or (used[np.minimum(at, len(used) - 1)] != corners).any():
        raise GmshFailure("the tetrahedra do not reach a surface")
    return at.reshape(-1, 3)


def _surfaces(elements: np.ndarray, shells: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The shells again, facing out of the silicone, which together must be the boundary of the tetrahedra."""
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
