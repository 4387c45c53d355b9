"""Points and cells of topologies: containers, regular and sparse grids, and what mappings make of other cells."""

from typing import Any, cast

import numpy as np
import trimesh
from scipy import ndimage
from scipy.spatial import Delaunay, QhullError

from taichisoft.mesh import SIX_TETRAHEDRA, boundary_quads, boundary_triangles, tetrahedron_volumes
from taichisoft_sofa.components.draft import SceneDraft
from taichisoft_sofa.components.meshes import (
    CORNERS,
    OTHER_NAMES,
    TRANSFORMED,
    cells_by,
    loader_position,
    no_cells,
    read_loader,
    split_quads,
)
from taichisoft_sofa.components.reading import LOADERS, TOPOLOGIES, computed, in_node, nearest, node_of
from taichisoft_sofa.tree.component import Component, component, derived, unused
from taichisoft_sofa.tree.value_kinds import ABOVE_0, ANY, FROM_0, INDICES, LINK, canonical, fixed, vectors

# Containers.


def source_of(component: "Component") -> "Component | None":
    """The component of `src`, else the loader in the container's node; None if the container reads a file itself."""
    link = component.read_text("src")
    if link:
        return component.linked("src")
    if component.read_text("filename", "fileTopology"):
        return None
    return in_node(node_of(component), LOADERS)


def container_position(container: "Component") -> np.ndarray:
    """Points of a topology container [mm], shape (count, 3)."""
    if container.is_given("position"):
        return container.read_numbers("position").reshape(-1, 3)
    source = source_of(container)
    if source is not None:
        return computed(source, "position", 3)
    return loader_position(container) if container.read_text("filename", "fileTopology") else np.zeros((0, 3))


def container_cells(container: "Component", kind: str) -> np.ndarray:
    """Cells of a topology container: the cells of its source, or what a topological mapping makes of others."""
    for name in (kind, *OTHER_NAMES.get(kind, ())):
        if container.is_given(name):
            return container.read_numbers(name).astype(np.int64).reshape(-1, CORNERS[kind])
    if (mapped := mapped_cells(container, kind)) is not None:
        return mapped
    source = source_of(container)
    if source is not None:
        return computed(source, kind, CORNERS[kind])
    own = container.read_text("filename", "fileTopology")
    return getattr(read_loader(container), kind) if own else np.zeros((0, CORNERS[kind]), dtype=np.int64)


def surface_triangles(topology: "Component | None") -> np.ndarray:
    """Triangles of a container, with quads split in two, shape (count, 3); none without a container."""
    return np.vstack([computed(topology, "triangles", 3), split_quads(computed(topology, "quads", 4))])


EDGES_OF = {
    "tetrahedra": [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
    "hexahedra": [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]],
    "triangles": [[0, 1], [1, 2], [2, 0]],
    "quads": [[0, 1], [1, 2], [2, 3], [3, 0]],
}
FACES_OF = {
    "triangles": ("tetrahedra", [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]),
    "quads": ("hexahedra", [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]),
}


def all_cells(topology: "Component", kind: str) -> np.ndarray:
    """Cells of a topology; where it has no edges or faces of its own, those of its larger cells, as in SOFA."""
    own = computed(topology, kind, CORNERS[kind])
    if len(own) or canonical(topology.type_name) not in DERIVING:
        return own
    if kind in FACES_OF:
        larger, faces = FACES_OF[kind]
        return computed(topology, larger, CORNERS[larger])[:, faces].reshape(-1, CORNERS[kind])
    if kind == "edges":
        sides = [computed(topology, cells, CORNERS[cells])[:, ends].reshape(-1, 2) for cells, ends in EDGES_OF.items()]
        volume = sides[:2] if len(sides[0]) or len(sides[1]) else sides[2:]
        return np.vstack(volume)
    return own


def collision_triangles(topology: "Component | None") -> np.ndarray:
    """Triangles of a surface that collides; of a mesh of larger cells alone those of its skin, shape (count, 3)."""
    own = surface_triangles(topology)
    if len(own) or topology is None or canonical(topology.type_name) not in DERIVING:
        return own
    hexahedra, tetrahedra = computed(topology, "hexahedra", 8), computed(topology, "tetrahedra", 4)
    return np.vstack([boundary_triangles(tetrahedra), split_quads(boundary_quads(hexahedra))])


# Cells that topological mappings make of others.


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
            return divided(hexahedra, grid, mapping.read_flag("swapping"))
    return None


MADE = {
    "Tetra2TriangleTopologicalMapping": "triangles",
    "Hexa2TetraTopologicalMapping": "tetrahedra",
    "Hexa2QuadTopologicalMapping": "quads",
    "Quad2TriangleTopologicalMapping": "triangles",
}
"""Cells that topological mappings make."""


def _output_of(mapping: "Component") -> "Component | None":
    output = mapping.linked("output") if mapping.read_text("output") else None
    return output if output is not None and canonical(getattr(output, "type_name", "")) in TOPOLOGIES else None


def input_of(mapping: "Component") -> "Component":
    """The topology of which a mapping makes cells: linked, or the nearest one above its node."""
    link = mapping.read_text("input")
    parent = next(iter(node_of(mapping).parents), None)
    found: Any = mapping.linked("input") if link else None if parent is None else nearest(parent, TOPOLOGIES)
    if getattr(found, "type_name", "") == "Node":
        found = in_node(found, TOPOLOGIES)
    if found is None or canonical(found.type_name) not in TOPOLOGIES:
        raise mapping.refused(f"input '{link}' is not a container of cells")
    return found


# Cells of points without any.

FLATTEST = 1e-4
"""Volume over the cube of the longest edge, below which a tetrahedron is left out [-]."""


def filled(position: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Tetrahedra that fill the hull of points, as indices of points, shape (count, 4); none for points of a plane."""
    try:
        corners = points[Delaunay(position[points]).simplices] if len(points) > 3 else np.zeros((0, 4), dtype=np.int64)
    except QhullError:
        return np.zeros((0, 4), dtype=np.int64)
    volumes = tetrahedron_volumes(position, corners)
    corners[volumes < 0.0] = corners[volumes < 0.0][:, [1, 0, 2, 3]]
    edges = position[corners[:, [0, 0, 0, 1, 1, 2]]] - position[corners[:, [1, 2, 3, 2, 3, 3]]]
    longest = np.linalg.norm(edges, axis=2).max(axis=1, initial=0.0)
    return corners[np.abs(volumes) > FLATTEST * longest**3]


# Regular grids.

GRID = "RegularGridTopology"
DERIVING = {"MeshTopology", GRID, "SparseGridTopology"}
"""Topologies that make edges and faces of their larger cells."""
MOST_POINTS = 1_000_000
"""Largest number of points of a grid."""

MIRRORED = np.array([[1, 0, 3, 2, 5, 4, 7, 6], [3, 2, 1, 0, 7, 6, 5, 4], [4, 5, 6, 7, 0, 1, 2, 3]])
"""Corners of a hexahedron with opposite ends of its edges along x, y or z exchanged."""


def grid_size(grid: "Component") -> tuple[int, int, int]:
    """Number of points of a grid along x, y and z: `n`, or `nx`, `ny` and `nz`."""
    size = grid.read_numbers("n").astype(int)
    if not grid.is_given("n"):
        size = np.array([int(grid.read_number(name)) for name in ("nx", "ny", "nz")])
    if len(size) != 3 or (size < 1).any() or np.prod(size.astype(float)) > MOST_POINTS:
        raise grid.refused(f"n = {size.tolist()}: three numbers of 1 or more, of at most {MOST_POINTS} points")
    return int(size[0]), int(size[1]), int(size[2])


def grid_position(grid: "Component") -> np.ndarray:
    """Points of a grid [mm], shape (count, 3), x fastest: from `min`, or `p0`, by `max` - `min`.

    As in SOFA, one layer along x or y is half way between its ends, one along z at its lower end.
    """
    size = np.array(grid_size(grid))
    if grid.read_number("cellWidth") > 0.0:
        raise grid.refused("cellWidth is not known for this grid; give its number of points, n")
    low, high = (
        grid.read_vector(end) if grid.is_given(end) else np.array([grid.read_number(f"{axis}{end}") for axis in "xyz"])
        for end in ("min", "max")
    )
    first = np.where((size == 1) & [True, True, False], (low + high) / 2, low)
    x, y, z = (np.linspace(0.0, b - a, n) for a, b, n in zip(low, high, size, strict=True))
    place = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return place + grid.read_vector("p0", default=first.tolist())


def _corners(place: np.ndarray) -> list[np.ndarray]:
    """The eight corners of all cells of a grid, of the numbers of its points [z, y, x], each without the last ones."""
    z, y, x = (count - 1 for count in place.shape)
    ends = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    return [place[k : z + k, j : y + j, i : x + i] for i, j, k in ends]


def grid_cells(grid: "Component", kind: str) -> np.ndarray:
    """Cells of a grid: hexahedra of one with three dimensions, quads of one with two, edges of one with one."""
    size = grid_size(grid)
    place = np.arange(np.prod(size)).reshape(size[::-1])  # [z, y, x]
    long = [axis for axis, count in enumerate(size) if count > 1]
    if kind == "hexahedra" and len(long) == 3:
        return np.column_stack([corner.ravel() for corner in _corners(place)])
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


GRID_SIZE = {
    "n": (INDICES, (2, 2, 2), ABOVE_0),
    **{f"n{axis}": (2, ABOVE_0) for axis in "xyz"},
    "min": fixed(3),
    "cellWidth": (0.0, FROM_0),
}


# Sparse grids: the cells of a regular grid that a closed surface touches or encloses.

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


def stiffness_factors(topology: "Component", count: int) -> np.ndarray:
    """Share of its stiffness that each of `count` hexahedra has: a half where a surface goes through a sparse cell."""
    if canonical(topology.type_name) != SPARSE or not topology.read_flag("fillWeighted"):
        return np.ones(count)
    return np.where(_content(topology)[2], 0.5, 1.0)


def _content(grid: "Component") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    if not hasattr(grid, "_sparse"):
        grid._sparse = _make(grid)
    return cast(tuple[np.ndarray, np.ndarray, np.ndarray], grid._sparse)


def _surface(grid: "Component") -> tuple[np.ndarray, np.ndarray]:
    """Points [mm] and triangles of the surface: of a file, a source, or the data themselves."""
    if grid.read_text("fileTopology", "filename"):
        mesh = read_loader(grid)
        return loader_position(grid), np.vstack([mesh.triangles, split_quads(mesh.quads)])
    if grid.read_text("src"):
        source = grid.linked("src")
        return computed(source, "position", 3), surface_triangles(source)
    quads = grid.read_numbers("quads").astype(np.int64).reshape(-1, 4)
    triangles = grid.read_numbers("triangles").astype(np.int64).reshape(-1, 3)
    return grid.read_numbers("vertices", "position").reshape(-1, 3), np.vstack([triangles, split_quads(quads)])


def _make(grid: "Component") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [mm], hexahedra, and whether the surface goes through each."""
    points, triangles = _surface(grid)
    if not len(triangles):
        raise grid.refused("has no surface of triangles; name a file with fileTopology, or a source")
    low, high = (grid.read_vector(end) for end in ("min", "max"))
    if not low.any() and not high.any():
        size = np.ptp(points, axis=0)
        low, high = points.min(axis=0) - MARGIN * size, points.max(axis=0) + MARGIN * size
    count = np.array(grid_size(grid))
    if (width := grid.read_number("cellWidth")) > 0.0:
        count = np.ceil((high - low) / width).astype(int) + 1
    if (count < 2).any() or np.prod(count.astype(float)) > MOST_POINTS:
        raise grid.refused(f"n = {count.tolist()}: 2 points or more along each axis, {MOST_POINTS} at most")
    cell = (high - low) / (count - 1)
    area = trimesh.Trimesh(points, triangles, process=False).area
    if (high <= low).any() or area > MOST_POINTS * cell.min() ** 2:
        raise grid.refused(f"min {low.tolist()}, max {high.tolist()}, n {count.tolist()}: no cells, or too small ones")
    samples, _ = trimesh.remesh.subdivide_to_size(points, triangles, PITCH * cell.min(), max_iter=30)
    touched = np.zeros(count - 1, dtype=bool)
    place = np.floor((samples - low) / cell).astype(int)
    inside = ((place >= 0) & (place < count - 1)).all(axis=1)
    touched[tuple(place[inside].T)] = True
    outside, _ = ndimage.label(np.pad(~touched, 1, constant_values=True))
    kept = (outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1].transpose(2, 1, 0)  # [z, y, x]
    at = np.arange(np.prod(count)).reshape(count[::-1])
    cells = np.column_stack([corner[kept] for corner in _corners(at)])
    used, hexahedra = np.unique(cells, return_inverse=True)
    x, y, z = used % count[0], used // count[0] % count[1], used // (count[0] * count[1])
    return low + np.column_stack([x, y, z]) * cell, hexahedra.reshape(-1, 8), touched.transpose(2, 1, 0)[kept]


@component(
    *sorted(TOPOLOGIES - {GRID, SPARSE}),
    filename="",
    fileTopology="",
    fileMesh=ANY,
    nbPoints=(0, FROM_0),
    **TRANSFORMED,
    position=derived(vectors(3), container_position),
    **cells_by(container_cells),
)
@component(*MADE, input=LINK, output=LINK, flipNormals=unused(False), swapping=False)
@component(
    GRID,
    **GRID_SIZE,
    max=(fixed(3), (1.0, 1.0, 1.0)),
    p0=fixed(3),
    **{f"{axis}{end}": value for axis in "xyz" for end, value in (("min", 0.0), ("max", 1.0))},
    position=derived(vectors(3), grid_position),
    **cells_by(grid_cells),
)
@component(
    SPARSE,
    **GRID_SIZE,
    max=fixed(3),
    filename="",
    fileTopology="",
    fileMesh=ANY,
    src="",
    fillWeighted=True,
    nbVirtualFinerLevels=unused(0),
    **TRANSFORMED,
    vertices=vectors(3),
    position=derived(vectors(3), sparse_position),
    **cells_by(sparse_cells),
)
def accept_topology(component: "Component", draft: "SceneDraft") -> None:
    """Accept points and cells that other components read: given ones, those of a file, those that a mapping makes of
    others, those of a regular grid, or those of its cells that a surface touches or encloses."""
