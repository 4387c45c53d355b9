"""Walls of one element, without a node inside, which are too stiff."""

import numpy as np

from taichisoft.meshes.volume_mesh import VolumeMesh, boundary_triangles, tetrahedron_volumes

BENDS = {0.3: 0.78, 0.4: 0.73, 0.45: 0.62, 0.49: 0.41, 0.499: 0.31}
"""By Poisson's ratio, how far a bar of 60 x 5 x 5 mm of 12 x 1 x 1 cells of smoothed elements bends, over theory."""
GROWS = {0.3: 0.97, 0.4: 0.96, 0.45: 0.94, 0.49: 0.82, 0.499: 0.59}
"""The same of the growth of a sphere of 10 and 13 mm under pressure, 162 nodes on each side (Lame)."""
TOO_STIFF = (
    "walls of one element, much too stiff in bending if linear; if smoothed a bar bends by 78, 62 and 31 % of what is "
    "right at Poisson's ratios of 0.3, 0.45 and 0.499, and a thin sphere grows by 97, 94 and 59 %"
)
ADVICE = "try a smaller size, elements_across_walls = 2, or order = 2"


def too_stiff(poisson_ratio: float) -> str:
    """What smoothed elements make of such a wall at a Poisson's ratio, between those that were measured."""
    bends, grows = (np.interp(poisson_ratio, list(one), list(one.values())) for one in (BENDS, GROWS))
    return (
        f"walls of one element, which smoothed ones hold too stiff: at a Poisson's ratio of {poisson_ratio:g} a bar "
        f"bends by about {bends:.0%} of what is right, and a thin sphere grows by about {grows:.0%}"
    )


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


def share_without_nodes_inside(mesh: VolumeMesh) -> float:
    """Share of a body's volume in elements whose corners all lie on its surface."""
    corners = mesh.elements[:, :4]
    outside = np.zeros(len(mesh.nodes), dtype=bool)
    outside[boundary_triangles(corners)] = True
    volumes = np.abs(tetrahedron_volumes(mesh.nodes, corners))
    return float(volumes[outside[corners].all(axis=1)].sum() / volumes.sum())
