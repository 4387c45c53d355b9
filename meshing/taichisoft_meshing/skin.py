"""The boundary of a hollow body, split into its outer skin, its base and its cavity."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.errors import MeshError
from taichisoft.mapped_surface import enclosed_volume
from taichisoft.mesh import boundary_triangles

# [mm] Nodes this near the plane x = 0 lie in the base.
BASE_TOLERANCE = 1e-9


def name_surfaces(nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Surface groups of a body with one cavity: "outer", "base" and "cavity", each (count, 3) node indices.

    "outer" is closed and faces outward; "base" is the part of it in the plane x = 0. "cavity" is closed and
    faces into the silicone, so the volume that it encloses is positive.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).

    Raises:
        MeshError: the boundary is not one outer skin and one cavity.
    """
    triangles = boundary_triangles(elements)
    shells = _connected(triangles, len(nodes))
    # Triangles face out of the silicone, so a cavity encloses a negative volume.
    outer = [shell for shell in shells if enclosed_volume(nodes, shell) > 0]
    cavities = [shell for shell in shells if enclosed_volume(nodes, shell) < 0]
    if len(outer) != 1 or len(cavities) != 1:
        raise MeshError(f"the body has {len(outer)} outer skins and {len(cavities)} cavities; one of each is needed")
    in_base = (np.abs(nodes[outer[0], 0]) < BASE_TOLERANCE).all(axis=1)
    return {"outer": outer[0], "base": outer[0][in_base], "cavity": cavities[0][:, ::-1].copy()}


def _connected(triangles: np.ndarray, node_count: int) -> list[np.ndarray]:
    """The triangles of each connected piece of a surface."""
    starts, ends = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(starts)), (starts, ends)), shape=(node_count, node_count))
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return [triangles[piece == number] for number in np.unique(piece)]
