"""What speaks against a mesh: faults that nothing allows, limits that it misses, and what is only worth a warning."""

from taichisoft_meshing.quality.limits import QUALITY, QualityLimits
from taichisoft_meshing.quality.mesh_quality import MeshQuality


def faults(quality: MeshQuality) -> list[str]:
    """Why the mesh is not the body that was meant, one line each."""
    found = [
        f"{count} {what}"
        for count, what in (
            (quality.inverted, "elements have no positive volume"),
            (quality.duplicate_nodes, "nodes stand where another one stands"),
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
    """One line for each limit that the mesh misses: the measure, its value, the limit."""
    across = quality.elements_across_walls
    at_least = (
        ("the smallest radius ratio", quality.radius_ratios.min(), "", "radius_ratio"),
        ("the smallest dihedral angle", quality.dihedral_angles.min(), " degrees", "smallest_dihedral_angle"),
        ("the shortest edge", quality.edges.min(), " mm", "shortest_edge"),
        (
            "elements across walls",
            across if across is not None else limits.elements_across_walls,
            "",
            "elements_across_walls",
        ),
    )
    missed = [
        f"{measure}, {value:.4g}{unit}, is below {QUALITY}.{key} = {getattr(limits, key):g}"
        for measure, value, unit, key in at_least
        if not value >= getattr(limits, key)
    ]
    largest = quality.dihedral_angles.max()
    if not largest <= limits.largest_dihedral_angle:
        limit = f"{QUALITY}.largest_dihedral_angle = {limits.largest_dihedral_angle:g}"
        missed.append(f"the largest dihedral angle, {largest:.4g} degrees, is above {limit}")
    return missed


def cautions(quality: MeshQuality) -> list[str]:
    """What a user should know before believing a displacement, one line each."""
    thin = [
        f"{wall.name} ({wall.share_of_one:.0%} of the area)"
        for wall in quality.walls
        if wall.of_cavity and wall.elements_across == 1
    ]
    return [f"walls of one element, much too stiff in bending: {', '.join(thin)}; try a smaller size"] if thin else []
