"""The mesher of STEP files: gmsh fills the solids that OpenCASCADE has read, and the mesh gets the drawing's names."""

from collections.abc import Mapping, Sequence
from typing import Any

from taichisoft.meshes import VolumeMesh
from taichisoft_meshing.bodies.cad_body import CadBody
from taichisoft_meshing.bodies.caps import with_caps
from taichisoft_meshing.bodies.meshed_body import NO_GROUPS, compare_volumes, meshed_body
from taichisoft_meshing.bodies.openings import Opening
from taichisoft_meshing.bodies.size_growth import follow_walls, set_sizes
from taichisoft_meshing.bodies.step_file import import_solids
from taichisoft_meshing.bodies.tables import FittedSizes
from taichisoft_meshing.curved_sides import CurvedSides, curve_sides, curved_sides
from taichisoft_meshing.gmsh_session import SURFACE_ALGORITHMS, first_success
from taichisoft_meshing.quality.mesh_surfaces import cavity_names

FLAT_TOLERANCE = 1e-6
"""Largest error of a volume between flat faces, as a share of it [-]: only rounding may be missing."""


def mesh_step(
    body: CadBody,
    sizes: FittedSizes,
    source: str,
    *,
    closed: Sequence[Opening] = (),
    parts: Mapping[str, int] = NO_GROUPS,
    faces: Mapping[str, Sequence[int]] = NO_GROUPS,
    wall_ratio: float = 0.0,
    curved: bool = False,
) -> tuple[VolumeMesh, CurvedSides | None]:
    """Mesh the body of a STEP file with elements of four nodes and some sizes.

    Args:
        body: the body.
        sizes: of its elements.
        source: begins every error.
        closed: the openings that get caps; their chambers are cavities, after the voids.
        parts: element groups, and the number of the solid of each.
        faces: surface groups, and the numbers of the faces of each.
        wall_ratio: longest edge in a wall over its thickness [-]; 0: as long as `sizes` say.
        curved: whether the middles of the sides on its surfaces are computed, too.

    Raises:
        MeshError: gmsh fails, or a volume comes out wrong.
    """
    behind = [opening.faces for opening in closed]
    shells = [sorted(shell) for shell in (body.outside.difference(*behind), *body.voids, *behind)]

    def make(gmsh: Any, algorithm: int) -> tuple[VolumeMesh, CurvedSides | None]:
        gmsh.option.setNumber("Mesh.Algorithm", algorithm)
        tags = list(import_solids(gmsh, body.path))
        set_sizes(gmsh, sizes, [face for shell in shells[1:] for face in shell])
        gmsh.model.mesh.generate(3)
        if wall_ratio:
            follow_walls(gmsh, sizes, wall_ratio, source)
            gmsh.model.mesh.generate(3)
        mesh = meshed_body(gmsh, shells, source, {name: tags[number - 1] for name, number in parts.items()}, faces)
        for name in cavity_names(len(shells) - 1)[len(body.voids) :]:
            mesh = with_caps(mesh, name)
        sides = curved_sides(gmsh, mesh.nodes, mesh.elements) if curved else None
        shaped = mesh if sides is None else curve_sides(mesh, sides)[0]
        volumes = [*body.void_volumes, *(opening.volume for opening in closed)]
        volumes_of_parts = {name: body.solids[number - 1].volume for name, number in parts.items()}
        compare_volumes(shaped, body.volume, volumes, FLAT_TOLERANCE if body.flat else None, volumes_of_parts)
        return mesh, sides

    return first_success(str(body.path), SURFACE_ALGORITHMS, make)
