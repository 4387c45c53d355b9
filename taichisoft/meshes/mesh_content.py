"""What a mesh file holds, whatever its format: nodes, cells and named groups, before anything is checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class MeshContent:
    """The parts of a file that a simulation can use, and what else of a volume stands in it.

    Attributes:
        nodes: positions [mm], shape (node_count, 3).
        tetrahedra: linear ones, node indices, shape (element_count, 4).
        triangles: linear ones, node indices, shape (triangle_count, 3).
        element_groups: indices of tetrahedra by name, each (count,).
        surface_groups: indices of triangles by name, each (count,).
        others: number of cells with a volume that are no linear tetrahedra, by meshio's name of their type.
    """

    nodes: np.ndarray
    tetrahedra: np.ndarray
    triangles: np.ndarray
    element_groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    surface_groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    others: Mapping[str, int] = field(default_factory=dict)
