"""A mesh's named groups as the physical groups of gmsh's MSH files, in meshio's terms."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh

DIMENSIONS = {"triangle": 2, "tetra": 3}
NO_GROUP = 0  # MSH's own tag for a cell of no group


def cells_and_groups(content: Any, cell_type: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """All cells of one type, (count, corners), in file order, and the indices, (size,), of each group.

    Args:
        content: a meshio.Mesh.
        cell_type: "triangle" or "tetra".
    """
    blocks = [number for number, block in enumerate(content.cells) if block.type == cell_type]
    corners = DIMENSIONS[cell_type] + 1
    cells = np.concatenate([np.empty((0, corners), int), *(content.cells[b].data for b in blocks)])
    tags = {
        name: int(tag) for name, (tag, dimension) in content.field_data.items() if dimension == DIMENSIONS[cell_type]
    }
    if tags and not content.cell_sets:  # MSH 2: every cell carries the tag of one group
        carried = content.cell_data.get("gmsh:physical")
        tag_of_cell = np.concatenate([np.empty(0, int), *(carried[b] for b in blocks)])
        return _merge_repetitions(cells, tag_of_cell, tags)
    # MSH 4: whole blocks belong to groups.
    starts = np.cumsum([0, *(len(content.cells[b].data) for b in blocks)])
    members = {
        name: [start + content.cell_sets[name][b] for start, b in zip(starts, blocks, strict=False)] for name in tags
    }
    return cells, {name: np.concatenate([np.empty(0, int), *parts]).astype(int) for name, parts in members.items()}


def with_physical_groups(mesh: VolumeMesh) -> Any:
    """The meshio.Mesh that MSH 2.2 is written from; a cell in several groups stands in it once for each.

    Raises:
        MeshError: a group's name cannot be kept.
    """
    import meshio

    names = _group_names(mesh)
    blocks: list[tuple[str, np.ndarray, np.ndarray]] = []
    for name, triangles in mesh.surface_groups.items():
        blocks.append(("triangle", triangles, np.full(len(triangles), names[name][0])))
    first_tag = np.full(len(mesh.elements), NO_GROUP)
    again = []
    for name, members in mesh.element_groups.items():
        grouped = first_tag[members] != NO_GROUP
        first_tag[members[~grouped]] = names[name][0]
        again.append(("tetra", mesh.elements[members[grouped]], np.full(grouped.sum(), names[name][0])))
    blocks += [("tetra", mesh.elements, first_tag), *again]
    blocks = [block for block in blocks if len(block[1])]
    tags = [tag.astype(np.int32) for _, _, tag in blocks]
    return meshio.Mesh(
        mesh.nodes,
        [(cell_type, cells) for cell_type, cells, _ in blocks],
        # Each group is an elementary entity of its own, too: gmsh shows and selects those.
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": [np.maximum(tag, 1) for tag in tags]},
        field_data=names,
    )


def _merge_repetitions(
    cells: np.ndarray, tag_of_cell: np.ndarray, tags: Mapping[str, int]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Count a cell once that the file repeats for each of its groups; one repeated within a group stays."""
    _, first, same = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    first_of_cell = first[same.ravel()]
    pairs = np.column_stack([first_of_cell, tag_of_cell])
    if len(np.unique(pairs, axis=0)) < len(pairs):
        return cells, {name: np.flatnonzero(tag_of_cell == tag) for name, tag in tags.items()}
    kept = np.sort(first)
    place = np.searchsorted(kept, first_of_cell)
    return cells[kept], {name: place[tag_of_cell == tag] for name, tag in tags.items()}


def _group_names(mesh: VolumeMesh) -> dict[str, np.ndarray]:
    """Tag and dimension by group name, as meshio's field data."""
    clash = mesh.surface_groups.keys() & mesh.element_groups.keys()
    if clash:
        raise MeshError(
            f"{mesh.source}: '{min(clash)}' names a surface group and an element group; MSH needs two names"
        )
    dimensions = [
        *((name, DIMENSIONS["triangle"]) for name in mesh.surface_groups),
        *((name, DIMENSIONS["tetra"]) for name in mesh.element_groups),
    ]
    for name, _ in dimensions:
        if not name.isprintable() or not name.strip() or set(name) & set('"\\'):
            raise MeshError(f"{mesh.source}: a group is called {name!r}; MSH needs a name without quotes")
    return {name: np.array([tag, dimension]) for tag, (name, dimension) in enumerate(dimensions, start=1)}
