"""Where contacts press a soft body's surface: contact areas, pressures, and forces on the patches of tactile arrays."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve

from taichisoft.base.rotations import matrices_from_quaternions
from taichisoft.contact.model import Model
from taichisoft.control.figures import Pair
from taichisoft.errors import SceneError
from taichisoft.mechanics.state import State
from taichisoft.mesh.surface import vertex_normals

FACING = np.sqrt(0.5)
"""Least cosine between the normal of a triangle and the opposite one of what it touches; side walls face nothing."""
TOUCHING = 1e-3
"""Largest gap of surfaces that touch [mm]: ten times what the contact law tolerates (`contact/surfaces.py`)."""
NEAR_EDGE = 0.1
"""Barycentric weight below which a contact is in the triangle beyond the edge as well."""
SAG = 0.05
"""Gap below which a triangle touches whose corners are pressed, as a share of its longest edge: round surfaces touch
flat triangles inside, and their corners hang beside."""
RIM = 0.4
"""Share of the range of its gap up to which a triangle at the rim touches: areas of discs of 2.5 elements' radius and
more, with the gap of Hertz's law beside them, come out 2 to 4 % too large in the mean over places on a regular mesh."""
PARTS = 4
"""Parts of a triangle's edges, over each of which the distance from a ball or capsule is taken as linear."""
RESOLVED = 0.98
"""Least mean cosine between a triangle and the smaller piece of a surface opposite that it can follow."""
DENSE = 300
"""Most cells whose pressures a dense matrix has: a sparse one of few takes ten times as long."""
EVENED, THINNED = 0.25, 4.0
"""Area over which pressures are spread, as shares of that of a cell: anyway, which takes 2 to 4 % off the peak of a
ball's contact of four to six elements' radius, and for each cell that no contact carries beside one that does."""
BEYOND = 1.25
"""How many times the area of the cells at the rim the area may be off: balls that are pressed into smoothed elements of
0.5 to 1.2 of the contact's radius, at any Poisson's ratio, touch up to 1.2 times that too much."""
NOTHING = 1e-12
"""Least share of a triangle."""

Pieces = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Parts of triangles that one plane face lies opposite to: number of the triangle, shape (count,), convex polygon in
its barycentric coordinates, (count, corners, 3), distance of its three corners from the plane [mm], (count, 3), and
cosine between the one normal and the opposite of the other, (count,)."""
Facing = Callable[[np.ndarray, np.ndarray, np.ndarray], Pieces]
"""Finds the pieces of triangles, given their corners [mm], (count, 3, 3), their unit normals, (count, 3), and how far
from each to look [mm], (count,)."""


@dataclass(frozen=True)
class ContactPatch:
    """Where two bodies press each other, on the surface of one that is soft.

    What touches is that part of the triangles that face the other body whose gap is closed. The force of each contact
    goes to the corners of the triangle below it by barycentric coordinates, as in the step. A corner stands for a cell,
    the integral of its shape function over what lies opposite, and the forces over the cells are the pressures, evened
    out as `_spread` says. None is below the mean.

    Attributes:
        body: name of the soft body.
        triangles: numbers of the triangles that touch, in the body's surface, shape (count,).
        middle: barycentric coordinates of the middle of the touching part of each, shape (count, 3).
        forces: normal force on each [mN], shape (count,).
        pressures: at the corners of each [kPa], shape (count, 3).
        area: of all of them, projected along the normal of the contact, half of it in self-contact [mm^2].
        area_error: 1.25 times the area of the cells through which the rim of the contact goes [mm^2].
        peak: highest pressure [kPa]; the mesh limits how narrow a peak it can show.
        peak_error: how far the pressure changes from there to the cells around, the share of it by which the area there
            is unknown and half the share of all the area, and what evening out over cells without a contact took off
            [kPa].
    """

    body: str
    triangles: np.ndarray
    middle: np.ndarray
    forces: np.ndarray
    pressures: np.ndarray
    area: float
    area_error: float
    peak: float
    peak_error: float


class ContactPatches:
    """Finds the patches of a model's states."""

    def __init__(self, model: Model):
        """Join the surfaces of the soft bodies."""
        self._model, bodies = model, model.soft_bodies
        self._last: tuple[State | None, Any] = (None, None)
        sizes = [len(body.surface.nodes) for body in bodies]
        self._start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        counts = [len(body.surface.triangles) for body in bodies]
        self._first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._triangles = np.vstack(
            [
                np.zeros((0, 3), np.int64),
                *(body.surface.triangles + start for body, start in zip(bodies, self._start[:-1], strict=True)),
            ]
        )
        self._rest = np.vstack([np.zeros((0, 3)), *(body.surface.positions(body.mesh.nodes) for body in bodies)])
        corners = self._triangles.ravel()
        order, count = np.argsort(corners, kind="stable"), np.bincount(corners, minlength=len(self._rest))
        column = np.arange(len(corners)) - np.repeat(np.cumsum(count) - count, count)
        self._fans = np.full((len(self._rest), int(count.max(initial=1))), -1)
        self._fans[corners[order], column] = order // 3

    def patches(self, state: State) -> dict[Pair, ContactPatch]:
        """The patches by pair of bodies, in the scene's order; pairs of which none is soft have none.

        Of two soft bodies the patch is on the one whose mesh leaves the area less unknown.
        """
        names, pairs = self._model.body_names, state.contact_body_pair
        rows = np.flatnonzero((self._pressing(state) > 0.0) & (pairs < len(self._model.soft_bodies)).any(axis=1))
        patches: dict[Pair, ContactPatch] = {}
        for first, second in np.unique(pairs[rows], axis=0).tolist():
            sides = self._sides(state, (first, second), rows[(pairs[rows] == (first, second)).all(axis=1)])
            best = min(sides.values(), key=lambda side: side.area_error / side.area)
            patches[names[first], names[second]] = best
        return patches

    def tactile(self, state: State) -> dict[str, np.ndarray]:
        """Normal force on each patch of the tactile arrays [mN], by their names, of the shape of `patches`."""
        arrays = {body.name: body.settings.tactile for body in self._model.soft_bodies}
        felt = {f"{body}.{name}": np.zeros(array.patches) for body in arrays for name, array in arrays[body].items()}
        force, pairs = self._pressing(state), state.contact_body_pair
        for number, body in enumerate(self._model.soft_bodies):
            touching = (pairs == number).any(axis=1) & (force > 0.0) & bool(arrays[body.name])
            for first, second in np.unique(pairs[touching], axis=0).tolist():
                rows = np.flatnonzero(touching & (pairs == (first, second)).all(axis=1))
                side = self._sides(state, (first, second), rows)[number]
                corners = self._triangles[self._first[number] + side.triangles]
                points = np.einsum("tk,tkd->td", side.middle, self._rest[corners])
                for name, table in arrays[body.name].items():
                    low_high = zip(*table.box, table.patches, strict=True)
                    cells = [np.linspace(low, high, n + 1) for low, high, n in low_high]
                    felt[f"{body.name}.{name}"] += np.histogramdd(points, cells, weights=side.forces)[0]
        return felt

    def check_tactile_arrays(self) -> None:
        """Check that every tactile array has a part of the surface of its body."""
        for body, start in zip(self._model.soft_bodies, self._start[:-1], strict=True):
            for name, table in body.settings.tactile.items():
                corners, (low, high) = self._rest[body.surface.triangles + start], table.box
                inside = (corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)
                if not inside.all(axis=1).any():
                    ends = [getattr(body.mesh.nodes, end)(axis=0).round(3).tolist() for end in ("min", "max")]
                    raise SceneError(
                        f"soft_bodies.{body.name}.tactile.{name}: no part of the surface is in box = {table.box}; the "
                        f"mesh reaches from {ends[0]} to {ends[1]}"
                    )

    def _pressing(self, state: State) -> np.ndarray:
        """Normal force of each contact [mN], shape (contact_count,)."""
        along: np.ndarray = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        return along / self._model.scene.time.step

    def _sides(self, state: State, pair: tuple[int, int], rows: np.ndarray) -> dict[int, ContactPatch]:
        """The patch of a pair of bodies on each of its soft bodies, by its number; of self-contact, both sides."""
        before, now = self._surfaces_of(state)
        force = self._pressing(state)[rows, None] * state.contact_normal[rows]
        patches: dict[int, ContactPatch] = {}
        points, normals, (first, second) = state.contact_point[rows], state.contact_normal[rows], pair
        if first == second:
            below, weights = self._below((before, now), np.vstack([points] * 2), first, np.vstack([normals, -normals]))
            facing, both = self._facing(state, first, now), np.vstack([force, -force])
            patch = self._patch(now, first, facing, below, weights, both)
            return {first: replace(patch, area=0.5 * patch.area, area_error=0.5 * patch.area_error)}
        for body, other, sign in ((first, second, 1.0), (second, first, -1.0)):
            if body < len(self._model.soft_bodies):
                triangle, weights = self._below((before, now), points, body)
                patches[body] = self._patch(now, body, self._facing(state, other, now), triangle, weights, sign * force)
        return patches

    def _surfaces_of(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """The joined surfaces at the start and at the end of the step [mm], once for all pairs of a state."""
        known, surfaces = self._last
        if known is not state:
            step = self._model.scene.time.step
            surfaces = self._placed(state.position - step * state.velocity), self._placed(state.position)
            self._last = state, surfaces
        return surfaces

    def _placed(self, position: np.ndarray) -> np.ndarray:
        """The joined surfaces with the nodes at `position` [mm], shape (vertex_count, 3)."""
        bodies = self._model.soft_bodies
        return np.vstack([np.zeros((0, 3)), *(body.surface.positions(position[body.nodes]) for body in bodies)])

    def _patch(
        self,
        placed: np.ndarray,
        body: int,
        facing: Facing,
        below: np.ndarray,
        weights: np.ndarray,
        force: np.ndarray,
    ) -> ContactPatch:
        """The patch on a soft body of what `facing` describes.

        Args:
            placed: the joined surfaces [mm].
            body: number of the soft body.
            facing: the pieces of triangles, given their corners and unit normals, that another body faces.
            below, weights: triangle of each contact and its barycentric coordinates there.
            force: outward normal force of each contact [mN], shape (count, 3).
        """
        size, corners = np.linalg.norm(force, axis=1), self._triangles[below]
        load = np.bincount(corners.ravel(), (size[:, None] * weights).ravel(), len(placed))
        load[load < NOTHING * size.sum()] = 0.0
        seen, cells, covered, unresolved = self._cells(placed, facing, below, weights, np.flatnonzero(load))
        corners = self._triangles[seen]
        area, most = (np.bincount(corners.ravel(), parts.ravel(), len(placed)) for parts in (cells, covered))
        bare = np.flatnonzero((load > 0.0) & (area == 0.0))
        if len(bare):
            # An edge or a corner that presses without a face stands for a third of the triangles around, seen along it.
            along = np.zeros((len(placed), 3))
            np.add.at(along, self._triangles[below].ravel(), (weights[:, :, None] * force[:, None]).reshape(-1, 3))
            along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
            third = np.abs(np.einsum("td,tkd->tk", _cross_of(placed[corners]), along[corners])) / 6.0
            cells = cells + np.where(np.isin(corners, bare), np.maximum(third, NOTHING), 0.0)
            area[bare] = most[bare] = np.bincount(corners.ravel(), cells.ravel(), len(placed))[bare]
        # The rim of the contact goes through cells that do not touch as far as the other body lies opposite.
        unknown = np.clip(3.0 * (1.0 - area / np.maximum(most, 1e-300)), 0.0, 1.0)
        at = np.flatnonzero(cells.any(axis=1))
        unknown[corners[unresolved]] = unknown[bare] = 1.0
        seen, cells, corners, areas = seen[at], cells[at], corners[at], cells[at].sum(axis=1)
        unloaded = np.count_nonzero((area > 0.0) & (unknown == 0.0) & (load == 0.0)) / np.count_nonzero(load)
        pair_size = np.linalg.norm(_cross_of(placed[corners]), axis=1)
        uneven = pressure = _spread(load, most, corners, EVENED * pair_size)
        if unloaded:
            pressure = _spread(load, most, corners, (EVENED + THINNED * unloaded) * pair_size)
        forces = (cells * (pressure * most / np.maximum(area, 1e-300))[corners]).sum(axis=1)
        top = int(pressure.argmax())
        peak = max(float(pressure[top]), float(size.sum() / areas.sum()))
        around, error = corners[(corners == top).any(axis=1)], BEYOND * float(area @ unknown)
        share = float(unknown[top] + 0.5 * error / areas.sum())
        return ContactPatch(
            body=self._model.body_names[body],
            triangles=seen - self._first[body],
            middle=cells / areas[:, None],
            forces=forces,
            pressures=pressure[corners],
            area=float(areas.sum()),
            area_error=error,
            peak=peak,
            peak_error=float(np.ptp(pressure[around]) + peak * share + max(uneven.max() - peak, 0.0)),
        )

    def _cells(
        self, placed: np.ndarray, facing: Facing, below: np.ndarray, weights: np.ndarray, loaded: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Triangles at and around what touches, the areas that `_touching` finds, and which are too coarse for it.

        Found from the `loaded` vertices on, over all that touches beside what touches.
        """
        corners = self._triangles[below]
        share = np.bincount(corners.ravel(), weights.ravel(), len(placed))
        pressed, is_seen = np.zeros((2, len(self._triangles)), dtype=bool)
        pressed[self._holding(corners, weights)] = True
        parts, new = [], self._around(self._triangles[self._around(loaded)])
        while len(new):
            touching, covered, coarse = self._touching(placed, new, facing, pressed[new], share)
            parts.append((new, touching, covered, coarse & touching.any(axis=1)))
            is_seen[new] = True
            new = self._around(self._triangles[new[touching.any(axis=1)]])
            new = new[~is_seen[new]]
        seen, cells, whole, unresolved = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return seen, cells, whole, unresolved

    def _holding(self, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Numbers of the triangles in which contacts are, or near their edges, given corners and weights there."""
        around = self._fans[np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)[:, 0]]
        shared = (self._triangles[around][:, :, None] == corners[:, None, :, None]).any(axis=3)
        held: np.ndarray = around[(shared | (weights < NEAR_EDGE)[:, None]).all(axis=2) & (around >= 0)]
        return held

    def _around(self, vertices: np.ndarray) -> np.ndarray:
        """Numbers of the triangles at any of the vertices."""
        around = self._fans[np.unique(vertices)]
        triangles: np.ndarray = np.unique(around[around >= 0])
        return triangles

    def _touching(
        self,
        placed: np.ndarray,
        triangles: np.ndarray,
        facing: Facing,
        is_pressed: np.ndarray,
        share: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Areas of triangles that touch and that the other body faces, by corner [mm^2], each (count, 3).

        The third result says which are too coarse for what they face, shape (count,).

        A triangle is flat where a round surface touches it at one point, and where it leaves the other its nodes cannot
        say where within it. So one whose least gap is closed touches where the gap is less than a share of what it
        would be at its farthest corner: all of it below a round surface, half of it in the mean at the rim.
        """
        corners = placed[self._triangles[triangles]]
        twice = _cross_of(corners)
        size = np.linalg.norm(twice, axis=1)
        distance = self._model.scene.contact.contact_distance
        longest = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1))
        of, polygons, gap, cosine = facing(corners, twice / np.maximum(size, 1e-300)[:, None], longest + distance)
        gap, length = gap - distance, longest[of, None]
        # What is farther behind the triangle is another layer.
        polygons = _cut(_cut(polygons, gap - length), -gap - 2.0 * distance - 0.25 * length)
        whole = _integrals(polygons)
        is_there = whole.sum(axis=1) > NOTHING
        lowest = np.full(len(triangles), np.inf)
        np.minimum.at(lowest, of[is_there], np.einsum("pkc,pc->pk", polygons, gap)[is_there].min(axis=1))
        held = share[self._triangles[triangles]]
        between = (held >= NEAR_EDGE).all(axis=1)
        sags = (lowest <= SAG * longest) & (between | (held >= 0.5).any(axis=1))
        touches = is_pressed | (lowest <= TOUCHING) | sags
        base = np.where(touches & (lowest < np.inf), np.maximum(lowest, 0.0), 0.0)
        limit = base[of] + TOUCHING + RIM * np.ptp(gap, axis=1)
        limit = np.where(between[of], np.maximum(limit, SAG * longest[of]), limit)
        closed = _integrals(_cut(polygons, gap - limit[:, None])) * touches[of, None]
        factor = (0.5 * size[of] * cosine)[:, None]
        touching, facing_it, seen = np.zeros((3, len(triangles), 3))
        for area, parts in ((touching, factor * closed), (facing_it, factor * whole), (seen, whole)):
            area[:] = np.stack([np.bincount(of, parts[:, k], len(triangles)) for k in range(3)], axis=1)
        share_seen, share_along = seen.sum(axis=1), facing_it.sum(axis=1) / np.maximum(0.5 * size, 1e-300)
        return touching, facing_it, (share_seen < 0.99) & (share_along < RESOLVED * share_seen)

    def _facing(self, state: State, other: int, placed: np.ndarray) -> Facing:
        """What the body `other` has opposite to triangles."""
        soft, rigid = len(self._model.soft_bodies), len(self._model.rigid_bodies)
        if other < soft:
            return partial(_opposite_faces, placed[self._triangles[self._first[other] : self._first[other + 1]]])
        if other < soft + rigid:
            body = self._model.rigid_bodies[other - soft]
            turn = matrices_from_quaternions(state.rigid_rotation)[other - soft]
            shift = state.rigid_position[other - soft]
            vertices, triangles, shape = body.vertices @ turn.T + shift, body.triangles, body.shape
            smooth = body.smooth
            shift = shift - turn @ body.centre_of_mass
        else:
            obstacle = self._model.obstacles[other - soft - rigid]
            if obstacle.point is not None and obstacle.normal is not None:
                return partial(_opposite_plane, obstacle.point, obstacle.normal)
            assert obstacle.vertices is not None and obstacle.triangles is not None
            vertices, triangles, shape = obstacle.vertices, obstacle.triangles, obstacle.shape
            turn, shift, smooth = obstacle.turn, obstacle.shift, obstacle.smooth
        if shape is not None and not shape.flat:
            half = 0.5 * shape.length * turn[:, 2]
            return partial(_opposite_capsule, shift - half, shift + half, shape.radius, vertices[triangles])
        return partial(_opposite_faces, _curved(vertices, triangles) if smooth else vertices[triangles])

    def _below(
        self,
        placed: tuple[np.ndarray, np.ndarray],
        points: np.ndarray,
        body: int,
        outward: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The triangle of a body nearest to each point, of those at its nearest vertex, and barycentric coordinates.

        Contacts were measured between the start and the end of the step: `placed` has the surfaces at both. Where
        `outward` is given, (count, 3), vertices count that face that way.
        """
        row, choices = np.arange(len(points)), []
        for position in placed:
            vertices = position[self._start[body] : self._start[body + 1]]
            squared = ((points[:, None] - vertices) ** 2).sum(axis=2)
            if outward is not None:
                fans = self._fans[self._start[body] : self._start[body + 1]]
                normals = _cross_of(position[self._triangles])[fans] * (fans >= 0)[..., None]
                squared[outward @ normals.sum(axis=1).T <= 0.0] = np.inf
            nearest = self._start[body] + squared.argmin(axis=1)
            candidates = self._fans[nearest]
            a, b, c = (position[self._triangles[candidates, k]] for k in range(3))
            weights = _barycentric(points[:, None], a, b, c)
            away = weights[..., :1] * a + weights[..., 1:2] * b + weights[..., 2:] * c - points[:, None]
            distance = np.where(candidates >= 0, np.einsum("pcd,pcd->pc", away, away), np.inf)
            best = distance.argmin(axis=1)
            choices.append((distance[row, best], candidates[row, best], weights[row, best]))
        (first, *start), (last, *end) = choices
        return np.where(first < last, start[0], end[0]), np.where((first < last)[:, None], start[1], end[1])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross product along the last axis; numpy's takes four times as long for few vectors."""
    product: np.ndarray = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return product


def _cross_of(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles with twice their area [mm^2], shape (count, 3)."""
    return _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _spread(load: np.ndarray, area: np.ndarray, corners: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Pressure of each cell [kPa], given its load [mN], its area [mm^2], and the cells at each triangle's corners.

    Few contacts carry what many cells touch, and those at the rim may be slivers: so the pressure is spread as heat is,
    over the square root of each triangle's `reach` [mm^2]. That keeps its sum, leaves what is even as it is, and makes
    none that is higher than the highest.
    """
    cells, places = np.unique(corners, return_inverse=True)
    places, count = places.reshape(corners.shape), len(cells)
    start, end = places[:, [0, 1, 2]].ravel(), places[:, [1, 2, 0]].ravel()
    conductance, alone = np.repeat(reach / np.sqrt(12.0), 3), np.arange(count)
    entries = np.concatenate([area[cells], *(sign * conductance for sign in (1.0, 1.0, -1.0, -1.0))])
    rows, columns = (np.concatenate(x) for x in ((alone, start, end, start, end), (alone, start, end, end, start)))
    pressure = np.zeros(len(area))
    if count > DENSE:
        pressure[cells] = spsolve(csc_array((entries, (rows, columns)), shape=(count, count)), load[cells])
    else:
        matrix = np.bincount(rows * count + columns, entries, count * count).reshape(count, count)
        pressure[cells] = np.linalg.solve(matrix, load[cells])
    return pressure


def _opposite_plane(
    point: np.ndarray, up: np.ndarray, corners: np.ndarray, normals: np.ndarray, reach: np.ndarray
) -> Pieces:
    """Triangles whole, above the plane through `point` with normal `up`."""
    of = np.flatnonzero(normals @ up <= -FACING)
    return of, np.repeat(np.eye(3)[None], len(of), axis=0), (corners[of] - point) @ up, -normals[of] @ up


def _opposite_faces(faces: np.ndarray, corners: np.ndarray, normals: np.ndarray, reach: np.ndarray) -> Pieces:
    """Parts of triangles opposite to each of the `faces` [mm], (face_count, 3, 3), along the triangles' normals."""
    far = reach[:, None] * np.abs(normals)
    low, high = corners.min(axis=1) - far, corners.max(axis=1) + far
    faces = faces[((faces.max(axis=1) >= low.min(axis=0)) & (faces.min(axis=1) <= high.max(axis=0))).all(axis=1)]
    up = _cross_of(faces)
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-300)
    cosine, lowest, highest = -normals @ up.T, faces.min(axis=1), faces.max(axis=1)
    close = cosine >= FACING
    for axis in range(3):
        close &= (highest[:, axis] >= low[:, None, axis]) & (lowest[:, axis] <= high[:, None, axis])
    of, face = np.nonzero(close)
    away = corners[of, None] - faces[face][:, :, None]  # from each corner of the face to each of the triangle
    inward = _cross(normals[of, None], np.roll(faces[face], -1, axis=1) - faces[face])
    beyond = np.einsum("pekd,ped->pek", away, inward)
    distance = np.einsum("pkd,pd->pk", away[:, 0], up[face])
    meets = (beyond < 0.0).any(axis=2).all(axis=1) & (distance.min(axis=1) <= reach[of])
    of, face, beyond, distance = of[meets], face[meets], beyond[meets], distance[meets]
    polygons = np.repeat(np.eye(3)[None], len(of), axis=0)
    for edge in range(3):
        polygons = _cut(polygons, beyond[:, edge])
    return of, polygons, distance, cosine[of, face]


def _opposite_capsule(
    start: np.ndarray,
    end: np.ndarray,
    radius: float,
    faces: np.ndarray,
    corners: np.ndarray,
    normals: np.ndarray,
    reach: np.ndarray,
) -> Pieces:
    """Small parts of triangles above a capsule or, where `start` is `end`, a ball: a tangent plane to each part.

    Of one that is small beside the triangles, the `faces` that it is drawn with are closer to it.
    """
    if radius < 2.0 * reach.max(initial=0.0):
        return _opposite_faces(faces, corners, normals, reach)
    points = np.einsum("skc,tcd->tskd", SMALL, corners)
    points = np.concatenate([points, points.mean(axis=2, keepdims=True)], axis=2)
    axis = end - start
    share = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-300), 0.0, 1.0)
    away = points - start - share[..., None] * axis
    distance = np.linalg.norm(away, axis=3)
    cosine = -np.einsum("tsd,td->ts", away[:, :, 3], normals) / np.maximum(distance[:, :, 3], 1e-300)
    of, part = np.nonzero(cosine >= FACING)
    at_corners = np.einsum("pck,pk->pc", np.linalg.inv(SMALL)[part], distance[of, part, :3] - radius)
    return of, SMALL[part], at_corners, cosine[of, part]


def _cut(polygons: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The parts of convex polygons with values <= 0 of a function given at the corners of their triangles, (count, 3).

    They have one corner more; those without a part have all corners in one place, others repeat the last.
    """
    count, k = polygons.shape[:2]
    following = np.arange(1, k + 1) % k
    height = (polygons * values[:, None]).sum(axis=2)
    inside = height <= 0.0
    crosses = inside != inside[:, following]
    if not crosses.any():  # as is most often so: a third of the time
        whole = np.concatenate([polygons, polygons[:, -1:]], axis=1)
        outside = ~inside[:, 0]
        whole[outside] = polygons[outside, :1]
        return whole
    share = height / np.where(crosses, height - height[:, following], 1.0)
    both, kept = np.empty((count, k, 2, 3)), np.empty((count, k, 2), dtype=bool)
    both[:, :, 0], both[:, :, 1] = polygons, polygons + share[..., None] * (polygons[:, following] - polygons)
    kept[..., 0], kept[..., 1] = inside, crosses
    order = np.argsort(~kept.reshape(count, 2 * k), axis=1, kind="stable")[:, : k + 1]
    last = np.maximum(kept.sum(axis=(1, 2)) - 1, 0)
    row = np.arange(count)[:, None]
    parts: np.ndarray = both.reshape(count, 2 * k, 3)[row, order[row, np.minimum(np.arange(k + 1), last[:, None])]]
    return parts


def _integrals(polygons: np.ndarray) -> np.ndarray:
    """Integrals of the barycentric coordinates over polygons, as shares of the triangles' areas, shape (count, 3)."""
    first, second, third = polygons[:, :1], polygons[:, 1:-1], polygons[:, 2:]
    a, b = (second - first)[..., :2], (third - first)[..., :2]
    shares = np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    sums: np.ndarray = np.einsum("pf,pfc->pc", shares, first + second + third) / 3.0
    return sums


def _small_triangles(parts: int) -> np.ndarray:
    """Triangles of equal size in barycentric coordinates of one that they fill, shape (parts^2, 3, 3)."""
    triangles = []
    for i in range(parts):
        for j in range(parts - i):
            triangles.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < parts - 1:
                triangles.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    two = np.array(triangles) / parts
    return np.concatenate([two, 1.0 - two.sum(axis=2, keepdims=True)], axis=2)


SMALL = _small_triangles(PARTS)


def _curved(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Small faces of the curved surface that a smooth one stands for (`kernels/smooth_contacts.py`), (count, 3, 3)."""
    corners, normals = vertices[triangles], vertex_normals(vertices, triangles)[triangles]
    points = np.einsum("skc,tcd->tskd", SMALL, corners)
    height = np.einsum("tcd,tcd->tc", corners, normals)[:, None, None] - np.einsum("tskd,tcd->tskc", points, normals)
    curved: np.ndarray = points + 0.5 * np.einsum("skc,tskc,tcd->tskd", SMALL, height, normals)
    return curved.reshape(-1, 3, 3)


def _barycentric(point: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Coordinates of points projected on triangles, those beyond an edge moved onto it along the others, (..., 3)."""
    u, v, w = b - a, c - a, point - a
    uu, uv, vv, uw, vw = (np.einsum("...d,...d->...", *two) for two in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    determinant = np.maximum(uu * vv - uv * uv, np.finfo(float).tiny)
    second, third = (vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant
    positive = np.maximum(np.stack([1.0 - second - third, second, third], axis=-1), 0.0)
    weights: np.ndarray = positive / positive.sum(axis=-1, keepdims=True)
    return weights
