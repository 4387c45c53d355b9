"""Hexahedra as a volume mesh has them: each is six of its tetrahedra, one after another, around a diagonal.

So all that works on tetrahedra (boundaries, points inside, groups, pictures, files) works on them; elements of eight
nodes are found again by `hexahedra_of`. Corners are in VTK's order: around one face, then around the opposite one.
"""

import numpy as np

from taichisoft.errors import MeshError

SIX_TETRAHEDRA = np.array([[0, 5, 1, 6], [0, 1, 3, 6], [1, 3, 6, 2], [6, 3, 0, 7], [6, 7, 0, 5], [7, 5, 4, 0]])
"""Corners of the six tetrahedra of a hexahedron."""
FACES = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
"""Corners of the six faces, facing outward."""
SIGNS = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
"""Corners of the cube with edges of 2 to which a hexahedron is mapped."""
OPPOSITE = [1, 0, 3, 2, 5, 4, 7, 6]
"""Corners with both ends of the first edges exchanged, which turns a hexahedron inside out."""
PLACES = [(0, 0), (0, 2), (2, 3), (1, 2), (5, 2), (0, 1), (0, 3), (3, 3)]
"""For each corner of a hexahedron: a tetrahedron that has it, and which of its nodes it is."""


def divided_hexahedra(nodes: np.ndarray, hexahedra: np.ndarray, source: str) -> np.ndarray:
    """Six positive tetrahedra for each hexahedron, shape (6 * count, 4).

    Args:
        nodes: positions [mm], shape (node_count, 3).
        hexahedra: node indices, shape (count, 8); inverted ones are turned.
        source: what errors begin with.

    Raises:
        MeshError: neighbours are numbered so that they are divided along different diagonals of a face, or a node index
            is not there.
    """
    if ((hexahedra < 0) | (hexahedra >= len(nodes))).any():
        raise MeshError(f"{source}: a hexahedron has a node index outside 0..{len(nodes) - 1}")
    edges = nodes[hexahedra[:, [1, 3, 4]]] - nodes[hexahedra[:, :1]]
    turned = np.where((np.linalg.det(edges) < 0.0)[:, None], hexahedra[:, OPPOSITE], hexahedra)
    tetrahedra: np.ndarray = turned[:, SIX_TETRAHEDRA].reshape(-1, 4)
    faces = np.sort(tetrahedra[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3), axis=1)
    outside = int((np.unique(faces, axis=0, return_counts=True)[1] == 1).sum())
    if outside != 2 * len(boundary_quads(turned)):
        raise MeshError(
            f"{source}: neighbouring hexahedra are divided along different diagonals of their faces; number the nodes "
            "of all hexahedra alike, as structured meshes have them, or mesh with tetrahedra"
        )
    return tetrahedra


def hexahedra_of(elements: np.ndarray) -> np.ndarray | None:
    """The hexahedra of which the tetrahedra (element_count, 4) of a mesh are parts, shape (count, 8), or None."""
    if len(elements) % 6 or elements.shape[1] != 4:
        return None
    six = elements.reshape(-1, 6, 4)
    found = np.column_stack([six[:, part, corner] for part, corner in PLACES])
    return found if (found[:, SIX_TETRAHEDRA] == six).all() else None


def boundary_quads(hexahedra: np.ndarray) -> np.ndarray:
    """Faces of hexahedra that belong to one of them alone, facing outward, shape (count, 4)."""
    quads = hexahedra[:, FACES].reshape(-1, 4)
    _, first, count = np.unique(np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True)
    return quads[np.sort(first[count == 1])]
