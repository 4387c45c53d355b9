"""The triangulated surfaces that contact treats as curved."""

from collections.abc import Sequence

import numpy as np

from taichisoft.contact.kernels.smooth_surfaces import SmoothSurfaces
from taichisoft.contact.kernels.surface_vertices import Carriers, Surfaces
from taichisoft.meshes.smooth_normals import vertex_normals


def find_smooth(
    smooth: Sequence[bool],
    topology: Surfaces,
    carriers: Carriers,
    vertex_range: np.ndarray,
    triangle_range: np.ndarray,
) -> SmoothSurfaces:
    """Vertex normals and contact pairs of the `smooth` surfaces; see `ContactSurfaces` for the ranges."""
    normal = np.zeros_like(carriers.local)
    is_smooth = np.zeros(len(normal), dtype=np.int32)
    numbers = [surface for surface, curved in enumerate(smooth) if curved]
    for surface in numbers:
        vertices, triangles = slice(*vertex_range[surface]), slice(*triangle_range[surface])
        inner = topology.triangles[triangles] - vertices.start
        normal[vertices] = vertex_normals(carriers.local[vertices], inner)
        is_smooth[vertices] = 1
    pairs = [(one, other) for pair in topology.pairs.tolist() for one, other in (pair, pair[::-1]) if smooth[one]]
    return SmoothSurfaces(
        vertices=np.flatnonzero(is_smooth).astype(np.int32),
        is_smooth=is_smooth,
        local_normal=normal,
        normal=normal.copy(),
        moving=np.intersect1d(numbers, topology.moving).astype(np.int32),
        pairs=np.array(pairs, dtype=np.int32).reshape(-1, 2),
    )
