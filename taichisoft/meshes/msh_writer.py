"""gmsh's MSH 4.1 as text, which keeps every digit and every group (gmsh itself writes 16 digits, one too few)."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from taichisoft.meshes.cell_groups import GroupedCells, grouped_cells
from taichisoft.meshes.volume_mesh import VolumeMesh

# Dimension, and gmsh's number of the linear cell.
TRIANGLE = (2, 2)
TETRAHEDRON = (3, 4)


def write_msh(mesh: VolumeMesh, path: Path) -> None:
    """Write linear tetrahedra and all groups.

    In MSH 4 an entity (a piece of the geometry) belongs to groups, not the cells on it: so the cells that share
    their groups are one entity. Cells are numbered in the mesh's order, elements first, which brings it back.

    Raises:
        MeshError: a group cannot be kept.
        OSError: the file cannot be written.
    """
    triangles, elements = grouped_cells(mesh)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for line in (
            *("$MeshFormat", "4.1 0 8", "$EndMeshFormat"),
            *("$PhysicalNames", *_names(mesh), "$EndPhysicalNames"),
            *("$Entities", f"0 0 {len(triangles.by_groups())} {len(elements.by_groups())}"),
            *_entities(mesh, triangles, 0),
            *_entities(mesh, elements, len(mesh.surface_groups)),
            *("$EndEntities", "$Nodes", *_nodes(mesh), "$EndNodes"),
            *("$Elements", *_cells(triangles, elements), "$EndElements"),
        ):
            file.write(line + "\n")


def _names(mesh: VolumeMesh) -> Iterator[str]:
    dimensions = [2] * len(mesh.surface_groups) + [3] * len(mesh.element_groups)
    yield f"{len(dimensions)}"
    names = (*mesh.surface_groups, *mesh.element_groups)
    for tag, (dimension, name) in enumerate(zip(dimensions, names, strict=True), start=1):
        yield f'{dimension} {tag} "{name}"'


def _entities(mesh: VolumeMesh, cells: GroupedCells, groups_before: int) -> Iterator[str]:
    tags = {name: tag for tag, name in enumerate(cells.groups, start=groups_before + 1)}
    for entity, (names, members) in enumerate(cells.by_groups(), start=1):
        corners = mesh.nodes[np.unique(cells.cells[members])]
        box = [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]
        yield " ".join(map(str, [entity, *box, len(names), *(tags[name] for name in names), 0]))


def _nodes(mesh: VolumeMesh) -> Iterator[str]:
    """All on the first volume: no reader needs to know on which face of it a node lies."""
    count = len(mesh.nodes)
    yield f"1 {count} 1 {count}"
    yield f"3 1 0 {count}"
    yield from map(str, range(1, count + 1))
    for x, y, z in mesh.nodes.tolist():
        yield f"{x!r} {y!r} {z!r}"


def _cells(triangles: GroupedCells, elements: GroupedCells) -> Iterator[str]:
    count = len(elements.cells) + len(triangles.cells)
    yield f"{len(triangles.by_groups()) + len(elements.by_groups())} {count} 1 {count}"
    for (dimension, number), cells, cells_before in (
        (TRIANGLE, triangles, len(elements.cells)),
        (TETRAHEDRON, elements, 0),
    ):
        for entity, (_, members) in enumerate(cells.by_groups(), start=1):
            yield f"{dimension} {entity} {number} {len(members)}"
            for row in np.column_stack([members + cells_before, cells.cells[members]]) + 1:
                yield " ".join(map(str, row.tolist()))
