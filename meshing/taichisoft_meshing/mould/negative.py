"""The negative of a body that is no parametric finger: a block around its outside, in two halves. It is no mould yet.

Where the body is undercut as seen from the parting plane the halves do not come off, and cavities are cast solid.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes import enclosed_volume
from taichisoft.plugin_system import Geometry
from taichisoft_meshing.bodies.file_bodies import StepBody
from taichisoft_meshing.bodies.step_file import import_solids
from taichisoft_meshing.mould.assembly import Assembly
from taichisoft_meshing.mould.ray_crossings import find_parallel_crossings

MOST_TRIANGLES = 6000
"""More flat faces than these keep OpenCASCADE busy for minutes."""
GRID = 60
"""Lines along the longest side with which a parting plane is looked for."""

Plane = tuple[int, float]
"""Number of the axis across the plane, and the position on it [mm]."""


def outside_of(geometry: Geometry, file: str) -> tuple[Callable[[Any], Any], np.ndarray, list[float]]:
    """What makes the outside of a body as a solid of gmsh, corners of its triangles, and volumes of its cavities.

    A STEP body keeps its curved faces; of any other the outside is that of its mesh, in flat triangles.

    Raises:
        MeshError: it cannot be read or meshed, or has too many triangles.
    """
    if isinstance(geometry, StepBody):
        body = geometry.body

        def from_step(gmsh: Any) -> Any:
            occ, solids = gmsh.model.occ, import_solids(gmsh, body.path)
            outside = occ.addVolume([occ.addSurfaceLoop(sorted(body.outside))])
            occ.remove([(3, solid) for solid in solids])
            return [(3, outside)]

        seen = body.nodes[body.triangles[np.isin(body.face_of, sorted(body.outside))]]
        return from_step, seen, list(body.void_volumes)
    mesh = geometry.mesh(None)
    groups = mesh.surface_groups
    triangles = groups["outer"]
    if len(triangles) > MOST_TRIANGLES:
        raise MeshError(
            f"{file}: its outside has {len(triangles)} triangles, and a negative takes {MOST_TRIANGLES} at most; "
            "make mesh.largest and mesh.smallest larger"
        )
    volumes = [enclosed_volume(mesh.nodes, wall) for name, wall in groups.items() if name.startswith("cavity")]
    return lambda gmsh: _polyhedron(gmsh.model.occ, mesh.nodes, triangles), mesh.nodes[triangles], volumes


def find_plane(corners: np.ndarray, wanted: str | None) -> Plane:
    """The parting plane that is asked for, "z=0"; or the one through the middle of a side with the fewest undercuts.

    Raises:
        MeshError: it is no such text, or misses the body.
    """
    points = corners.reshape(-1, 3)
    lower, upper = points.min(axis=0), points.max(axis=0)
    if wanted is None:
        middle = np.round((lower + upper) / 2, 3) + 0.0  # triangles of curved faces are not quite alike on both sides
        return min(((axis, float(middle[axis])) for axis in (2, 1, 0)), key=lambda plane: _held(corners, plane))
    name, _, number = wanted.replace(" ", "").partition("=")
    try:
        axis, position = "xyz".index(name.lower() or "?"), float(number)
    except ValueError as error:
        raise MeshError(f"--parting {wanted}: must be an axis and a position in mm, such as z=0") from error
    if not lower[axis] < position < upper[axis]:
        raise MeshError(
            f"--parting {wanted}: misses the body, which reaches from {lower[axis]:g} to {upper[axis]:g} along {name}"
        )
    return axis, position


def negative(gmsh: Any, outside: Callable[[Any], Any], plane: Plane, wall: float) -> Assembly:
    """The two halves of the block around a body, `wall` [mm] thick, and the body in it, cast solid."""
    occ, (axis, position) = gmsh.model.occ, plane
    body = outside(gmsh)
    box = np.round(occ.getBoundingBox(*body[0]), 6).reshape(2, 3) + np.array([[-wall], [wall]])
    halves = []
    for side in (1, 0):
        ends = box.copy()
        ends[1 - side, axis] = position
        half = [(3, occ.addBox(*ends[0].tolist(), *(ends[1] - ends[0]).tolist()))]
        halves.append(occ.cut(half, body, removeTool=False)[0])
    way = tuple(np.eye(3)[axis].tolist())
    volume = float(sum(occ.getMass(*solid) for solid in body))
    parts = {"plus": halves[0], "body": body, "minus": halves[1]}
    block = float(np.prod(box[1] - box[0]))
    return Assembly(parts, {"plus": way, "body": way}, "body", block, 0.0, (("the body", "soft", volume),))


def _held(corners: np.ndarray, plane: Plane) -> int:
    """Number of lines across a plane on which one of the halves would be held by the body."""
    axis, position = plane
    others = [one for one in range(3) if one != axis]
    points = corners.reshape(-1, 3)
    lower, upper = points.min(axis=0), points.max(axis=0)
    spacing = (upper - lower)[others].max() / GRID
    grid = np.meshgrid(*(np.arange(lower[one] + 0.317 * spacing, upper[one], spacing) for one in others))
    starts = np.full((grid[0].size, 3), lower[axis] - 1.0)
    starts[:, others] = np.stack([one.ravel() for one in grid], axis=1)
    crossings = find_parallel_crossings(starts, np.eye(3)[axis], corners)
    heights = lower[axis] - 1.0 + crossings.distance
    crossed = np.bincount(crossings.ray, minlength=len(starts))
    below = np.bincount(crossings.ray, heights <= position, len(starts))
    return int(np.count_nonzero((crossed > 0) & ((crossed != 2) | (below != 1))))


def _polyhedron(occ: Any, nodes: np.ndarray, triangles: np.ndarray) -> Any:
    """The solid between flat triangles."""
    points = {node: occ.addPoint(*nodes[node].tolist()) for node in np.unique(triangles).tolist()}
    lines: dict[tuple[int, int], int] = {}
    faces = []
    for triangle in triangles.tolist():
        sides = []
        for begin, end in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            pair = (min(begin, end), max(begin, end))
            if pair not in lines:
                lines[pair] = occ.addLine(points[pair[0]], points[pair[1]])
            sides.append(lines[pair])
        faces.append(occ.addPlaneSurface([occ.addCurveLoop(sides)]))
    return [(3, occ.addVolume([occ.addSurfaceLoop(faces)]))]
