"""The tables that `taichisoft mesh` and `taichisoft mesh info` print: figures of a mesh or of a surface."""

from collections.abc import Iterable, Sequence

import numpy as np
from rich.console import Group
from rich.table import Table

from taichisoft.terminal_text import plain
from taichisoft_meshing.quality.mesh_quality import MeshQuality
from taichisoft_meshing.quality.mesh_surfaces import SurfaceQuality
from taichisoft_meshing.quality.quality_limits import QualityLimits
from taichisoft_meshing.quality.walls import MANY


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
