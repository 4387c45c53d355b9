"""Tetrahedra written to gmsh's MSH, VTU and legacy VTK, with the named groups that each format can keep."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.meshio_reader import GROUP_PREFIX
from taichisoft.meshes.volume_mesh import VolumeMesh

TRIANGLE = 2
TETRAHEDRA = {4: 4, 10: 11}
"""gmsh's numbers of the cells, of tetrahedra by the number of their nodes."""
MESHIO_TETRAHEDRA = {4: "tetra", 10: "tetra10"}

GMSH_ORDER = [*range(8), 9, 8]
"""Of the nodes of a ten-node tetrahedron in VTK's order; the same brings that order back."""


def write_msh(mesh: VolumeMesh, path: Path) -> None:
    """Write MSH 4.1 as text, with every digit and every group (gmsh itself writes 16 digits, one too few).

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


def write_vtk(mesh: VolumeMesh, path: Path) -> None:
    """Write legacy VTK for other programs: the tetrahedra alone.

    Raises:
        OSError: the file cannot be written.
    """
    import meshio

    # Version 4.2: most programs besides ParaView do not know the arrays of 5.1.
    meshio.vtk.write(
        path, meshio.Mesh(mesh.nodes, [(MESHIO_TETRAHEDRA[mesh.elements.shape[1]], mesh.elements)]), fmt_version="4.2"
    )


def write_vtu(mesh: VolumeMesh, path: Path) -> None:
    """Write VTU, with flags for the cells of each group that has any.

    Raises:
        MeshError: a group cannot be kept.
        OSError: the file cannot be written.
    """
    import meshio

    triangles, elements = grouped_cells(mesh)
    kind = MESHIO_TETRAHEDRA[mesh.elements.shape[1]]
    blocks = [(kind, elements), *([("triangle", triangles)] if len(triangles.cells) else [])]
    flags = {
        f"{GROUP_PREFIX}{name}": [
            cells.groups.get(name, np.zeros(len(cells.cells))).astype(np.uint8) for _, cells in blocks
        ]
        for name in (*mesh.surface_groups, *mesh.element_groups)
    }
    content = meshio.Mesh(mesh.nodes, [(kind, cells.cells) for kind, cells in blocks], cell_data=flags)
    meshio.vtu.write(path, content)


@dataclass(frozen=True)
class GroupedCells:
    """Cells of one dimension and their groups.

    Attributes:
        cells: node indices, shape (count, corners).
        groups: whether a cell is in the group, each (count,) of bool, by name.
    """

    cells: np.ndarray
    groups: Mapping[str, np.ndarray]

    def by_groups(self) -> list[tuple[tuple[str, ...], np.ndarray]]:
        """The indices, ascending, of the cells that share their groups, for each such set of group names."""
        if not len(self.cells):
            return []
        member = np.array([*self.groups.values()], dtype=bool).reshape(len(self.groups), len(self.cells)).T
        kinds, kind_of_cell = np.unique(member, axis=0, return_inverse=True)
        names = np.array([*self.groups], dtype=object)
        return [
            (tuple(names[kind]), np.flatnonzero(kind_of_cell.ravel() == number)) for number, kind in enumerate(kinds)
        ]


def grouped_cells(mesh: VolumeMesh) -> tuple[GroupedCells, GroupedCells]:
    """The triangles of all surface groups, each once, in the order in which the groups name them; and the elements.

    Raises:
        MeshError: a group names a cell twice, two groups have one name, or a name cannot stand in a file.
    """
    _check_names(mesh)
    whole = np.vstack([np.empty((0, 3), dtype=np.int32), *mesh.surface_groups.values()])
    _, first, same = np.unique(whole, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    place = np.searchsorted(kept, first[same.ravel()])
    ends = np.cumsum([len(group) for group in mesh.surface_groups.values()])
    members = np.split(place, ends[:-1]) if len(ends) else []
    surfaces = dict(zip(mesh.surface_groups, members, strict=True))
    return (
        GroupedCells(whole[kept], _flags(mesh, surfaces.items(), len(kept), "triangle")),
        GroupedCells(mesh.elements, _flags(mesh, mesh.element_groups.items(), len(mesh.elements), "element")),
    )


def _flags(mesh: VolumeMesh, groups: Iterable[tuple[str, np.ndarray]], count: int, what: str) -> dict[str, np.ndarray]:
    flags = {}
    for name, members in groups:
        flags[name] = np.zeros(count, dtype=bool)
        flags[name][members] = True
        if flags[name].sum() < len(members):
            raise MeshError(f"{mesh.source}: group '{name}' names one {what} twice")
    return flags


def _check_names(mesh: VolumeMesh) -> None:
    clash = mesh.surface_groups.keys() & mesh.element_groups.keys()
    if clash:
        raise MeshError(f"{mesh.source}: '{min(clash)}' names a surface group and an element group; two are needed")
    for name in (*mesh.surface_groups, *mesh.element_groups):
        if not name.isprintable() or name != name.strip() or not name or set(name) & set('"\\'):
            raise MeshError(f"{mesh.source}: a group is called {name!r}; files need a name without quotes")


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
    nodes_per_element = elements.cells.shape[1]
    tetrahedra = elements.cells[:, GMSH_ORDER[:nodes_per_element]]
    for dimension, number, cells, rows, cells_before in (
        (2, TRIANGLE, triangles, triangles.cells, len(elements.cells)),
        (3, TETRAHEDRA[nodes_per_element], elements, tetrahedra, 0),
    ):
        for entity, (_, members) in enumerate(cells.by_groups(), start=1):
            yield f"{dimension} {entity} {number} {len(members)}"
            for row in np.column_stack([members + cells_before, rows[members]]) + 1:
                yield " ".join(map(str, row.tolist()))
