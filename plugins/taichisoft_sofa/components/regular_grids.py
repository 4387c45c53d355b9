"""Regular grids, and the cells that topological mappings make of others."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft.mesh import SIX_TETRAHEDRA, boundary_quads, boundary_triangles
from taichisoft_sofa.components.graph import TOPOLOGIES, in_node, nearest, node_of
from taichisoft_sofa.components.loaded_mesh import no_cells, split_quads
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, number, numbers, text, vector
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

GRID = "RegularGridTopology"
MOST_POINTS = 1_000_000
"""Largest number of points of a grid."""

MIRRORED = np.array([[1, 0, 3, 2, 5, 4, 7, 6], [3, 2, 1, 0, 7, 6, 5, 4], [4, 5, 6, 7, 0, 1, 2, 3]])
"""Corners of a hexahedron with opposite ends of its edges along x, y or z exchanged."""


def grid_size(grid: "Component") -> tuple[int, int, int]:
    """Number of points of a grid along x, y and z: `n`, or `nx`, `ny` and `nz`.

    Raises:
        SceneError: a number is below 1, or there are too many points.
    """
    size = numbers(grid, "n", default=(2, 2, 2)).astype(int)
    if not is_given(grid, "n"):
        size = np.array([int(number(grid, name, default=2)) for name in ("nx", "ny", "nz")])
    if len(size) != 3 or (size < 1).any() or np.prod(size.astype(float)) > MOST_POINTS:
        raise SceneError(
            f"{described(grid)}: n = {size.tolist()}: three numbers of 1 or more, of at most {MOST_POINTS} points"
        )
    return int(size[0]), int(size[1]), int(size[2])


def grid_position(grid: "Component") -> np.ndarray:
    """Points of a grid [mm], shape (count, 3), x fastest: `min` to `max`, or cells of `cellWidth`, and `p0`."""
    size = grid_size(grid)
    low, high = (
        vector(grid, end, default=[number(grid, f"{axis}{end}", default=value) for axis in "xyz"])
        for end, value in (("min", 0.0), ("max", 1.0))
    )
    width = number(grid, "cellWidth", default=0.0)
    if width > 0.0:
        high = low + width * (np.array(size) - 1)
    axes = [
        np.linspace(a, b, count) if count > 1 else np.array([a]) for a, b, count in zip(low, high, size, strict=True)
    ]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()]) + vector(grid, "p0", default=(0.0, 0.0, 0.0))


def grid_cells(grid: "Component", kind: str) -> np.ndarray:
    """Cells of a grid: hexahedra of one with three dimensions, quads of one with two, edges of one with one."""
    size = grid_size(grid)
    place = np.arange(np.prod(size)).reshape(size[::-1])  # [z, y, x]
    long = [axis for axis, count in enumerate(size) if count > 1]
    if kind == "hexahedra" and len(long) == 3:
        ends = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
        corners = [place[k : size[2] - 1 + k, j : size[1] - 1 + j, i : size[0] - 1 + i].ravel() for i, j, k in ends]
        return np.column_stack(corners)
    flat = place.reshape([count for count in place.shape if count > 1])
    if kind == "quads" and len(long) == 2:
        return np.column_stack(
            [flat[:-1, :-1].ravel(), flat[:-1, 1:].ravel(), flat[1:, 1:].ravel(), flat[1:, :-1].ravel()]
        )
    if kind == "edges" and len(long) == 1:
        return np.column_stack([flat[:-1], flat[1:]])
    return no_cells({"edges": 2, "triangles": 3, "quads": 4, "tetrahedra": 4, "hexahedra": 8}[kind])


def divided(hexahedra: np.ndarray, grid: "Component | None", alternating: bool) -> np.ndarray:
    """Six tetrahedra for each hexahedron, shape (6 * count, 4).

    Args:
        hexahedra: point indices, shape (count, 8).
        grid: grid of the hexahedra, if it is one.
        alternating: whether neighbours in a grid are divided like mirror images, so that the diagonals do not all point
            the same way.
    """
    cells = hexahedra.copy()
    if alternating:
        # SOFA counts with these numbers where there is no grid.
        nx, ny = (grid_size(grid)[0] - 1, grid_size(grid)[1] - 1) if grid is not None else (2, 1)
        i = np.arange(len(cells))
        for odd, corners in zip(((i % nx) % 2 == 0, (i // nx) % ny % 2, i // (nx * ny) % 2), MIRRORED, strict=True):
            cells = np.where(np.asarray(odd, dtype=bool)[:, None], cells[:, corners], cells)
    return cells[:, SIX_TETRAHEDRA].reshape(-1, 4)


def hexahedra_of(topology: "Component") -> tuple[np.ndarray, "Component | None"]:
    """Hexahedra of a topology, shape (count, 8), and the topology itself if it is a grid."""
    cells = computed(topology, "hexahedra", 8)
    return cells, topology if canonical(topology.type_name) == GRID else None


def mapped_cells(container: "Component", kind: str) -> np.ndarray | None:
    """Cells that a topological mapping in the node of a container makes of others; None without such a mapping."""
    for mapping in node_of(container).objects:
        if MADE.get(canonical(mapping.type_name)) == kind and _output_of(mapping) in (None, container):
            source = input_of(mapping)
            if mapping.type_name == "Tetra2TriangleTopologicalMapping":
                return boundary_triangles(computed(source, "tetrahedra", 4))
            if mapping.type_name == "Quad2TriangleTopologicalMapping":
                return split_quads(computed(source, "quads", 4))
            hexahedra, grid = hexahedra_of(source)
            if mapping.type_name == "Hexa2QuadTopologicalMapping":
                return boundary_quads(hexahedra)
            return divided(hexahedra, grid, flag(mapping, "swapping", False))
    return None


MADE = {
    "Tetra2TriangleTopologicalMapping": "triangles",
    "Hexa2TetraTopologicalMapping": "tetrahedra",
    "Hexa2QuadTopologicalMapping": "quads",
    "Quad2TriangleTopologicalMapping": "triangles",
}
"""Cells that topological mappings make."""


def _output_of(mapping: "Component") -> "Component | None":
    output = mapping.linked("output") if text(mapping, "output") else None
    return output if output is not None and canonical(getattr(output, "type_name", "")) in TOPOLOGIES else None


def input_of(mapping: "Component") -> "Component":
    """The topology of which a mapping makes cells: linked, or the nearest one above its node.

    Raises:
        SceneError: it leads to none.
    """
    link = text(mapping, "input")
    parent = next(iter(node_of(mapping).parents), None)
    found: Any = mapping.linked("input") if link else None if parent is None else nearest(parent, TOPOLOGIES)
    if getattr(found, "type_name", "") == "Node":
        found = in_node(found, TOPOLOGIES)
    if found is None or canonical(found.type_name) not in TOPOLOGIES:
        raise SceneError(f"{described(mapping)}: input '{link}' is not a container of cells")
    return found
