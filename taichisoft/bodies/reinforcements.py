"""Membranes and fibres of soft bodies at rest: the triangles and pieces that they consist of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.bodies.embedding import SMALLEST_WEIGHT, embed
from taichisoft.bodies.kernels.reinforcement_forces import SHEET, STIFF, THREAD
from taichisoft.bodies.selection import surface_group
from taichisoft.errors import SceneError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.scenes.reinforcement_settings import FibreSettings, MembraneSettings
from taichisoft.scenes.soft_body import SoftBodySettings

ACROSS = 1e-6
"""Sine of the angle to a triangle's normal below which a thread does not lie in the triangle [-]."""


@dataclass(frozen=True)
class Reinforcements:
    """Triangles of membranes and pieces of fibres of a body, or of several; `ReinforcementParts` says more.

    Attributes:
        start: the first entry of each part, shape (part_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: [1/mm], shape (entry_count, 3).
        measure: area [mm^2] or length [mm], shape (part_count,).
        stiffness: [mN/mm] or [mN], shape (part_count, 6).
        slackening: STIFF, THREAD or SHEET, shape (part_count,).
    """

    start: np.ndarray
    node: np.ndarray
    gradient: np.ndarray
    measure: np.ndarray
    stiffness: np.ndarray
    slackening: np.ndarray

    @classmethod
    def joined(cls, parts: "Sequence[Reinforcements]") -> "Reinforcements":
        """Several, one after the other, which share the numbering of nodes."""
        sizes = np.concatenate([np.diff(part.start) for part in parts])
        return cls(
            start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32),
            node=np.concatenate([part.node for part in parts]).astype(np.int32),
            gradient=np.concatenate([part.gradient for part in parts]),
            measure=np.concatenate([part.measure for part in parts]),
            stiffness=np.concatenate([part.stiffness for part in parts]),
            slackening=np.concatenate([part.slackening for part in parts]),
        )

    def moved(self, first_node: int) -> "Reinforcements":
        """The same with nodes that count from another first one."""
        return replace(self, node=self.node + first_node)


def make_reinforcements(mesh: VolumeMesh, body: SoftBodySettings, key: str) -> Reinforcements | None:
    """The membranes and fibres of a body; None without any. `key` begins errors.

    Raises:
        SceneError: a group is not in the mesh, a fibre leaves the body, or the body is one that cannot have any.
    """
    if not body.membranes and not body.fibres:
        return None
    if body.element == "quadratic" or body.reduced is not None:
        other = 'element = "quadratic"' if body.element == "quadratic" else "reduced"
        raise SceneError(f"{key}: membranes and fibres are for linear, smoothed and hexahedral elements, not {other}")
    membranes = [
        _membrane(mesh, sheet, f"{key}.membranes.{name}")
        for name, one in body.membranes.items()
        for sheet in _independent_parts(one)
    ]
    fibres = [
        _fibre(mesh, one, line, f"{key}.fibres.{name}") for name, one in body.fibres.items() for line in one.lines()
    ]
    return Reinforcements.joined([*membranes, *fibres])


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
    )
