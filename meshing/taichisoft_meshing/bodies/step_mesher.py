"""From a STEP file to tetrahedra: OpenCASCADE, in gmsh, reads the solid, and gmsh fills it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_meshing.bodies.meshed_body import compare_volumes, meshed_body, with_base
from taichisoft_meshing.bodies.size_growth import set_sizes
from taichisoft_meshing.bodies.solid_shells import shells_of_solid
from taichisoft_meshing.bodies.step_text import refuse_broken_step
from taichisoft_meshing.bodies.tables import Base, FittedSizes
from taichisoft_meshing.bodies.wall_splitting import with_elements_across
from taichisoft_meshing.gmsh_session import gmsh_session
from taichisoft_meshing.mesh_ways import SURFACE_ALGORITHMS, mesh_in_some_way

FLAT_TOLERANCE = 1e-6
"""Of a volume between flat faces: only rounding may be missing."""


@dataclass(frozen=True)
class StepSolid:
    """The one body of a STEP file.

    Attributes:
        path: of the file.
        volume: of the silicone [mm^3].
        cavity_volumes: of its voids [mm^3], in the file's order.
        extent: along x, y and z [mm], shape (3,).
        flat: whether all faces are flat.
    """

    path: Path
    volume: float
    cavity_volumes: tuple[float, ...]
    extent: np.ndarray
    flat: bool


def read_step(path: Path) -> StepSolid:
    """Read a STEP file and measure its body.

    Raises:
        MeshError: the file is missing, empty, of another kind or broken, or has no body or several.
    """
    refuse_broken_step(path)
    with gmsh_session(str(path)) as gmsh:
        occ = gmsh.model.occ
        solid = _import_solid(gmsh, path)
        volume = occ.getMass(3, solid)
        lower, upper = np.reshape(gmsh.model.getBoundingBox(3, solid), (2, 3))
        flat = all(gmsh.model.getType(*face) == "Plane" for face in gmsh.model.getEntities(2))
        shells = shells_of_solid(occ, solid)
        enclosed = [occ.getMass(3, occ.addVolume([occ.addSurfaceLoop(shell)])) for shell in shells]
    if not volume > 0:
        raise MeshError(f"{path}: the volume of its body is {volume:.4g} mm^3; is it inside out?")
    return StepSolid(path, volume, tuple(abs(one) for one in enclosed[1:]), upper - lower, flat)


def mesh_step(solid: StepSolid, sizes: FittedSizes, source: str, base: Base | None = None) -> VolumeMesh:
    """Mesh the body of a STEP file.

    Args:
        solid: of `read_step`.
        sizes: of its elements.
        source: begins every error.
        base: selects triangles of the outside.

    Raises:
        MeshError: gmsh fails, or a volume comes out wrong.
    """

    def make(gmsh: Any, algorithm: int) -> VolumeMesh:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        shells = shells_of_solid(gmsh.model.occ, _import_solid(gmsh, solid.path))
        set_sizes(gmsh, sizes, [face for shell in shells[1:] for face in shell])
        gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, shells, source)
        compare_volumes(mesh, solid.volume, solid.cavity_volumes, FLAT_TOLERANCE if solid.flat else None)
        return mesh

    mesh = mesh_in_some_way(str(solid.path), SURFACE_ALGORITHMS, make)
    return with_base(with_elements_across(mesh, sizes), base)


def _import_solid(gmsh: Any, path: Path) -> int:
    """Read the file's one body [mm]."""
    # Always set: OpenCASCADE keeps the unit of an earlier session.
    gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    occ = gmsh.model.occ
    try:
        occ.importShapes(str(path))
    except Exception as error:  # gmsh raises plain Exception
        raise MeshError(f"{path}: not readable as STEP: {' '.join(str(error).split())}") from error
    occ.synchronize()
    solids = [tag for _, tag in gmsh.model.getEntities(3)]
    if not solids:
        faces = len(gmsh.model.getEntities(2))
        raise MeshError(f"{path}: has no solid body, and {faces} faces; export the body as a solid")
    if len(solids) > 1:
        volumes = ", ".join(f"{occ.getMass(3, tag):.4g}" for tag in solids)
        raise MeshError(
            f"{path}: has {len(solids)} bodies, of {volumes} mm^3, where one is expected; join them or keep one of them"
        )
    return solids[0]
