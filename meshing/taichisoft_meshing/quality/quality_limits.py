"""The judgement of a mesh: faults, missed limits (table [quality] of a geometry file), and cautions."""

from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from taichisoft.meshes import ADVICE, TOO_STIFF
from taichisoft.plausible import SIZE, implausible
from taichisoft_meshing.quality.mesh_quality import MeshQuality

QUALITY = "quality"
"""Name of the table of limits in a geometry file."""

Share = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, le=180)]


class QualityLimits(BaseModel):
    """Limits that a mesh must keep to be written without `--force`; the defaults refuse what breaks in a large bend."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    radius_ratio: Share = 0.03
    """Smallest radius ratio of any element [-]: 1 for a regular tetrahedron, 0 for a flat one (gmsh's gamma)."""
    smallest_dihedral_angle: Angle = 2.0
    """Smallest angle between two faces of an element [degrees]."""
    largest_dihedral_angle: Angle = 177.0
    """Largest angle between two faces of an element [degrees]."""
    shortest_edge: Annotated[float, Field(ge=0)] = 0.0
    """Length of the shortest edge [mm]."""
    elements_across_walls: Annotated[int, Field(ge=1, le=5)] = 1
    """Least number of elements across 95 % of each cavity's wall."""


def faults(quality: MeshQuality) -> list[str]:
    """Faults of a mesh, one line each, which no limit allows: the mesh differs from the body that was described."""
    found = [
        f"{count} {what}"
        for count, what in (
            (quality.inverted, "elements have no positive volume"),
            (quality.duplicate_nodes, "nodes have the position of another node"),
            (quality.components - 1, "pieces are not joined to the first by a face"),
        )
        if count
    ]
    for surface in quality.surfaces:
        if surface.closed_by_name and surface.open_edges:
            found.append(
                f"surface '{surface.name}' is not closed: {surface.open_edges} edges do not join two triangles"
            )
        elif surface.closed_by_name and surface.volume <= 0:
            found.append(f"surface '{surface.name}' is inside out: it encloses {surface.volume:.6g} mm^3")
    return found + [f"'{name}' is not fully inside the outer skin" for name in quality.outside]


def missed_limits(quality: MeshQuality, limits: QualityLimits) -> list[str]:
    """Limits that a mesh misses, one line each with the measure, its value and the limit."""
    across = quality.elements_across_walls
    measured = (
        ("the smallest radius ratio", quality.radius_ratios.min(), "", "below", "radius_ratio"),
        ("the smallest dihedral angle", quality.dihedral_angles.min(), " degrees", "below", "smallest_dihedral_angle"),
        ("the shortest edge", quality.edges.min(), " mm", "below", "shortest_edge"),
        *([("elements across walls", across, "", "below", "elements_across_walls")] if across is not None else []),
        ("the largest dihedral angle", quality.dihedral_angles.max(), " degrees", "above", "largest_dihedral_angle"),
    )
    return [
        f"{measure}, {value:.4g}{unit}, is {side} {QUALITY}.{key} = {limit:g}"
        for measure, value, unit, side, key in measured
        for limit in (getattr(limits, key),)
        if not (value >= limit if side == "below" else value <= limit)
    ]


def cautions(quality: MeshQuality) -> list[str]:
    """Warnings about units and displacements of thin walls, a line each; a wall of one quadratic element bends well."""
    said = implausible("its longest side", quality.longest_side, SIZE)
    lines = [said] if said else []
    if quality.order == 2:
        return lines
    thin = [
        f"{wall.name} ({wall.share_of_one:.0%} of the area)"
        for wall in quality.walls
        if wall.of_cavity and wall.elements_across == 1
    ]
    return [*lines, f"{TOO_STIFF}: {', '.join(thin)}; {ADVICE}"] if thin else lines


def summary(problems: Sequence[str]) -> str:
    """The first problem, and the number of the others."""
    return problems[0] + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else "")
