"""Named groups of a mesh as the cells of files: each triangle once, and which groups each cell is in."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.volume_mesh import VolumeMesh


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
