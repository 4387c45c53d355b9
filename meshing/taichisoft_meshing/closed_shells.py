"""Surface files: taken apart into closed shells, of which one is the outside of a body and the others its cavities."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from taichisoft.base import warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import common_points, enclosed_volume, joined_pieces, pairs_of_meeting_boxes, read_surface
from taichisoft_meshing.wall_quality import winding_numbers

# Lengths, edges and angles of triangulated surfaces.

NEAR = 1e-6
"""Distance at which points count as one, as a share of the surface's diagonal [-]. Single precision, which STL has,
rounds coordinates to a tenth of it."""


def diagonal(vertices: np.ndarray) -> float:
    """Length of the diagonal of the box around the vertices [mm]."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles with these corners [mm], shape (count, 3, 3), as long as twice their areas [mm^2]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def undirected_sides(triangles: np.ndarray) -> np.ndarray:
    """The sides of all triangles, the lower vertex first, shape (3 * triangle_count, 2)."""
    return np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)


def joined_sides(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges of a closed surface, and the two sides of triangles that each joins.

    Returns:
        Edges as vertex indices, the lower first, shape (edge_count, 2), and sides, shape (edge_count, 2): side s of
        triangle t, from its corner s to the next, has the number 3 * t + s; the lower number stands first.
    """
    edges, edge = np.unique(undirected_sides(triangles), axis=0, return_inverse=True)
    return edges, np.argsort(edge.ravel(), kind="stable").reshape(-1, 2)


def facing_sides(triangles: np.ndarray) -> np.ndarray:
    """The pairs of sides, numbered as in `joined_sides`, at edges of exactly two triangles, shape (pair_count, 2)."""
    _, edge, counts = np.unique(undirected_sides(triangles), axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    two = np.flatnonzero(counts[edge] == 2)
    pairs: np.ndarray = two[np.argsort(edge[two], kind="stable")].reshape(-1, 2)
    return pairs


def angles_between(normals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Angles [rad] between the normals, shape (triangle_count, 3), of pairs of triangles, shape (pair_count, 2)."""
    first, second = normals[pairs[:, 0]], normals[pairs[:, 1]]
    return np.arctan2(np.linalg.norm(np.cross(first, second), axis=1), np.einsum("nd,nd->n", first, second))


@dataclass(frozen=True, eq=False)
class Shell:
    """A closed surface in one piece, which faces outward: it encloses a positive volume of silicone or air.

    Attributes:
        source: its file, and its number among the file's shells; errors begin with it.
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        was_inward: whether it faces inward in its file.
    """

    source: str
    vertices: np.ndarray
    triangles: np.ndarray
    was_inward: bool

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [mm^3]."""
        return enclosed_volume(self.vertices, self.triangles)


def read_shells(path: Path, scale: float = 1.0) -> list[Shell]:
    """Read an STL, OBJ or PLY file of closed surfaces; `scale` is the millimetres in one unit of the file."""
    vertices, triangles = read_surface(path)
    return closed_shells(scale * vertices, triangles, str(path))


def closed_shells(vertices: np.ndarray, triangles: np.ndarray, source: str) -> list[Shell]:
    """Take a surface apart, in the order of its triangles.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: begins every error and warning.
    """
    triangles = _with_merged_vertices(vertices, triangles, source)
    piece = joined_pieces(len(triangles), _neighbours(vertices, triangles, source))
    order = np.argsort(np.unique(piece, return_index=True)[1]).tolist()
    names = [f"{source}, shell {number + 1} of {len(order)}" for number in range(len(order))]
    named = zip(order, names if len(order) > 1 else [source], strict=True)
    return [_shell(vertices, triangles[piece == number], name) for number, name in named]


def _with_merged_vertices(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles with one vertex for all at nearly the same place, without triangles that vanish so."""
    near = NEAR * diagonal(vertices)
    pairs = cKDTree(vertices).query_pairs(near, output_type="ndarray")
    if not len(pairs):
        return triangles
    cluster = joined_pieces(len(vertices), pairs)
    _, first = np.unique(cluster, return_index=True)
    merged = f"{len(vertices) - len(first)} vertices lie within {near:.2g} mm of another one and are merged with it"
    warn_caller(f"{source}: {merged}")
    triangles = first[cluster][triangles]
    kept: np.ndarray = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    return kept


def _neighbours(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The two triangles at each edge, shape (edge_count, 2)."""
    edges, edge, counts = np.unique(undirected_sides(triangles), axis=0, return_inverse=True, return_counts=True)
    for wrong, what, remedy in (
        (counts > 2, "edges of more than two triangles", "remove double triangles and walls inside"),
        (counts < 2, "edges of one triangle only", "fill the hole"),
    ):
        if wrong.any():
            begin, end = np.round(vertices[edges[np.argmax(wrong)]], 3).tolist()
            raise MeshError(
                f"{source}: is not a closed surface: it has {what} ({wrong.sum()}), "
                f"the first from {begin} to {end} mm; {remedy}"
            )
    owners: np.ndarray = np.argsort(edge.ravel(), kind="stable").reshape(-1, 2) // 3
    return owners


def _shell(vertices: np.ndarray, triangles: np.ndarray, source: str) -> Shell:
    triangles = _facing_one_side(vertices, triangles, source)
    used, corners = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], corners.reshape(-1, 3).astype(np.int32)
    _refuse_flat_triangles(vertices, triangles, source)
    _refuse_pinches(vertices, triangles, source)
    volume = enclosed_volume(vertices, triangles)
    if abs(volume) <= 1e-12 * np.ptp(vertices, axis=0).max() ** 3:
        raise MeshError(f"{source}: encloses no volume")
    return Shell(source, vertices, triangles if volume > 0 else np.ascontiguousarray(triangles[:, ::-1]), volume < 0)


def _facing_one_side(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles, all of which face one side of a closed shell."""
    import trimesh  # takes long, and fingers do without

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if mesh.is_winding_consistent:
        return triangles
    trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise MeshError(f"{source}: has one side only, like a Moebius strip or a Klein bottle; it encloses nothing")
    faces = np.ascontiguousarray(mesh.faces, dtype=triangles.dtype)
    areas = np.linalg.norm(area_vectors(vertices[triangles]), axis=1)
    if 2 * areas[(faces != triangles).any(axis=1)].sum() > areas.sum():  # the larger part stays as it is
        faces = np.ascontiguousarray(faces[:, ::-1])
    warn_caller(f"{source}: triangles that face the other way than their neighbours are turned round")
    return faces


def _refuse_flat_triangles(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    corners = vertices[triangles]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    flat = np.flatnonzero(np.linalg.norm(area_vectors(corners), axis=1) <= NEAR * diagonal(vertices) * longest)
    if len(flat):
        place = np.round(corners[flat[0]].mean(axis=0), 3).tolist()
        raise MeshError(
            f"{source}: triangle {flat[0]} at {place} mm has no area ({len(flat)} such triangles); "
            "remove them in the program that the surface comes from"
        )


def _refuse_pinches(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    """Around each vertex the triangles must be one fan: two that meet in a tip only are a joint without strength."""
    _, begin = joined_sides(triangles)  # a corner has the number of the side that begins at it
    end = begin - begin % 3 + (begin + 1) % 3
    # Neighbours pass their common edge in opposite directions.
    fan = joined_pieces(triangles.size, np.vstack([np.column_stack([begin[:, i], end[:, 1 - i]]) for i in (0, 1)]))
    fans = np.unique(np.column_stack([triangles.ravel(), fan]), axis=0)[:, 0]
    pinched = np.flatnonzero(np.bincount(fans) > 1)
    if len(pinched):
        place = np.round(vertices[pinched[0]], 3).tolist()
        raise MeshError(f"{source}: touches itself in a single point at {place} mm; widen the joint or part it")


# Places where closed surfaces go through themselves or each other, or touch.
#
# Two triangles that cross have an edge of one that goes through the other, so edges are cut with triangles that share
# no vertex with them. Triangles that lie upon each other have no such edge, but a vertex of one lies in the other.

SAME_SHELL_NEAR = 1e-9
"""Distance at which a vertex lies in a triangle of its own shell, as a share of the diagonal [-]. Fine meshes have thin
triangles, so NEAR, the distance at which different shells touch, would be too large."""

FOLDED = 1e-6
"""Largest angle between two neighbours that lie upon each other [rad]."""


@dataclass(frozen=True)
class Crossings:
    """Pairs of triangles that cross or touch.

    Attributes:
        triangles: the two triangles of each pair, the lower number first, each pair once, shape (count, 2).
        places: a point in both [mm], shape (count, 3).
    """

    triangles: np.ndarray
    places: np.ndarray


def find_crossings(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> Crossings:
    """Cut all triangles of some closed shells with each other.

    Args:
        vertices: positions [mm], shape (vertex_count, 3); no two shells have one in common.
        triangles: vertex indices, shape (triangle_count, 3).
        shell: number of the shell of each triangle, shape (triangle_count,).
    """
    edges, sides = joined_sides(triangles)
    own = sides[:, 0] // 3
    parts = [_folds(vertices[triangles], sides // 3)]
    size = diagonal(vertices)
    for edge, triangle in pairs_of_meeting_boxes(vertices[edges], vertices[triangles], NEAR * size):
        apart = (edges[edge][:, :, None] != triangles[triangle][:, None, :]).all(axis=(1, 2))
        edge, triangle = edge[apart], triangle[apart]
        reach = np.where(shell[own[edge]] == shell[triangle], SAME_SHELL_NEAR, NEAR) * size
        place = common_points(vertices[edges[edge]], vertices[triangles[triangle]], reach)
        hit = np.isfinite(place).all(axis=1)
        parts.append((np.column_stack([own[edge], triangle])[hit], place[hit]))
    pairs = np.sort(np.vstack([pairs for pairs, _ in parts]), axis=1)
    pairs, once = np.unique(pairs, axis=0, return_index=True)
    return Crossings(pairs, np.vstack([places for _, places in parts])[once])


def _folds(corners: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours that lie upon each other, as across their common edge the surface turns back, and a place in each."""
    folded = neighbours[angles_between(area_vectors(corners), neighbours) > np.pi - FOLDED]
    return folded, corners[folded[:, 0]].mean(axis=1)


@dataclass(frozen=True)
class HollowBody:
    """A body of silicone between closed surfaces.

    Attributes:
        outer: surface of its outside.
        cavities: walls of its air chambers, in the order of the files; may be empty.
    """

    outer: Shell
    cavities: tuple[Shell, ...]

    @property
    def cavity_volumes(self) -> tuple[float, ...]:
        """Volumes of the cavities [mm^3]."""
        return tuple(cavity.volume for cavity in self.cavities)

    @property
    def volume(self) -> float:
        """Volume of the silicone [mm^3]."""
        return self.outer.volume - sum(cavity.volume for cavity in self.cavities)

    @property
    def extent(self) -> np.ndarray:
        """Edge lengths of the box around it along x, y and z [mm], shape (3,)."""
        extent: np.ndarray = np.ptp(self.outer.vertices, axis=0)
        return extent


def read_hollow_body(outer: Path, cavities: Sequence[Path] = (), scale: float = 1.0, unite: bool = False) -> HollowBody:
    """Read a body from surface files.

    Args:
        outer: file of the outside, and perhaps of cavities.
        cavities: files of cavities; a cavity that `outer` has too counts once.
        scale: millimetres in one unit of the files.
        unite: whether the shells of `outer` that face as the largest does are parts, which are joined to one.
    """
    shells = read_shells(outer, scale)
    return hollow_body(
        _united(shells, outer) if unite else shells, [shell for path in cavities for shell in read_shells(path, scale)]
    )


def _united(shells: Sequence[Shell], path: Path) -> list[Shell]:
    """The union of all shells that face the same way as the largest, then the others, which are chambers."""
    import trimesh  # takes long, and fingers do without

    facing = max(shells, key=lambda shell: shell.volume).was_inward
    parts = [shell for shell in shells if shell.was_inward == facing]
    if len(parts) == 1:
        raise MeshError(f"{path}: unite = true: has one part only, and {len(shells) - 1} chambers; remove unite")
    union = trimesh.boolean.union(
        [trimesh.Trimesh(part.vertices, part.triangles, process=False) for part in parts], engine="manifold"
    )
    chambers = [replace(shell, was_inward=True) for shell in shells if shell.was_inward != facing]
    return [*closed_shells(np.asarray(union.vertices), np.asarray(union.faces, dtype=np.int32), f"{path}"), *chambers]


def hollow_body(shells: Sequence[Shell], cavities: Sequence[Shell] = ()) -> HollowBody:
    """Make a body of shells that lie inside one of them.

    Args:
        shells: the outside and perhaps cavities, in any order.
        cavities: further cavities; one that is among `shells` too counts once.
    """
    outermost = max(shells, key=lambda shell: shell.volume)
    known = [shell for shell in shells if shell is not outermost]
    cavities = [cavity for cavity in cavities if not any(_same(cavity, shell) for shell in known)]
    every = [*shells, *cavities]
    _refuse_crossings(every, outermost)
    depth = np.sum(_is_inside(every), axis=1)
    outside = [shell for shell, around in zip(every, depth, strict=True) if around == 0]
    for shell, around in zip(every, depth, strict=True):
        if around == 0 and any(shell is cavity for cavity in cavities):
            raise MeshError(
                f"{shell.source}: the cavity is not inside {outermost.source}: it spans {_extent(shell)}, "
                f"the body {_extent(outermost)}; both files must have the same axes and unit"
            )
        if around > 1:
            raise MeshError(f"{shell.source}: lies inside a cavity (it spans {_extent(shell)}); remove it")
    if len(outside) != 1:
        volumes = ", ".join(f"{body.volume:.4g}" for body in outside)
        source = _file(outside[0])
        raise MeshError(
            f"{source}: has {len(outside)} bodies, of {volumes} mm^3, where one is expected; keep one of them"
        )
    inner = [shell for shell in every if shell is not outermost]
    for shell in inner:
        if shell in known and shell.was_inward == outermost.was_inward:
            warn_caller(f"{shell.source}: faces the same way as the outer surface; taken for a cavity")
    if outermost.was_inward:
        warn_caller(f"{outermost.source}: is inside out; its triangles are turned round")
    return HollowBody(outermost, tuple(inner))


def _same(first: Shell, second: Shell) -> bool:
    """Whether two shells have the same vertices, up to the rounding of single precision, and the same volume."""
    if len(first.vertices) != len(second.vertices) or abs(first.volume - second.volume) > 1e-5 * first.volume:
        return False
    near = NEAR * diagonal(first.vertices)
    distances, partners = cKDTree(first.vertices).query(second.vertices)
    return bool(distances.max() <= near) and len(np.unique(partners)) == len(partners)


def _refuse_crossings(shells: Sequence[Shell], outermost: Shell) -> None:
    starts = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
    triangle_starts = np.cumsum([0, *(len(shell.triangles) for shell in shells)])
    owner = np.repeat(np.arange(len(shells)), np.diff(triangle_starts))
    crossings = find_crossings(
        np.vstack([shell.vertices for shell in shells]),
        np.vstack([shell.triangles + start for shell, start in zip(shells, starts, strict=False)]),
        owner,
    )
    if not len(crossings.triangles):
        return
    involved = owner[crossings.triangles]
    first, second = involved[0].tolist()
    count = (involved == involved[0]).all(axis=1).sum()
    numbers = " and ".join(map(str, (crossings.triangles[0] - triangle_starts[involved[0]]).tolist()))
    pairs = f"{count} pair{'' if count == 1 else 's'} of triangles"
    where = f"{pairs}, the first ({numbers}) at {_rounded(crossings.places[0])} mm"
    if first == second:
        raise MeshError(f"{shells[first].source}: cuts through itself: {where}")
    if shells[second] is outermost:
        first, second = second, first
    alike = _file(shells[first]) == _file(shells[second]) and shells[first].was_inward == shells[second].was_inward
    parts = "; both face the same way: if they are parts of one body, unite = true joins them" if alike else ""
    crossed = "the outer surface" if shells[first] is outermost else "another cavity"
    if _extent(shells[first]) == _extent(shells[second]):
        parts = f"; both span {_extent(shells[first])}: if they are the same, leave one out"
    raise MeshError(
        f"{shells[second].source}: crosses or touches {crossed}, {shells[first].source}: {where}; "
        f"silicone must remain between them{parts}"
    )


def _file(shell: Shell) -> str:
    return shell.source.partition(", shell ")[0]


def _is_inside(shells: Sequence[Shell]) -> np.ndarray:
    """Whether shell i lies inside shell j, shape (shell_count, shell_count), for shells that do not cross."""
    points = np.array([shell.vertices[0] for shell in shells])
    inside = np.column_stack([winding_numbers(points, shell.vertices[shell.triangles]) > 0.5 for shell in shells])
    np.fill_diagonal(inside, False)
    return inside


def _extent(shell: Shell) -> str:
    return f"{_rounded(shell.vertices.min(axis=0))} to {_rounded(shell.vertices.max(axis=0))} mm"


def _rounded(point: np.ndarray) -> list[float]:
    return [float(value) for value in np.round(point, 3)]
