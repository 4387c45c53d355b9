"""Walls of one element between a cavity and the outside, which are too stiff."""

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh, boundary_triangles

TOO_STIFF = (
    "walls of one element, much too stiff in bending if linear; if smoothed a finger bends by about a third too little "
    "at a Poisson's ratio of 0.3, and half as far as on a fine mesh at 0.499, that of silicone"
)
ADVICE = "try a smaller size, or order = 2"


def share_of_thin_walls(mesh: VolumeMesh, cavity: np.ndarray) -> float:
    """Share of a cavity's area that one element lies behind: each corner has an edge to a node of the outer surface.

    Args:
        mesh: elements of four or ten nodes, whose corners count.
        cavity: triangles of the cavity, shape (count, 3).
    """
    corners = mesh.elements[:, :4]
    inside, outside, near = np.zeros((3, len(mesh.nodes)), dtype=bool)
    inside[cavity] = True
    outside[boundary_triangles(corners)] = True
    outside &= ~inside
    near[corners[outside[corners].any(axis=1)]] = True
    a, b, c = np.moveaxis(mesh.nodes[cavity], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(areas[near[cavity].all(axis=1)].sum() / areas.sum())
