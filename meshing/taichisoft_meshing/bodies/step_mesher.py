"""The mesher of STEP files: OpenCASCADE, in gmsh, reads the solid, and gmsh fills it."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh, require_suffix
from taichisoft_meshing.bodies.meshed_body import compare_volumes, meshed_body, shells_of_solid
from taichisoft_meshing.bodies.size_growth import set_sizes
from taichisoft_meshing.bodies.tables import FittedSizes
from taichisoft_meshing.curved_sides import CurvedSides, curve_sides, curved_sides
from taichisoft_meshing.gmsh_session import SURFACE_ALGORITHMS, first_success, gmsh_session

SUFFIXES = (".step", ".stp")

FIRST, LAST = "ISO-10303-21", "END-ISO-10303-21"
SECTIONS = ("HEADER", "DATA")

QUOTED = re.compile(r"'[^']*'")
NOT_FINITE = re.compile(r"[(,]\s*[-+]?(?:nan\w*|inf\w*|1\.#\w+)\s*[,)]", re.IGNORECASE)

FLAT_TOLERANCE = 1e-6
"""Largest error of a volume between flat faces, as a share of it [-]: only rounding may be missing."""


@dataclass(frozen=True)
class StepSolid:
    """The one body of a STEP file.

    Attributes:
        path: path of the file.
        volume: volume of the silicone [mm^3].
        cavity_volumes: volumes of its voids [mm^3], in the file's order.
        extent: edge lengths of the box around it along x, y and z [mm], shape (3,).
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
    _refuse_broken_step(path)
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


def mesh_step(
    solid: StepSolid, sizes: FittedSizes, source: str, curved: bool = False
) -> tuple[VolumeMesh, CurvedSides | None]:
    """Mesh the body of a STEP file with elements of four nodes and some sizes.

    Args:
        solid: the body.
        sizes: of its elements.
        source: begins every error.
        curved: whether the middles of the sides on its surfaces are computed, too.

    Raises:
        MeshError: gmsh fails, or a volume comes out wrong.
    """

    def make(gmsh: Any, algorithm: int) -> tuple[VolumeMesh, CurvedSides | None]:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        shells = shells_of_solid(gmsh.model.occ, _import_solid(gmsh, solid.path))
        set_sizes(gmsh, sizes, [face for shell in shells[1:] for face in shell])
        gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, shells, source)
        sides = curved_sides(gmsh, mesh.nodes, mesh.elements) if curved else None
        shaped = mesh if sides is None else curve_sides(mesh, sides)[0]
        compare_volumes(shaped, solid.volume, solid.cavity_volumes, FLAT_TOLERANCE if solid.flat else None)
        return mesh, sides

    return first_success(str(solid.path), SURFACE_ALGORITHMS, make)


def _refuse_broken_step(path: Path) -> None:
    """Check that a file is a whole STEP file without NaN.

    Raises:
        MeshError: it is missing, empty, of another kind, stops too early, or has a number that is not finite.
    """
    require_suffix(path, "STEP", SUFFIXES)
    try:
        text = path.read_text(encoding="latin-1")  # any byte is a letter
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a STEP file ({', '.join(SUFFIXES)}) is needed") from error
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not text.lstrip("\xef\xbb\xbf \t\r\n").startswith(FIRST):
        raise MeshError(f"{path}: is not a STEP file: it does not begin with {FIRST}")
    if LAST not in text:
        raise MeshError(f"{path}: stops too early: it does not end with {LAST}; write it again")
    for section in SECTIONS:
        if not re.search(rf"\b{section}\s*[;(]", text):
            raise MeshError(f"{path}: is not a STEP file: it has no section {section}")
    # Names may read like numbers; blanks take their places, so that lines keep their numbers.
    wrong = NOT_FINITE.search(QUOTED.sub(lambda quoted: " " * len(quoted[0]), text))
    if wrong is not None:
        line, number = text.count("\n", 0, wrong.start()) + 1, wrong[0].strip("(), \t\r\n")
        raise MeshError(f"{path}: line {line} has the number {number}, which is not finite; write the file again")


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
