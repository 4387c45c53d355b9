"""Where contacts press a soft body's surface: contact areas, pressures, and forces on the patches of tactile arrays."""

from dataclasses import dataclass

import numpy as np

from taichisoft.control.observation import Pair
from taichisoft.errors import SceneError
from taichisoft.model import Model
from taichisoft.state import State


@dataclass(frozen=True)
class ContactPatch:
    """Where two bodies press each other, on the surface of the first one that is soft.

    The force of a contact goes to the corners of the surface's triangle below it, by its barycentric coordinates; a
    corner stands for a third of the triangles around it. So the sum of pressure times area of the corners is the normal
    force.

    Attributes:
        body: name of the soft body.
        vertices: numbers of the surface's vertices that are pressed, shape (count,).
        force: normal force on each [mN], shape (count,).
        pressure: this over the area for which the vertex stands [kPa], shape (count,).
        area: area in contact [mm^2]: that of the vertices, as far as contacts stand for them, up to the whole.
    """

    body: str
    vertices: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    area: float

    @property
    def peak(self) -> float:
        """Highest pressure [kPa]; the mesh limits how narrow a peak it can show."""
        return float(self.pressure.max(initial=0.0))


class ContactPatches:
    """Finds the patches of a model's states."""

    def __init__(self, model: Model):
        """Join the surfaces of the soft bodies."""
        self._model, bodies = model, model.soft_bodies
        sizes = [len(body.surface.nodes) for body in bodies]
        self._start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
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
        """The patches by pair of bodies, in the scene's order; pairs of which none is soft have none."""
        force, pairs, count = self._pressing(state), state.contact_body_pair, len(self._model.soft_bodies)
        rows = np.flatnonzero((force > 0.0) & (pairs < count).any(axis=1))
        if not len(rows):
            return {}
        # The smaller number of the two is that of a soft body: these come first.
        placed = self._placed(state)
        triangle, weights = self._below(placed, state.contact_point[rows], pairs[rows].min(axis=1))
        corners, load, names = self._triangles[triangle], force[rows, None] * weights, self._model.body_names
        found: dict[Pair, ContactPatch] = {}
        for first, second in np.unique(pairs[rows], axis=0).tolist():
            of_pair = (pairs[rows] == (first, second)).all(axis=1)
            vertex, place = np.unique(corners[of_pair], return_inverse=True)
            loads = np.bincount(place.ravel(), load[of_pair].ravel(), len(vertex))
            share = np.minimum(np.bincount(place.ravel(), weights[of_pair].ravel(), len(vertex)), 1.0)
            area, soft = self._areas(placed, vertex), min(first, second)
            found[names[first], names[second]] = ContactPatch(
                names[soft], vertex - self._start[soft], loads, loads / area, float(area @ share)
            )
        return found

    def tactile(self, state: State) -> dict[str, np.ndarray]:
        """Normal force on each patch of the tactile arrays [mN], by their names, of the shape of `patches`."""
        felt, force, placed = {}, self._pressing(state), self._placed(state)
        for number, body in enumerate(self._model.soft_bodies):
            touches = np.flatnonzero((state.contact_body_pair == number).any(axis=1) & (force > 0.0))
            if not body.settings.tactile:
                continue
            triangle, weights = self._below(placed, state.contact_point[touches], np.full(len(touches), number))
            points = np.einsum("pk,pkd->pd", weights, self._rest[self._triangles[triangle]])
            for name, table in body.settings.tactile.items():
                cells = [np.linspace(low, high, n + 1) for low, high, n in zip(*table.box, table.patches, strict=True)]
                felt[f"{body.name}.{name}"] = np.histogramdd(points, cells, weights=force[touches])[0]
        return felt

    def check_tactile_arrays(self) -> None:
        """Check that every tactile array has a part of the surface of its body.

        Raises:
            SceneError: one lies beside it.
        """
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

    def _placed(self, state: State) -> np.ndarray:
        """Where the surfaces were at the start of the step, when the contacts were found [mm], (vertex_count, 3)."""
        position = state.position - self._model.scene.time.step * state.velocity
        bodies = self._model.soft_bodies
        return np.vstack([np.zeros((0, 3)), *(body.surface.positions(position[body.nodes]) for body in bodies)])

    def _areas(self, placed: np.ndarray, vertices: np.ndarray) -> np.ndarray:
        """A third of the triangles at each vertex [mm^2], shape (count,)."""
        around = self._fans[vertices]
        a, b, c = (placed[self._triangles[around, k]] for k in range(3))
        twice = np.where(around >= 0, np.linalg.norm(np.cross(b - a, c - a), axis=2), 0.0)
        area: np.ndarray = twice.sum(axis=1) / 6.0
        return area

    def _below(self, placed: np.ndarray, points: np.ndarray, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The triangle of a body nearest to each point, of those at its nearest vertex, and barycentric coordinates."""
        nearest, row = np.zeros(len(points), np.int64), np.arange(len(points))
        if not len(points):
            return nearest, np.zeros((0, 3))
        for body in np.unique(bodies):
            own, start = bodies == body, self._start[body]
            some = placed[start : self._start[body + 1]]
            nearest[own] = start + ((points[own, None] - some) ** 2).sum(axis=2).argmin(axis=1)
        candidates = self._fans[nearest]
        a, b, c = (placed[self._triangles[candidates, k]] for k in range(3))
        weights = _barycentric(points[:, None], a, b, c)
        away = weights[..., :1] * a + weights[..., 1:2] * b + weights[..., 2:] * c - points[:, None]
        distance = np.where(candidates >= 0, np.einsum("pcd,pcd->pc", away, away), np.inf)
        best = distance.argmin(axis=1)
        return candidates[row, best], weights[row, best]


def _barycentric(point: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Coordinates of points projected on triangles, those beyond an edge moved onto it along the others, (..., 3)."""
    u, v, w = b - a, c - a, point - a
    uu, uv, vv, uw, vw = (np.einsum("...d,...d->...", *two) for two in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    determinant = np.maximum(uu * vv - uv * uv, np.finfo(float).tiny)
    second, third = (vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant
    found = np.maximum(np.stack([1.0 - second - third, second, third], axis=-1), 0.0)
    weights: np.ndarray = found / found.sum(axis=-1, keepdims=True)
    return weights
