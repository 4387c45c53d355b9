"""Membranes, fibres and springs of soft bodies at rest: the triangles and pieces that they consist of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from taichisoft.errors import SceneError
from taichisoft.mechanics.elastic_laws import joined_arrays
from taichisoft.mechanics.kernels.reinforcement_forces import CORD, SHEET, SPRING, STIFF, THREAD
from taichisoft.mechanics.selection import SMALLEST_WEIGHT, embed, surface_group
from taichisoft.mesh.surface import MappedSurface
from taichisoft.mesh.volume_mesh import VolumeMesh
from taichisoft.scene.soft_body import FibreSettings, MembraneSettings, SoftBodySettings, SpringSettings

# Membranes and fibres as pictures show them: thin slabs and tubes, which move with the elements that they are in.

ReinforcementKind = Literal["membrane", "fibre"]

LEAST = 0.004
"""Half of the thickness with which they are drawn, at least, in diagonals of the box around the body [-]."""
SIDES = 6
"""Faces around a tube."""
MOST_POINTS = 3000
"""Points with which all lines of a name are drawn, about; at those left out they are straight."""


def membrane_slab(mesh: VolumeMesh, membrane: MembraneSettings, key: str) -> MappedSurface:
    """Both sides of a membrane and its rim; `key` begins errors."""
    import trimesh

    nodes, triangles = np.unique(surface_group(mesh, membrane.group, key), return_inverse=True)
    sheet = trimesh.Trimesh(mesh.nodes[nodes], triangles.reshape(-1, 3), process=False)
    trimesh.repair.fix_winding(sheet)  # faces between two solids are turned by chance
    front = np.asarray(sheet.faces)
    first, second = np.moveaxis(np.diff(mesh.nodes[nodes][front], axis=1), 1, 0)
    normals = np.zeros((len(nodes), 3))
    np.add.at(normals, front, np.cross(first, second)[:, None])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    edges = front[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, number, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    a, b = edges[count[number.ravel()] == 1].T
    back = len(nodes)
    rim = [np.stack([b, a, a + back], axis=1), np.stack([b, a + back, b + back], axis=1)]
    half = max(membrane.thickness / 2.0, LEAST * _diagonal(mesh))
    places = mesh.nodes[nodes] + half * np.stack([normals, -normals])
    element = np.empty(len(mesh.nodes), dtype=np.int64)
    element[mesh.elements] = np.arange(len(mesh.elements))[:, None]
    corners = mesh.elements[element[nodes], :4]
    return _carried(mesh, np.tile(corners, (2, 1)), places.reshape(-1, 3), [front, front[:, ::-1] + back, *rim])


def fibre_tubes(mesh: VolumeMesh, lines: Sequence[np.ndarray], diameter: float) -> MappedSurface:
    """Closed tubes around lines [mm], each of shape (point_count, 3), with the diameter of a fibre [mm]."""
    stride = -(-sum(map(len, lines)) // MOST_POINTS)
    radius = max(diameter / 2.0, LEAST * _diagonal(mesh))
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    around = np.arange(SIDES)
    after = (around + 1) % SIDES
    lid = np.stack([np.zeros(SIDES - 2, dtype=int), around[1:-1], around[2:]], axis=1)
    places, owners, triangles, first = [], [], [], 0
    for line in lines:
        kept = line[np.unique([*range(0, len(line), stride), len(line) - 1])]
        along = np.gradient(kept, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        aside = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
        aside /= np.linalg.norm(aside, axis=1, keepdims=True)
        ring = np.cos(turn)[:, None] * aside[:, None] + np.sin(turn)[:, None] * np.cross(along, aside)[:, None]
        places.append((kept[:, None] + radius * ring).reshape(-1, 3))
        owners.append(np.repeat(embed(kept, mesh.nodes, mesh.elements[:, :4])[0], SIDES, axis=0))
        last = first + SIDES * (len(kept) - 1)
        for start in range(first, last, SIDES):
            here, there = start + around, start + SIDES + around
            triangles.append(np.stack([here, start + after, start + SIDES + after], axis=1))
            triangles.append(np.stack([here, start + SIDES + after, there], axis=1))
        triangles += [first + lid[:, ::-1], last + lid]
        first = last + SIDES
    return _carried(mesh, np.concatenate(owners), np.concatenate(places), triangles)


def _diagonal(mesh: VolumeMesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))


def _carried(
    mesh: VolumeMesh, corners: np.ndarray, places: np.ndarray, triangles: Sequence[np.ndarray]
) -> MappedSurface:
    """Places [mm], each carried by the corners of an element, (count, 4), also where it lies a little outside."""
    nodes = mesh.nodes[corners]
    inner = np.linalg.solve((nodes[:, 1:] - nodes[:, :1]).transpose(0, 2, 1), (places - nodes[:, 0])[..., None])[..., 0]
    weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
    return MappedSurface(corners.astype(np.int32), weights, np.concatenate(triangles).astype(np.int32))


ACROSS = 1e-6
"""Sine of the angle to a triangle's normal below which a thread does not lie in the triangle [-]."""


@dataclass(frozen=True)
class Reinforcements:
    """Triangles of membranes, pieces of fibres and springs of a body, or of several; `ReinforcementParts` says more.

    Attributes:
        start: the first entry of each part, shape (part_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: [1/mm], shape (entry_count, 3).
        measure: area [mm^2] or length [mm], shape (part_count,).
        stiffness: [mN/mm] or [mN], shape (part_count, 6).
        slackening: STIFF, THREAD, SHEET, SPRING or CORD, shape (part_count,).
        drag: [mN s/mm], shape (part_count,).
    """

    start: np.ndarray
    node: np.ndarray
    gradient: np.ndarray
    measure: np.ndarray
    stiffness: np.ndarray
    slackening: np.ndarray
    drag: np.ndarray

    @classmethod
    def joined(cls, parts: "Sequence[Reinforcements]") -> "Reinforcements":
        """Several, one after the other, which share the numbering of nodes."""
        return cls(**joined_arrays(parts))

    def moved(self, first_node: int) -> "Reinforcements":
        """The same with nodes that count from another first one."""
        return replace(self, node=self.node + first_node)


def make_reinforcements(mesh: VolumeMesh, body: SoftBodySettings, key: str) -> Reinforcements | None:
    """The membranes, fibres and springs of a body; None without any. `key` begins errors."""
    if not (body.membranes or body.fibres or body.springs):
        return None
    if body.element == "quadratic" or body.reduced is not None:
        other = 'element = "quadratic"' if body.element == "quadratic" else "reduced"
        kinds = "membranes, fibres and springs"
        raise SceneError(f"{key}: {kinds} are for linear, smoothed and hexahedral elements, not {other}")
    membranes = [
        _membrane(mesh, sheet, f"{key}.membranes.{name}")
        for name, one in body.membranes.items()
        for sheet in _independent_parts(one)
    ]
    fibres = [
        _fibre(mesh, one, line, f"{key}.fibres.{name}") for name, one in body.fibres.items() for line in one.lines()
    ]
    springs = [_springs(mesh, one, f"{key}.springs.{name}") for name, one in body.springs.items()]
    return Reinforcements.joined([*membranes, *fibres, *springs])


def _independent_parts(membrane: MembraneSettings) -> list[MembraneSettings]:
    """Threads of two directions slacken each for themselves."""
    if not membrane.tension_only or not membrane.directions:
        return [membrane]
    return [membrane.model_copy(update={"directions": [one]}) for one in membrane.directions]


def _membrane(mesh: VolumeMesh, membrane: MembraneSettings, key: str) -> Reinforcements:
    """Constant gradients of triangles, along their first edge and across it."""
    triangles = surface_group(mesh, membrane.group, key)
    corners = mesh.nodes[triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    axes = np.empty((len(triangles), 2, 3))
    axes[:, 0] = first / np.linalg.norm(first, axis=1, keepdims=True)
    normal = np.cross(first, second)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    axes[:, 1] = np.cross(normal / (2.0 * area)[:, None], axes[:, 0])
    edges = np.stack([np.einsum("tij,tj->ti", axes, one) for one in (first, second)], axis=2)
    inner = np.linalg.inv(edges)  # its rows are the gradients of the second and third corner
    gradient = np.zeros((len(triangles), 3, 3))
    gradient[:, 1:, :2], gradient[:, 0, :2] = inner, -inner.sum(axis=1)
    slackening = (THREAD if membrane.directions else SHEET) if membrane.tension_only else STIFF
    return Reinforcements(
        start=3 * np.arange(len(triangles) + 1, dtype=np.int32),
        node=triangles.reshape(-1).astype(np.int32),
        gradient=gradient.reshape(-1, 3),
        measure=area,
        stiffness=_sheet_stiffness(membrane, axes, key),
        slackening=np.full(len(triangles), slackening, dtype=np.int32),
        drag=np.zeros(len(triangles)),
    )


def _sheet_stiffness(membrane: MembraneSettings, axes: np.ndarray, key: str) -> np.ndarray:
    """C of each triangle: plane stress of an isotropic sheet, or the sum of E t n n^T over directions of threads."""
    modulus, ratio = membrane.young_modulus * membrane.thickness, membrane.poisson_ratio
    if not membrane.directions:
        plane = modulus / (1.0 - ratio**2)
        row = [plane, plane * ratio, 0.0, plane, 0.0, 0.5 * modulus / (1.0 + ratio)]
        return np.tile(row, (len(axes), 1))
    total = np.zeros((len(axes), 6))
    for direction in membrane.directions:
        within = axes @ (np.array(direction) / np.linalg.norm(direction))
        length = np.linalg.norm(within, axis=1)
        if (length < ACROSS).all():
            raise SceneError(f"{key}.directions: {list(direction)} is across all of group '{membrane.group}'")
        one, other = (within / np.maximum(length, ACROSS)[:, None]).T * (length >= ACROSS)
        along = np.stack([one**2, other**2, one * other])
        total += modulus * np.stack([along[i] * along[j] for i in range(3) for j in range(i, 3)], axis=1)
    return total


def _fibre(mesh: VolumeMesh, fibre: FibreSettings, line: np.ndarray, key: str) -> Reinforcements:
    """Pieces between points that follow the elements around them."""
    nodes, weights = embed(line, mesh.nodes, mesh.elements[:, :4])
    outside = weights.min(axis=1) < SMALLEST_WEIGHT
    if outside.any():
        place = np.round(line[outside][0], 3).tolist()
        raise SceneError(f"{key}: its point {place} mm lies outside the body, {mesh.source}")
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    if not lengths.all():
        raise SceneError(f"{key}: two neighbouring points are the same")
    found = []
    for piece, length in enumerate(lengths):
        own, number = np.unique(nodes[piece : piece + 2], return_inverse=True)
        share = np.stack([-weights[piece], weights[piece + 1]]) / length
        along = np.bincount(number.ravel(), share.ravel(), len(own))
        found.append((own[along != 0.0], along[along != 0.0]))
    gradient = np.zeros((sum(len(own) for own, _ in found), 3))
    gradient[:, 0] = np.concatenate([along for _, along in found])
    stiffness = np.zeros((len(found), 6))
    stiffness[:, 0] = fibre.young_modulus * np.pi / 4.0 * fibre.diameter**2
    return Reinforcements(
        start=np.cumsum([0, *(len(own) for own, _ in found)]).astype(np.int32),
        node=np.concatenate([own for own, _ in found]),
        gradient=gradient,
        measure=lengths,
        stiffness=stiffness,
        slackening=np.full(len(found), STIFF, dtype=np.int32),
        drag=np.zeros(len(found)),
    )


def _springs(mesh: VolumeMesh, springs: SpringSettings, key: str) -> Reinforcements:
    nodes, count = np.array(springs.nodes), len(springs.nodes)
    if (highest := nodes.max()) >= len(mesh.nodes):
        raise SceneError(f"{key}.nodes names node {highest}; {mesh.source} has nodes 0 to {len(mesh.nodes) - 1}")
    between = np.diff(mesh.nodes[nodes], axis=1)
    stiffness = np.zeros((count, 6))
    stiffness[:, 0] = springs.stiffness
    stiffness[:, 1] = np.linalg.norm(between, axis=2).ravel() if springs.length is None else springs.length
    return Reinforcements(
        start=2 * np.arange(count + 1, dtype=np.int32),
        node=nodes.ravel().astype(np.int32),
        gradient=np.outer(np.tile([-1.0, 1.0], count), [1.0, 0.0, 0.0]),
        measure=np.ones(count),
        stiffness=stiffness,
        slackening=np.full(count, CORD if springs.tension_only else SPRING, dtype=np.int32),
        drag=np.broadcast_to(springs.damping, count).astype(np.float64),
    )
