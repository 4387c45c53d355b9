"""`taichisoft mould check`: whether the parts of a mould come off, fill their block, and are thick enough to print.

The parts are read from their STL files, so that what CAD has changed is checked as it is.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from taichisoft.errors import MeshError
from taichisoft.mesh import joined_pieces, read_surface
from taichisoft_meshing.closed_shells import area_vectors

Solid = Any
"""A `manifold3d.Manifold`, which has no types."""


@dataclass(frozen=True)
class RayCrossings:
    """Crossings of rays and triangles, an entry each.

    Attributes:
        ray: index of the ray, shape (count,).
        triangle: index of the triangle, shape (count,).
        distance: along the ray from its origin [mm], shape (count,).
        cosine: between the ray and the triangle's normal [-], positive where it leaves a body, shape (count,).
    """

    ray: np.ndarray
    triangle: np.ndarray
    distance: np.ndarray
    cosine: np.ndarray


def ray_crossings(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> RayCrossings:
    """All crossings of rays with triangles.

    Args:
        origins: starts of the rays [mm], shape (ray_count, 3).
        directions: unit vectors along them, shape (ray_count, 3), or (3,) for parallel ones.
        corners: of the triangles, counterclockwise as seen from outside [mm], shape (triangle_count, 3, 3).
    """
    points, vertex = np.unique(np.reshape(corners, (-1, 3)), axis=0, return_inverse=True)
    solid = solid_of(points, vertex.reshape(-1, 3))
    numbers = np.array(solid.to_mesh64().face_id)
    ends = np.concatenate([points, np.reshape(origins, (-1, 3))])
    reach = float(np.linalg.norm(np.ptp(ends, axis=0))) + 1.0 if len(ends) else 1.0
    far = origins + reach * np.broadcast_to(directions, origins.shape)
    cast = (solid.ray_cast(tuple(start), tuple(end)) for start, end in zip(origins.tolist(), far.tolist(), strict=True))
    hits = [(ray, hit.face_id, reach * hit.distance, hit.normal) for ray, its in enumerate(cast) for hit in its]
    if not hits:
        return RayCrossings(np.empty(0, int), np.empty(0, int), np.empty(0), np.empty(0))
    ray, face, distance, normals = (np.array(column) for column in zip(*hits, strict=True))
    along = np.broadcast_to(directions, origins.shape)[ray]
    return RayCrossings(ray, numbers[face].astype(int), distance, np.einsum("cd,cd->c", normals, along))


def solid_of(vertices: np.ndarray, triangles: np.ndarray) -> Solid:
    """The solid between closed surfaces, each triangle with its number; empty where they are not closed.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: outward, shape (triangle_count, 3).
    """
    numbers = np.flatnonzero((triangles != np.roll(triangles, 1, axis=1)).all(axis=1)).astype(np.uint64)
    corners = triangles[numbers].astype(np.uint64)
    return manifold3d.Manifold(manifold3d.Mesh64(np.array(vertices, dtype=float), corners, face_id=numbers))


def inner_points(corners: np.ndarray) -> np.ndarray:
    """A point inside each triangle, shape (count, 3), that lies on no line of symmetry."""
    return np.array([0.41, 0.33, 0.26]) @ corners


RECORD = "mould.json"

FILLED = 1e-3
"""Largest part of the block that parts, silicone and clearances may leave or share [-]."""
REMEDY = "; fill it, part the body there, or choose another --parting"
TOUCH = 0.05
"""Length up to which what lies before a part is not in its way [mm]: less than printers and triangles are exact."""
LINES, GRID = 1500, 40
"""Lines through triangles of each part, at most, and lines of a grid on its longest side, that are looked along."""
PLACES = 10000
"""Rays into a part by which its walls are found, beside one for each triangle."""
SLIVER = 1e-3
"""Least height of a triangle whose normal counts [mm]."""
NEARER = 8
"""Times that the nearest points of two triangles are looked for in turns."""
PARALLEL = 0.9
"""Least cosine between the two sides of a wall [-]."""
PRECISION = 0.01
"""Part of the least thickness that a wall may miss [-]."""


@dataclass(frozen=True)
class Undercut:
    """A place where something holds a part.

    Attributes:
        obstacle: name of the part in its way.
        middle: middle of the place [mm], shape (3,).
        extent: its size along x, y and z [mm], shape (3,).
        triangles: triangles of the part that are held, shape (count,).
    """

    obstacle: str
    middle: np.ndarray
    extent: np.ndarray
    triangles: np.ndarray

    def __str__(self) -> str:
        place = ", ".join(f"{value:.1f}" for value in self.middle + 0.0)
        extent = " x ".join(f"{value:.1f}" for value in self.extent)
        return f"undercut: {self.obstacle} is in its way over {extent} mm around ({place})"


@dataclass(frozen=True)
class CheckedPart:
    """A part and what was found.

    Attributes:
        name: its name in the mould.
        file: its STL file.
        corners: corners of its triangles [mm], shape (count, 3, 3).
        comes_off: direction in which it comes off, shape (3,); None for the one that stays.
        volume: enclosed volume [mm^3].
        closed: whether its surface is closed, and faces outward.
        undercuts: what holds it.
        thickness: least thickness of a wall [mm]; infinite without walls.
        thinnest: the place of that wall [mm], shape (3,).
        thin: triangles of walls too thin to print, shape (count,).
        printed: whether it is printed; silicone is not.
        lost: whether it is melted or dissolved out of the silicone.
        least: least thickness that its walls must have [mm].
    """

    name: str
    file: Path
    corners: np.ndarray
    comes_off: np.ndarray | None
    volume: float
    closed: bool
    undercuts: tuple[Undercut, ...]
    thickness: float
    thinnest: np.ndarray
    thin: np.ndarray
    printed: bool
    lost: bool
    least: float

    @property
    def problems(self) -> list[str]:
        """What is wrong with it, one line each."""
        problems = [] if self.closed else [f"{self.name}: its surface is not closed"]
        for obstacle in dict.fromkeys(undercut.obstacle for undercut in self.undercuts):
            first, *more = (undercut for undercut in self.undercuts if undercut.obstacle == obstacle)
            problems.append(f"{self.name}: {first}" + f", and in {len(more)} more places" * bool(more) + REMEDY)
        if len(self.thin):
            place = ", ".join(f"{value:.1f}" for value in self.thinnest + 0.0)
            fault = "print" if self.printed else f"fill, and must have {self.least:g} mm (--skin): draw it thicker"
            problems.append(f"{self.name}: a wall of {self.thickness:.2f} mm at ({place}) is too thin to {fault}")
        return problems


@dataclass(frozen=True)
class CheckedCast:
    """One mould: its parts and how they fill their block.

    Attributes:
        name: beginning of its files' names.
        parts: in the order in which they come off.
        unfilled: volume of the block less parts, silicone and clearances, as a share of it [-].
    """

    name: str
    parts: tuple[CheckedPart, ...]
    unfilled: float

    @property
    def problems(self) -> list[str]:
        """What is wrong with it, one line each."""
        problems = [problem for part in self.parts for problem in part.problems]
        if not abs(self.unfilled) <= FILLED:
            problems.append(
                f"parts and silicone fill {1 - self.unfilled:.2%} of the block; must be 100 % to {FILLED:.1%}"
            )
        return [f"{self.name}: {problem}" for problem in problems]


def check_mould(folder: Path) -> list[CheckedCast]:
    """Check all moulds that the record in a folder lists."""
    record = read_mould_record(folder)
    return [check_cast(folder, cast, record["printable_mm"], record.get("skin_mm", 0.0)) for cast in record["casts"]]


def read_mould_record(folder: Path) -> dict[str, Any]:
    """The record of a mould."""
    path = folder / RECORD
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        for cast in record["casts"]:
            _ = cast["name"], cast["silicone"], cast["block_mm3"] + cast["clearance_mm3"], cast["pours"]
            _ = [part["file"] + part["part"] for part in cast["parts"]]
        _ = record["printable_mm"] + 0.0, record["name"]
    except OSError as error:
        raise MeshError(f"{path}: not readable: {error.strerror or error}; `taichisoft mould` writes it") from error
    except (ValueError, KeyError, TypeError) as error:
        raise MeshError(f"{path}: is not the record of a mould ({error!r}); `taichisoft mould` writes it") from error
    return dict(record)


def check_cast(folder: Path, cast: Mapping[str, Any], printable: float, skin: float = 0.0) -> CheckedCast:
    """Check one mould, whose walls must be `printable` [mm] thick, and those of the silicone `skin` [mm]."""
    names = [part["part"] for part in cast["parts"]]
    surfaces = [read_surface(folder / part["file"]) for part in cast["parts"]]
    corners = [vertices[triangles] for vertices, triangles in surfaces]
    checked = []
    for number, (part, (vertices, triangles)) in enumerate(zip(cast["parts"], surfaces, strict=True)):
        import trimesh  # takes long

        solid = trimesh.Trimesh(vertices, triangles, process=False)
        direction, printed = part["comes_off"], part["part"] != cast["silicone"]
        others = {its: corners[n] for n, its in enumerate(names) if n > number and not cast["parts"][n].get("lost")}
        held = [] if direction is None else find_undercuts(corners[number], others, np.array(direction))
        thickness, places, walls = wall_thickness(corners[number])
        if not printed and cast.get("sprues_beyond"):
            *way, end = cast["sprues_beyond"]
            inside = places @ np.array(way) < end
            thickness, places, walls = thickness[inside], places[inside], walls[inside]
        least = int(np.argmin(thickness)) if len(thickness) else -1
        needed = printable if printed else skin
        thin = walls[thickness < (1 - PRECISION) * needed]
        checked.append(
            CheckedPart(
                part["part"],
                folder / part["file"],
                corners[number],
                None if direction is None else np.array(direction),
                float(solid.volume),
                bool(solid.is_volume),
                tuple(held),
                float(thickness[least]) if least >= 0 else np.inf,
                places[least] if least >= 0 else np.zeros(3),
                thin,
                printed,
                bool(part.get("lost")),
                needed,
            )
        )
    filled = sum(part.volume for part in checked) + cast["clearance_mm3"]
    return CheckedCast(cast["name"], tuple(checked), 1.0 - filled / cast["block_mm3"])


def find_undercuts(part: np.ndarray, others: Mapping[str, np.ndarray], direction: np.ndarray) -> list[Undercut]:
    """Where other parts are in the way of a part that is drawn off in a straight line.

    On no line in this direction may anything lie before anything of the part. The lines go through triangles of all
    parts that are not parallel to it, and through a grid over the part. Overhangs narrower than twice TOUCH are let be.

    Args:
        part: corners of its triangles [mm], shape (count, 3, 3).
        others: those of the parts that are still there, by name.
        direction: unit vector in which it is drawn off, shape (3,).
    """
    starts, across, spacing = _lines_along(direction, part, list(others.values()))
    steps = spacing * np.array([-1.5, -0.7, -0.3, -0.12, -0.05, 0.0, 0.05, 0.12, 0.3, 0.7, 1.5])
    around = (steps[:, None, None] * across[0] + steps[:, None] * across[1]).reshape(-1, 3)
    undercuts = []
    for name, corners in others.items():
        held = _held_lines(starts, across, direction, part, corners)[0]
        if not len(held):
            continue
        nearby = held[:: 1 + len(held) // 60]  # the size of a place is measured with more lines
        more = np.concatenate([held, (nearby[:, None] + around).reshape(-1, 3)])
        lines, entry, leaving, first = _held_lines(more, across, direction, part, corners)
        pairs = cKDTree(lines).query_pairs(0.8 * spacing, output_type="ndarray")
        cluster = joined_pieces(len(lines), pairs)
        for number in range(cluster.max() + 1):
            of = cluster == number
            ends = np.concatenate([lines[of] + along[of, None] * direction for along in (entry, leaving)])
            lower, upper = ends.min(axis=0), ends.max(axis=0)
            undercuts.append(Undercut(name, (lower + upper) / 2, upper - lower, np.unique(first[of])))
    return undercuts


def _held_lines(
    starts: np.ndarray, across: np.ndarray, direction: np.ndarray, part: np.ndarray, obstacle: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of some lines those on which an obstacle lies before a part, where they enter the part and leave the obstacle
    [mm], and the triangle through which they enter."""
    for shift in TOUCH * np.concatenate([[np.zeros(3)], across, -across]):  # else the corners of round faces hold
        if len(starts):
            enters, leaves = (_extent_along(starts + shift, direction, corners) for corners in (part, obstacle))
            starts = starts[leaves[1] > enters[0] + TOUCH]
    entry, _, first = _extent_along(starts, direction, part)
    return starts, entry, _extent_along(starts, direction, obstacle)[1], first


def wall_thickness(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thickness of the walls behind triangles of a closed surface.

    From points in each triangle, more in large ones, rays go into the body at right angles; where one leaves nearly at
    a right angle there is a wall. It is as thick as the two triangles, its own and the one behind it, are near each
    other, if their nearest points lie across it.

    Returns:
        Thickness [mm], shape (count,), the places, (count, 3), and the triangles, (count,).
    """
    normals = area_vectors(corners)
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-30)[:, None]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    chosen = np.flatnonzero(areas > SLIVER * longest)
    chosen = np.repeat(chosen, 1 + (areas[chosen] / areas.sum() * PLACES).astype(int))
    shares = (0.5 + np.outer(np.arange(len(chosen)), [0.7548776662466927, 0.5698402909980532])) % 1.0  # evenly spread
    shares = np.where(shares.sum(axis=1, keepdims=True) > 1, 1 - shares, shares)
    begin = corners[chosen]
    points = begin[:, 0] + np.einsum("nk,nkd->nd", shares, begin[:, 1:] - begin[:, :1])
    crossings = ray_crossings(points, -normals[chosen], corners)
    ahead = np.flatnonzero((crossings.distance > 1e-5) & (crossings.triangle != chosen[crossings.ray]))
    ahead = ahead[np.lexsort((crossings.distance[ahead], crossings.ray[ahead]))]
    ahead = ahead[np.unique(crossings.ray[ahead], return_index=True)[1]]
    ahead = ahead[crossings.cosine[ahead] > PARALLEL]
    ray, behind, thickness = crossings.ray[ahead], crossings.triangle[ahead], crossings.distance[ahead]
    if not len(ray):
        return thickness, np.empty((0, 3)), chosen[ray]
    from trimesh.triangles import closest_point  # takes long

    here, its = points[ray], chosen[ray]
    near = closest_point(corners[behind], here)
    for _ in range(NEARER):
        here = closest_point(corners[its], near)
        near = closest_point(corners[behind], here)
    between = near - here
    nearest = np.linalg.norm(between, axis=1)
    across = -np.einsum("nd,nd->n", between, normals[its]) > PARALLEL * nearest
    return np.where(across, np.minimum(nearest, thickness), thickness), here, its


def _lines_along(
    direction: np.ndarray, part: np.ndarray, others: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Starts of lines in a direction, before everything, shape (count, 3), two unit vectors across it, and the spacing
    of the grid among the lines [mm]."""
    points = []
    for corners in (part, *others):
        facing = corners[np.abs(area_vectors(corners) @ direction) > 1e-4]
        points.append(inner_points(facing[:: 1 + len(facing) // LINES]))
    across = np.linalg.svd(direction[None])[2][1:]
    flat = part.reshape(-1, 3) @ across.T
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    spacing = float((upper - lower).max()) / GRID
    # Shifted by an odd share of the spacing, so that no line runs along edges of a symmetric part.
    rows = [np.arange(low + 0.317 * spacing, high, spacing) for low, high in zip(lower, upper, strict=True)]
    points.append(np.stack([row.ravel() for row in np.meshgrid(*rows)], axis=1) @ across)
    starts = np.concatenate(points)
    bottom = min(float((corners @ direction).min()) for corners in (part, *others)) - 1.0
    return starts + (bottom - starts @ direction)[:, None] * direction, across, spacing


def _extent_along(
    starts: np.ndarray, direction: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each line first enters a part and last leaves it [mm], and the triangle through which it enters.

    They are infinity, minus infinity and -1 for a line that misses the part, or that enters and leaves it not equally
    often, because it hits an edge.
    """
    crossings = ray_crossings(starts, direction, corners)
    count = len(starts)
    entry, leaving, first = np.full(count, np.inf), np.full(count, -np.inf), np.full(count, -1)
    order = np.argsort(-crossings.distance, kind="stable")  # the nearest is written last
    entry[crossings.ray[order]] = crossings.distance[order]
    first[crossings.ray[order]] = crossings.triangle[order]
    np.maximum.at(leaving, crossings.ray, crossings.distance)
    odd = np.bincount(crossings.ray, np.sign(crossings.cosine), count) != 0
    entry[odd], leaving[odd], first[odd] = np.inf, -np.inf, -1
    return entry, leaving, first
