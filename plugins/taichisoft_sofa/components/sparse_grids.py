"""Sparse grids: the cells of a regular grid that a closed surface touches or encloses."""

from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy import ndimage

from taichisoft.errors import SceneError
from taichisoft_sofa.components.contact_components import surface_triangles
from taichisoft_sofa.components.loaders import loader_position, read_loader
from taichisoft_sofa.components.regular_grids import MOST_POINTS, grid_size
from taichisoft_sofa.components.typed_values import computed, described, number, numbers, text, vector
from taichisoft_sofa.meshes.loaded_mesh import no_cells, split_quads

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

SPARSE = "SparseGridTopology"
MARGIN = 0.01
"""By which the grid is larger than its surface at each end, as a share of its size, as in SOFA [-]."""
PITCH = 0.3
"""Largest distance of the points by which cells that the surface touches are found, over the edge of a cell [-]."""


def sparse_position(grid: "Component") -> np.ndarray:
    """Points of the cells [mm], shape (count, 3)."""
    return _content(grid)[0]


def sparse_cells(grid: "Component", kind: str) -> np.ndarray:
    """The hexahedra; there are no other cells."""
    if kind == "hexahedra":
        return _content(grid)[1]
    return no_cells({"edges": 2, "triangles": 3, "quads": 4, "tetrahedra": 4}[kind])


def _content(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    if not hasattr(grid, "_sparse"):
        grid._sparse = _make(grid)
    found: tuple[np.ndarray, np.ndarray] = grid._sparse
    return found


def _surface(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    """Points [mm] and triangles of the surface: of a file, a source, or the data themselves."""
    if text(grid, "fileTopology", "filename"):
        mesh = read_loader(grid)
        return loader_position(grid), np.vstack([mesh.triangles, split_quads(mesh.quads)])
    if text(grid, "src"):
        source = grid.linked("src")
        return computed(source, "position", 3), surface_triangles(source)
    quads = numbers(grid, "quads").astype(np.int64).reshape(-1, 4)
    triangles = numbers(grid, "triangles").astype(np.int64).reshape(-1, 3)
    return numbers(grid, "vertices", "position").reshape(-1, 3), np.vstack([triangles, split_quads(quads)])


def _make(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    points, triangles = _surface(grid)
    if not len(triangles):
        raise SceneError(f"{described(grid)}: has no surface of triangles; name a file with fileTopology, or a source")
    low, high = (vector(grid, end, default=(0.0, 0.0, 0.0)) for end in ("min", "max"))
    if not low.any() and not high.any():
        size = np.ptp(points, axis=0)
        low, high = points.min(axis=0) - MARGIN * size, points.max(axis=0) + MARGIN * size
    count = np.array(grid_size(grid))
    if (width := number(grid, "cellWidth", default=0.0)) > 0.0:
        count = np.ceil((high - low) / width).astype(int) + 1
    if (count < 2).any() or np.prod(count.astype(float)) > MOST_POINTS:
        raise SceneError(
            f"{described(grid)}: n = {count.tolist()}: 2 points or more along each axis, {MOST_POINTS} at most"
        )
    cell = (high - low) / (count - 1)
    samples, _ = trimesh.remesh.subdivide_to_size(points, triangles, PITCH * cell.min(), max_iter=30)
    touched = np.zeros(count - 1, dtype=bool)
    place = np.floor((samples - low) / cell).astype(int)
    inside = ((place >= 0) & (place < count - 1)).all(axis=1)
    touched[tuple(place[inside].T)] = True
    outside, _ = ndimage.label(np.pad(~touched, 1, constant_values=True))
    kept = (outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1].transpose(2, 1, 0)  # [z, y, x]
    at = np.arange(np.prod(count)).reshape(count[::-1])
    ends = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    corners = [at[k : count[2] - 1 + k, j : count[1] - 1 + j, i : count[0] - 1 + i][kept] for i, j, k in ends]
    used, hexahedra = np.unique(np.column_stack(corners), return_inverse=True)
    x, y, z = used % count[0], used // count[0] % count[1], used // (count[0] * count[1])
    return low + np.column_stack([x, y, z]) * cell, hexahedra.reshape(-1, 8)
