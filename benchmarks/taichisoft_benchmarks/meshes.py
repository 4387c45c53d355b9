"""Meshes that the cases make for themselves, kept in a folder between repetitions."""

import os
from itertools import permutations
from pathlib import Path

import numpy as np

from taichisoft.meshes.files import write_volume_mesh
from taichisoft.meshes.volume_mesh import VolumeMesh

CELL = 2.0
"""Edge of a cell of the mat [mm]."""
MAT_CELLS = (27, 27, 2)
FOOT_DEPTH = 1.0
"""How far the foot stands out of the mat [mm]: the vertices beside it are beyond the reach of contacts."""


def mat_with_foot(foot: int, folder: Path) -> Path:
    """A mat of 28 x 28 x 3 nodes, `foot` x `foot` of which stand out of its underside down to z = 0."""
    path = folder / f"mat-on-{foot}.msh"
    if not path.exists():
        _write(make_mat(foot), path)
    return path


def make_mat(foot: int) -> VolumeMesh:
    """Boxes of six tetrahedra each; the node at (i, j, k) is number (i * 28 + j) * 3 + k."""
    counts = np.array(MAT_CELLS) + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([counts[1] * counts[2], counts[2], 1])
    corners = nodes[(nodes < np.array(MAT_CELLS)).all(axis=1)]
    # Each tetrahedron follows three edges from the lowest to the highest corner of its box.
    paths = []
    for order in permutations(range(3)):
        path = np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        paths.append(path if np.linalg.det(np.eye(3)[list(order)]) > 0 else path[[0, 2, 1, 3]])
    elements = ((corners[:, None, None, :] + np.array(paths)) @ strides).reshape(-1, 4)
    first = (counts[0] - foot) // 2
    across = (nodes[:, :2] >= first) & (nodes[:, :2] < first + foot)
    on_foot = across.all(axis=1) & (nodes[:, 2] == 0)
    position = CELL * nodes.astype(float)
    position[:, 2] += np.where((nodes[:, 2] == 0) & ~on_foot, FOOT_DEPTH, 0.0)
    return VolumeMesh("mat", position, elements).check()


def _write(mesh: VolumeMesh, path: Path) -> None:
    """Whole or not at all, so that a benchmark that was stopped leaves no half a mesh."""
    unfinished = path.with_name(f"{os.getpid()}-{path.name}")
    write_volume_mesh(mesh, unfinished)
    unfinished.replace(path)
