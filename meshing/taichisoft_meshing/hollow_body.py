"""One outer surface and the cavities in it, identified and checked: silicone must remain between any two of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from taichisoft.base import warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import common_points, pairs_of_meeting_boxes
from taichisoft_meshing.closed_shells import (
    NEAR,
    Shell,
    angles_between,
    area_vectors,
    diagonal,
    joined_sides,
    read_shells,
)
from taichisoft_meshing.wall_quality import winding_numbers

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
    found = [_folds(vertices[triangles], sides // 3)]
    size = diagonal(vertices)
    for edge, triangle in pairs_of_meeting_boxes(vertices[edges], vertices[triangles], NEAR * size):
        apart = (edges[edge][:, :, None] != triangles[triangle][:, None, :]).all(axis=(1, 2))
        edge, triangle = edge[apart], triangle[apart]
        reach = np.where(shell[own[edge]] == shell[triangle], SAME_SHELL_NEAR, NEAR) * size
        place = common_points(vertices[edges[edge]], vertices[triangles[triangle]], reach)
        hit = np.isfinite(place).all(axis=1)
        found.append((np.column_stack([own[edge], triangle])[hit], place[hit]))
    pairs = np.sort(np.vstack([pairs for pairs, _ in found]), axis=1)
    pairs, once = np.unique(pairs, axis=0, return_index=True)
    return Crossings(pairs, np.vstack([places for _, places in found])[once])


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


def read_hollow_body(outer: Path, cavities: Sequence[Path] = (), scale: float = 1.0) -> HollowBody:
    """Read a body from surface files.

    Args:
        outer: file of the outside, and perhaps of cavities.
        cavities: files of cavities; a cavity that `outer` has too counts once.
        scale: millimetres in one unit of the files.
    """
    return hollow_body(read_shells(outer, scale), [shell for path in cavities for shell in read_shells(path, scale)])


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
        source = outside[0].source.partition(", shell ")[0]
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


def _same(one: Shell, other: Shell) -> bool:
    """Whether two shells have the same vertices, up to the rounding of single precision, and the same volume."""
    if len(one.vertices) != len(other.vertices) or abs(one.volume - other.volume) > 1e-5 * one.volume:
        return False
    near = NEAR * diagonal(one.vertices)
    distances, partners = cKDTree(one.vertices).query(other.vertices)
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
    one, other = involved[0].tolist()
    count = (involved == involved[0]).all(axis=1).sum()
    numbers = " and ".join(map(str, (crossings.triangles[0] - triangle_starts[involved[0]]).tolist()))
    pairs = f"{count} pair{'' if count == 1 else 's'} of triangles"
    where = f"{pairs}, the first ({numbers}) at {_rounded(crossings.places[0])} mm"
    if one == other:
        raise MeshError(f"{shells[one].source}: cuts through itself: {where}")
    if shells[other] is outermost:
        one, other = other, one
    crossed = "the outer surface" if shells[one] is outermost else "another cavity"
    raise MeshError(
        f"{shells[other].source}: crosses or touches {crossed}, {shells[one].source}: {where}; "
        "silicone must remain between them"
    )


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
