"""Where contacts press a soft body's surface: contact areas, pressures, and forces on the patches of tactile arrays."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft.bodies.soft_body_arrays import SoftBody
from taichisoft.control.observation import Pair
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
        """Prepare the surfaces of the soft bodies."""
        self._model = model
        self._surfaces = [_Surface(body) for body in model.soft_bodies]

    def patches(self, state: State) -> dict[Pair, ContactPatch]:
        """The patches by pair of bodies, in the scene's order; pairs of which none is soft have none."""
        found: dict[Pair, ContactPatch] = {}
        force, names = self._pressing(state), self._model.body_names
        for first, second in np.unique(state.contact_body_pair[force > 0.0], axis=0):
            rows = np.flatnonzero((state.contact_body_pair == (first, second)).all(axis=1) & (force > 0.0))
            soft = next((one for one in sorted((first, second)) if one < len(self._surfaces)), None)
            if soft is not None:
                patch = self._surfaces[soft].patch(self._positions(state), state.contact_point[rows], force[rows])
                found[names[first], names[second]] = patch
        return found

    def tactile(self, state: State) -> dict[str, np.ndarray]:
        """Normal force on each patch of the tactile arrays [mN], by their names, of the shape of `patches`."""
        felt, force = {}, self._pressing(state)
        for number, surface in enumerate(self._surfaces):
            arrays = surface.body.settings.tactile
            touches = (state.contact_body_pair == number).any(axis=1) & (force > 0.0)
            points = surface.rest_points(self._positions(state), state.contact_point[touches]) if arrays else None
            for name, table in arrays.items():
                cells = [np.linspace(low, high, n + 1) for low, high, n in zip(*table.box, table.patches, strict=True)]
                felt[f"{surface.body.name}.{name}"] = np.histogramdd(points, cells, weights=force[touches])[0]
        return felt

    def _pressing(self, state: State) -> np.ndarray:
        """Normal force of each contact [mN], shape (contact_count,)."""
        along: np.ndarray = np.einsum("cd,cd->c", state.contact_impulse, state.contact_normal)
        return along / self._model.scene.time.step

    def _positions(self, state: State) -> np.ndarray:
        """Where the nodes were at the start of the step, when the contacts were found [mm], shape (node_count, 3)."""
        moved: np.ndarray = state.position - self._model.scene.time.step * state.velocity
        return moved


class _Surface:
    """The surface of a soft body, and which triangles meet at each vertex."""

    def __init__(self, body: SoftBody):
        self.body, self._mapped = body, body.surface
        self._triangles = body.surface.triangles
        self._rest = body.surface.positions(body.mesh.nodes)
        corners = self._triangles.ravel()
        order, count = np.argsort(corners, kind="stable"), np.bincount(corners, minlength=len(self._rest))
        column = np.arange(len(corners)) - np.repeat(np.cumsum(count) - count, count)
        self._fans = np.full((len(self._rest), max(count.max(initial=0), 1)), -1)
        self._fans[corners[order], column] = order // 3

    def patch(self, position: np.ndarray, points: np.ndarray, force: np.ndarray) -> ContactPatch:
        """The patch of contacts at points [mm], shape (count, 3), with their normal forces [mN], shape (count,)."""
        placed = self._mapped.positions(position[self.body.nodes])
        triangle, weights = self._below(placed, points)
        corners = self._triangles[triangle].ravel()
        loads = np.bincount(corners, (force[:, None] * weights).ravel(), len(placed))
        share = np.minimum(np.bincount(corners, weights.ravel(), len(placed)), 1.0)
        loaded = np.flatnonzero(loads > 0.0)
        around = self._fans[loaded]
        a, b, c = (placed[self._triangles[around, k]] for k in range(3))
        twice = np.where(around >= 0, np.linalg.norm(np.cross(b - a, c - a), axis=2), 0.0)
        area = twice.sum(axis=1) / 6.0
        return ContactPatch(self.body.name, loaded, loads[loaded], loads[loaded] / area, float(area @ share[loaded]))

    def rest_points(self, position: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Where the surface below points was at rest, in the mesh's coordinates [mm], shape (count, 3)."""
        triangle, weights = self._below(self._mapped.positions(position[self.body.nodes]), points)
        rest: np.ndarray = np.einsum("pk,pkd->pd", weights, self._rest[self._triangles[triangle]])
        return rest

    def _below(self, placed: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The triangle nearest to each point, of those at its nearest vertex, and barycentric coordinates there."""
        from trimesh.triangles import closest_point, points_to_barycentric

        if not len(points):
            return np.zeros(0, np.int64), np.zeros((0, 3))
        nearest = ((points[:, None] - placed) ** 2).sum(axis=2).argmin(axis=1)
        candidates = self._fans[nearest]
        corners = placed[self._triangles[candidates]].reshape(-1, 3, 3)
        repeated = np.repeat(points, candidates.shape[1], axis=0)
        foot = closest_point(corners, repeated).reshape(*candidates.shape, 3)
        distance = ((foot - points[:, None]) ** 2).sum(axis=2)
        best = np.where(candidates >= 0, distance, np.inf).argmin(axis=1)
        row = np.arange(len(points))
        triangle = candidates[row, best]
        weights = points_to_barycentric(placed[self._triangles[triangle]], foot[row, best])
        weights = np.clip(weights, 0.0, 1.0)
        return triangle, weights / weights.sum(axis=1, keepdims=True)


class LazyMapping(Mapping[Any, Any]):
    """A mapping that is worked out when somebody looks: few controllers want pressures, and they cost time."""

    def __init__(self, make: Callable[[], Mapping[Any, Any]]):
        self._make: Callable[[], Mapping[Any, Any]] | None = make
        self._made: Mapping[Any, Any] = {}

    def _all(self) -> Mapping[Any, Any]:
        make = self._make
        if make is not None:
            self._made, self._make = make(), None
        return self._made

    def __getitem__(self, name: Any) -> Any:
        """The value of a name."""
        return self._all()[name]

    def __iter__(self) -> Iterator[Any]:
        """The names."""
        return iter(self._all())

    def __len__(self) -> int:
        """Number of names."""
        return len(self._all())

    def __repr__(self) -> str:
        """The mapping as a dictionary."""
        return repr(dict(self._all()))

    def __reduce__(self) -> tuple[Any, ...]:
        """For other processes it is a dictionary."""
        return dict, (dict(self._all()),)
