"""Membranes and fibres as pictures show them: thin slabs and tubes, which move with the elements that they are in."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from taichisoft.bodies.embedding import embed
from taichisoft.bodies.selection import surface_group
from taichisoft.meshes.surface import MappedSurface
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.scenes.reinforcement_settings import MembraneSettings

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
