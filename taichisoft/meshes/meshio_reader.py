"""What meshio reads of VTK, VTU and older MSH files, with the groups that each format can name."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.meshes.volume_mesh import MeshContent, four_triangles

NODE_COUNTS = {"triangle": 3, "triangle6": 6, "tetra": 4, "tetra10": 10, "hexahedron": 8}
DIMENSIONS = {"triangle": 2, "triangle6": 2, "tetra": 3, "tetra10": 3, "hexahedron": 3}

# Cell data of this prefix is 1 for the cells of a group and 0 for the others.
GROUP_PREFIX = "group:"


def read_with_meshio(path: Path) -> MeshContent:
    """Read a file in its own order.

    Raises:
        Exception: any that meshio's parsers raise for a broken file, up to SystemExit.
    """
    import meshio

    suffix = path.suffix.lower()
    if suffix == ".msh":
        _refuse_truncated(path)
    read = {".msh": meshio.gmsh.read, ".vtk": meshio.vtk.read, ".vtu": meshio.vtu.read}[suffix]
    with np.errstate(all="ignore"):  # an index that is none is found when the mesh is checked
        content = read(path)
    if np.ndim(content.points) != 2 or content.points.shape[1] != 3:
        raise ValueError("its points do not have three coordinates")
    if suffix == ".vtk":
        _refuse_lost_cells(path, sum(len(block.data) for block in content.cells))
    groups_of = _named_groups if suffix == ".msh" else _flagged_groups
    tetrahedra, element_groups = groups_of(content, _one_of(content, "tetra", "tetra10"))
    hexahedra, hexahedron_groups = groups_of(content, "hexahedron")
    triangles, surface_groups = groups_of(content, _one_of(content, "triangle", "triangle6"))
    if triangles.shape[1] == 6:
        triangles = four_triangles(triangles)
        surface_groups = {name: (4 * group[:, None] + np.arange(4)).ravel() for name, group in surface_groups.items()}
    others = _other_volumes(content)
    groups = element_groups, surface_groups
    return MeshContent(content.points, tetrahedra, triangles, *groups, others, hexahedra, hexahedron_groups)


def _named_groups(content: Any, cell_type: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """All cells of one type, (count, nodes), and the indices, (size,), of each physical group of MSH."""
    blocks = _blocks(content, cell_type)
    cells = _cells(content, cell_type)
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


def _flagged_groups(content: Any, cell_type: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """All cells of one type, and the indices of those that each array of flags marks; groups of none are left out."""
    blocks = _blocks(content, cell_type)
    groups = {}
    for name, parts in content.cell_data.items():
        if name.startswith(GROUP_PREFIX):
            members = np.flatnonzero(np.concatenate([np.empty(0), *(np.ravel(parts[b]) for b in blocks)]))
            if len(members):
                groups[name.removeprefix(GROUP_PREFIX)] = members
    return _cells(content, cell_type), groups


def _one_of(content: Any, linear: str, quadratic: str) -> str:
    """The one of two types that the file has cells of; ValueError if it has both."""
    found = [cell_type for cell_type in (linear, quadratic) if _blocks(content, cell_type)]
    if len(found) == 2:
        raise ValueError(f"it has cells of the types {linear} and {quadratic}; mesh again with one order of elements")
    return found[0] if found else linear


def _blocks(content: Any, cell_type: str) -> list[int]:
    return [number for number, block in enumerate(content.cells) if block.type == cell_type]


def _cells(content: Any, cell_type: str) -> np.ndarray:
    blocks = [content.cells[b].data for b in _blocks(content, cell_type)]
    return np.concatenate([np.empty((0, NODE_COUNTS[cell_type]), int), *blocks])


def _other_volumes(content: Any) -> dict[str, int]:
    others: dict[str, int] = {}
    for block in content.cells:
        if block.dim == 3 and block.type not in NODE_COUNTS:
            others[block.type] = others.get(block.type, 0) + len(block.data)
    return others


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


def _refuse_truncated(path: Path) -> None:
    """Refuse a truncated MSH file: it does not end with $End..., and meshio only warns."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 200, 0))
        if not file.read().rstrip().rpartition(b"\n")[2].startswith(b"$End"):
            raise ValueError("the file stops in the middle of a section")


def _refuse_lost_cells(path: Path, read: int) -> None:
    """Refuse a truncated file: meshio silently drops the last cells of a legacy VTK file that stops in their types."""
    announced = re.search(rb"^CELL_TYPES\s+(\d+)\s", path.read_bytes(), re.MULTILINE)
    if announced and int(announced[1]) != read:
        raise ValueError(f"it says that it has {announced[1].decode()} cells, but only {read} are there")
