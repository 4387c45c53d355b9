"""The tables that `taichisoft mesh` and `taichisoft mesh-info` print: figures of a mesh or of a surface."""

from collections.abc import Iterator

import numpy as np
from rich.console import Group
from rich.table import Table

from taichisoft.terminal_text import plain
from taichisoft_meshing.quality.limits import QualityLimits
from taichisoft_meshing.quality.mesh_quality import MeshQuality
from taichisoft_meshing.quality.surfaces import SurfaceQuality
from taichisoft_meshing.quality.wall_rays import MANY


def mesh_tables(title: str, quality: MeshQuality, limits: QualityLimits, seconds: float | None = None) -> Group:
    """The figures of a mesh beside its limits, its walls and its surfaces; `seconds` is the time that it took [s]."""
    figures = _table(title, "", ">", "", "limit")
    for section in (_size(quality, seconds), _shape(quality, limits)):
        for row in section:
            figures.add_row(*map(plain, row))
        figures.add_section()
    walls = _table(None, "walls", ">thinnest [mm]", ">elements across", ">one element thick", "limit")
    for row in _walls(quality, limits):
        walls.add_row(*map(plain, row))
    surfaces = _table(None, "surfaces", ">triangles", ">area [mm²]", "")
    for row in _surfaces(quality):
        surfaces.add_row(*map(plain, row))
    return Group(figures, *([walls] if walls.row_count else []), surfaces)


def surface_table(title: str, surface: SurfaceQuality, pieces: int, extent: np.ndarray) -> Table:
    """The figures of one surface; `extent` has the edge lengths of the box around it [mm], shape (3,)."""
    table = _table(title, "", ">", "")
    table.show_header = False
    facing = "" if surface.open_edges else "outward" if surface.volume > 0 else "inward"
    for row in (
        ("vertices", f"{len(np.unique(surface.triangles))}", ""),
        ("triangles", f"{len(surface.triangles)}", ""),
        ("pieces", f"{pieces}", ""),
        ("extent", " × ".join(f"{length:.4g}" for length in extent), "mm"),
        ("area", f"{surface.area:.1f}", "mm²"),
        ("open edges", f"{surface.open_edges}", "" if surface.open_edges else "closed"),
        ("volume inside", "none" if surface.open_edges else f"{abs(surface.volume):.1f}", "mm³"),
        ("faces", facing or "-", ""),
    ):
        table.add_row(*map(plain, row))
    return table


def _table(title: str | None, *headings: str) -> Table:
    """An empty table; the column of a heading that begins with ">" has figures, which stand on the right."""
    table = Table(title=None if title is None else plain(title))
    for heading in headings:
        table.add_column(plain(heading.removeprefix(">")), justify="right" if heading.startswith(">") else "left")
    return table


def _size(quality: MeshQuality, seconds: float | None) -> Iterator[tuple[str, ...]]:
    yield "nodes", f"{quality.node_count}", "", ""
    yield "tetrahedra", f"{len(quality.volumes)}", "", ""
    yield "silicone", f"{quality.volumes.sum():.1f}", "mm³", ""
    for surface in quality.surfaces:
        if surface.of_cavity:
            yield surface.name, f"{surface.volume:.1f}", "mm³", ""
    yield "inverted tetrahedra", f"{quality.inverted}", "", "0"
    yield "pieces", f"{quality.components}", "", "1"
    yield "duplicate nodes", f"{quality.duplicate_nodes}", "", "0"
    if seconds is not None:
        yield "time", f"{seconds:.2f}", "s", ""


def _shape(quality: MeshQuality, limits: QualityLimits) -> Iterator[tuple[str, ...]]:
    ratios, angles, edges = quality.radius_ratios, quality.dihedral_angles, quality.edges
    yield "radius ratio, smallest", f"{ratios.min():.3f}", "", f"≥ {limits.radius_ratio:g}"
    yield "radius ratio, median", f"{np.median(ratios):.3f}", "", ""
    yield "dihedral angle, smallest", f"{angles.min():.1f}", "°", f"≥ {limits.smallest_dihedral_angle:g}"
    yield "dihedral angle, largest", f"{angles.max():.1f}", "°", f"≤ {limits.largest_dihedral_angle:g}"
    yield "smallest element", f"{quality.volumes.min():.3g}", "mm³", "> 0"
    yield "shortest edge", f"{edges.min():.2f}", "mm", f"≥ {limits.shortest_edge:g}" if limits.shortest_edge else ""
    yield "longest edge", f"{edges.max():.1f}", "mm", ""


def _walls(quality: MeshQuality, limits: QualityLimits) -> Iterator[tuple[str, ...]]:
    """Rows of walls; only the walls of cavities have a limit, if there are any."""
    limited = any(wall.of_cavity for wall in quality.walls)
    for wall in quality.walls:
        yield (
            wall.name,
            f"{wall.thinnest:.2f}",
            f"{wall.elements_across}{'+' if wall.elements_across == MANY else ''}",
            f"{wall.share_of_one:.0%}",
            f"≥ {limits.elements_across_walls}" if wall.of_cavity or not limited else "",
        )


def _surfaces(quality: MeshQuality) -> Iterator[tuple[str, ...]]:
    for surface in quality.surfaces:
        yield surface.name, f"{len(surface.triangles)}", f"{surface.area:.1f}", _state(surface, quality)


def _state(surface: SurfaceQuality, quality: MeshQuality) -> str:
    """The state of a surface that must be closed; empty for other surfaces."""
    if not surface.closed_by_name:
        return ""
    if surface.open_edges:
        return f"open: {surface.open_edges} edges"
    if surface.volume <= 0:
        return "closed, inside out"
    if not surface.of_cavity:
        return "closed, faces outward"
    return "closed, faces the silicone, " + ("not inside" if surface.name in quality.outside else "inside")
