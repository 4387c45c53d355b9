"""Figures of a mesh: of its elements, its surfaces and its walls."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rich.console import Group
from rich.table import Table

from taichisoft.base import SIZE, implausible, plain
from taichisoft.mesh import ADVICE, TOO_STIFF, VolumeMesh, element_volumes, joined_pieces
from taichisoft_meshing.wall_quality import (
    MANY,
    SurfaceQuality,
    WallQuality,
    cavities_outside,
    dihedral_angles,
    edge_lengths,
    measure_surfaces,
    measure_walls,
    neighbours,
    radius_ratios,
)


@dataclass(frozen=True)
class MeshQuality:
    """Figures of a mesh.

    Attributes:
        node_count: number of nodes.
        order: 1 for tetrahedra of four nodes, 2 for ten.
        volumes: signed volume of each element [mm^3], shape (element_count,).
        radius_ratios: radius ratio of each element [-], shape (element_count,); 1 for a regular one.
        dihedral_angles: angles between the faces of each element [degrees], shape (element_count, 6).
        edges: shortest and longest edge of each element [mm], shape (element_count, 2).
        centres: middle of each element [mm], shape (element_count, 3).
        duplicate_nodes: number of nodes at the position of another node.
        components: number of pieces of the mesh, in which elements are joined by faces.
        surfaces: figures of the outer skin, of every cavity, and of the other surface groups.
        outside: names of cavities that are not fully inside the outer skin.
        walls: figures of the walls between each two surfaces; empty when elements are inverted.
        longest_side: of the box around the body [mm].
    """

    node_count: int
    order: int
    volumes: np.ndarray
    radius_ratios: np.ndarray
    dihedral_angles: np.ndarray
    edges: np.ndarray
    centres: np.ndarray
    duplicate_nodes: int
    components: int
    surfaces: tuple[SurfaceQuality, ...]
    outside: tuple[str, ...]
    walls: tuple[WallQuality, ...]
    longest_side: float

    @property
    def inverted(self) -> int:
        """Number of elements without a positive volume."""
        return int((self.volumes <= 0).sum())

    @property
    def elements_across_walls(self) -> int | None:
        """Number of elements across the thinnest-meshed wall of a cavity, or of the body when it has none, or None."""
        of_cavities = [wall for wall in self.walls if wall.of_cavity]
        return min((wall.elements_across for wall in of_cavities or self.walls), default=None)


def measure(mesh: VolumeMesh) -> MeshQuality:
    """Measure a mesh, which may be one that is not fit to simulate."""
    volumes = element_volumes(mesh.nodes, mesh.elements)
    surfaces = measure_surfaces(mesh)
    return MeshQuality(
        len(mesh.nodes),
        1 if mesh.elements.shape[1] == 4 else 2,
        volumes,
        radius_ratios(mesh.nodes, mesh.elements),
        dihedral_angles(mesh.nodes, mesh.elements),
        edge_lengths(mesh.nodes, mesh.elements),
        mesh.nodes[mesh.elements[:, :4]].mean(axis=1),
        len(mesh.nodes) - len(np.unique(mesh.nodes, axis=0)),
        _component_count(mesh.elements),
        surfaces,
        cavities_outside(mesh.nodes, surfaces),
        measure_walls(mesh, surfaces) if (volumes > 0).all() else (),
        float(np.ptp(mesh.nodes, axis=0).max()),
    )


def _component_count(elements: np.ndarray) -> int:
    behind = neighbours(elements)
    element, face = np.nonzero(behind >= 0)
    return int(joined_pieces(len(elements), np.column_stack([element, behind[element, face]])).max()) + 1


# The judgement of a mesh: faults, missed limits (table [quality] of a geometry file), and cautions.

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
    lines = [
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
            lines.append(
                f"surface '{surface.name}' is not closed: {surface.open_edges} edges do not join two triangles"
            )
        elif surface.closed_by_name and surface.volume <= 0:
            lines.append(f"surface '{surface.name}' is inside out: it encloses {surface.volume:.6g} mm^3")
    return lines + [f"'{name}' is not fully inside the outer skin" for name in quality.outside]


def missed_limits(quality: MeshQuality, limits: QualityLimits) -> list[str]:
    """Limits that a mesh misses, one line each with the measure, its value and the limit."""
    across, angles, edges = quality.elements_across_walls, quality.dihedral_angles, quality.edges
    walls = np.array([across]) if across is not None else np.empty(0)
    measured = (
        ("the smallest radius ratio", quality.radius_ratios, "", 1, "radius_ratio"),
        ("the smallest dihedral angle", angles.min(axis=1), " degrees", 1, "smallest_dihedral_angle"),
        ("the shortest edge", edges.min(axis=1), " mm", 1, "shortest_edge"),
        ("elements across walls", walls, "", 1, "elements_across_walls"),
        ("the largest dihedral angle", angles.max(axis=1), " degrees", -1, "largest_dihedral_angle"),
    )
    lines = []
    for measure, values, unit, sign, key in measured:
        limit = getattr(limits, key)
        missed = ~(sign * values >= sign * limit)
        if missed.any():
            worst = int((sign * values).argmin())
            side = "below" if sign > 0 else "above"
            line = f"{measure}, {values[worst]:.4g}{unit}, is {side} {QUALITY}.{key} = {limit:g}"
            if values is not walls:
                place = np.round(quality.centres[worst], 2).tolist()
                line += f" in {missed.sum()} element{'s' * bool(missed.sum() > 1)}, the worst at {place} mm"
            lines.append(line)
    return lines


def cautions(quality: MeshQuality) -> list[str]:
    """Warnings about units and displacements of thin walls, a line each; a wall of one quadratic element bends well."""
    doubt = implausible("its longest side", quality.longest_side, SIZE)
    lines = [doubt] if doubt else []
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


# The tables that `taichisoft mesh` and `taichisoft mesh info` print: figures of a mesh or of a surface.


def mesh_tables(title: str, quality: MeshQuality, limits: QualityLimits, seconds: float | None = None) -> Group:
    """The figures of a mesh beside its limits, its walls and its surfaces; `seconds` is the time that it took [s]."""
    ratios, angles, edges = quality.radius_ratios, quality.dihedral_angles, quality.edges
    figures = [
        ("nodes", f"{quality.node_count}", "", ""),
        ("tetrahedra", f"{len(quality.volumes)}", "", ""),
        ("silicone", f"{quality.volumes.sum():.1f}", "mm³", ""),
        *((one.name, f"{one.volume:.1f}", "mm³", "") for one in quality.surfaces if one.of_cavity),
        ("inverted tetrahedra", f"{quality.inverted}", "", "0"),
        ("pieces", f"{quality.components}", "", "1"),
        ("duplicate nodes", f"{quality.duplicate_nodes}", "", "0"),
        *([] if seconds is None else [("time", f"{seconds:.2f}", "s", "")]),
        ("radius ratio, smallest", f"{ratios.min():.3f}", "", f"≥ {limits.radius_ratio:g}"),
        ("radius ratio, median", f"{np.median(ratios):.3f}", "", ""),
        ("dihedral angle, smallest", f"{angles.min():.1f}", "°", f"≥ {limits.smallest_dihedral_angle:g}"),
        ("dihedral angle, largest", f"{angles.max():.1f}", "°", f"≤ {limits.largest_dihedral_angle:g}"),
        ("smallest element", f"{quality.volumes.min():.3g}", "mm³", "> 0"),
        ("shortest edge", f"{edges.min():.2f}", "mm", f"≥ {limits.shortest_edge:g}" if limits.shortest_edge else ""),
        ("longest edge", f"{edges.max():.1f}", "mm", ""),
    ]
    limited = [wall for wall in quality.walls if wall.of_cavity] or quality.walls
    walls = [
        (
            wall.name,
            f"{wall.thinnest:.2f}",
            f"{wall.elements_across}{'+' if wall.elements_across == MANY else ''}",
            f"{wall.share_of_one:.0%}",
            f"≥ {limits.elements_across_walls}" if wall in limited else "",
        )
        for wall in quality.walls
    ]
    surfaces = [
        (one.name, f"{len(one.triangles)}", f"{one.area:.1f}", _state(one, quality) if one.closed_by_name else "")
        for one in quality.surfaces
    ]
    return Group(
        aligned_table(title, ("", ">", "", "limit"), figures),
        *(
            [aligned_table("", ("walls", ">thinnest [mm]", ">elements across", ">one element", "limit"), walls)]
            * bool(walls)
        ),
        aligned_table("", ("surfaces", ">triangles", ">area [mm²]", ""), surfaces),
    )


def surface_table(title: str, surface: SurfaceQuality, pieces: int, extent: np.ndarray) -> Table:
    """The figures of one surface; `extent` has the edge lengths of the box around it [mm], shape (3,)."""
    facing = "-" if surface.open_edges else "outward" if surface.volume > 0 else "inward"
    rows = [
        ("vertices", f"{len(np.unique(surface.triangles))}", ""),
        ("triangles", f"{len(surface.triangles)}", ""),
        ("pieces", f"{pieces}", ""),
        ("extent", " × ".join(f"{length:.4g}" for length in extent), "mm"),
        ("area", f"{surface.area:.1f}", "mm²"),
        ("open edges", f"{surface.open_edges}", "" if surface.open_edges else "closed"),
        ("volume inside", "none" if surface.open_edges else f"{abs(surface.volume):.1f}", "mm³"),
        ("faces", facing, ""),
    ]
    return aligned_table(title, ("", ">", ""), rows)


def aligned_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table; the cells below a heading that begins with ">" are figures, aligned to the right."""
    table = Table(title=plain(title) or None, show_header=any(heading.strip(">") for heading in headings))
    for heading in headings:
        table.add_column(plain(heading.strip(">")), justify="right" if heading.startswith(">") else "left")
    for row in rows:
        table.add_row(*map(plain, row))
    return table


def _state(surface: SurfaceQuality, quality: MeshQuality) -> str:
    """The state of a surface that must be closed."""
    if surface.open_edges:
        return f"open: {surface.open_edges} edges"
    if surface.volume <= 0:
        return "closed, inside out"
    if not surface.of_cavity:
        return "closed, faces outward"
    return "closed, faces the silicone, " + ("not inside" if surface.name in quality.outside else "inside")
