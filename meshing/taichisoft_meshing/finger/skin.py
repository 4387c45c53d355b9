"""The boundary of a body, split into its outer skin, its base and its cavities."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.errors import MeshError
from taichisoft.meshes.surface import enclosed_volume
from taichisoft.meshes.volume_mesh import boundary_triangles

# [mm] Nodes this near the plane x = 0 lie in the base.
BASE_TOLERANCE = 1e-9


def name_surfaces(nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Surface groups of a body in one piece, each (count, 3) node indices.

    "outer" is closed and faces outward; "base" is the part of it in the plane x = 0. "cavity", or "cavity_0",
    "cavity_1", ... from the base on where there are several, are closed and face into the silicone, so that the
    volumes that they enclose are positive.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).

    Raises:
        MeshError: the boundary has several outer skins, or none.
    """
    triangles = boundary_triangles(elements)
    shells = _connected(triangles, len(nodes))
    # Triangles face out of the silicone, so a cavity encloses a negative volume.
    outer = [shell for shell in shells if enclosed_volume(nodes, shell) > 0]
    cavities = [shell[:, ::-1].copy() for shell in shells if enclosed_volume(nodes, shell) < 0]
    if len(outer) != 1:
        raise MeshError(f"the body has {len(outer)} outer skins; it must be one piece of silicone")
    in_base = (np.abs(nodes[outer[0], 0]) < BASE_TOLERANCE).all(axis=1)
    cavities.sort(key=lambda cavity: -nodes[cavity, 0].max())
    names = ["cavity"] if len(cavities) == 1 else [f"cavity_{number}" for number in range(len(cavities))]
    return {"outer": outer[0], "base": outer[0][in_base], **dict(zip(names, cavities, strict=True))}


def _connected(triangles: np.ndarray, node_count: int) -> list[np.ndarray]:
    """The triangles of each connected piece of a surface."""
    starts, ends = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(starts)), (starts, ends)), shape=(node_count, node_count))
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return [triangles[piece == number] for number in np.unique(piece)]
