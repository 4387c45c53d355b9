"""Files of volume meshes, surfaces and points: legacy VTK, VTU, gmsh's MSH, and what meshio and trimesh read."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base.files import atomic_file, is_file
from taichisoft.base.kept_files import kept_arrays, source_of
from taichisoft.errors import MeshError
from taichisoft.mesh.msh_reader import read_msh
from taichisoft.mesh.volume_mesh import MeshContent, VolumeMesh, four_triangles, refuse_coordinates

# Errors about a mesh or surface file that is of another kind, missing or broken.


def require_suffix(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, if its suffix is one of `suffixes`.

    Raises:
        MeshError: the suffix is another one; the message names the kind of file and the valid suffixes.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise MeshError(f"{path}: '{path.suffix}' is not a kind of {what} file; valid: {', '.join(suffixes)}")
    return path


def existing_file(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, if a file with one of `suffixes` exists and is not empty.

    Raises:
        MeshError: the file does not exist, is empty or has another suffix; the message names the kind of file.
    """
    path = require_suffix(path, what, suffixes)
    if not is_file(path):
        raise MeshError(f"{path}: no such file; a {what} ({', '.join(suffixes)}) is needed")
    if not path.stat().st_size:
        raise MeshError(f"{path}: is empty; a {what} ({', '.join(suffixes)}) is needed")
    return path


def unreadable(path: Path, error: BaseException) -> MeshError:
    """One line about the error of a parser."""
    why = " ".join(str(error).split()) or "broken, or another kind of file"
    if "gmsh:physical" in why:  # meshio's limit: MSH 4.0 with all elements saved, only some of them in a group
        why = "some elements are in no physical group; save it from gmsh without 'Save all elements', or as MSH 4.1"
    return MeshError(f"{path}: not readable as {path.suffix[1:].upper()}: {why}")


# Lists of points in files: JSON, or lines of text.

POINT_FORMATS: Mapping[str, Callable[[Path], np.ndarray]] = {
    ".json": lambda path: np.array(json.loads(path.read_text(encoding="utf-8")), dtype=np.float64),
    ".csv": lambda path: np.loadtxt(path, delimiter=",", ndmin=2),
}
POINT_SUFFIXES = tuple(POINT_FORMATS)


def read_points(path: str | Path) -> np.ndarray:
    """Read points [mm], shape (point_count, 3).

    A .json file is a list of [x, y, z]; a .csv file has a line with x, y, z for each point, after `#` a comment.
    """
    path = Path(path)
    try:
        points = POINT_FORMATS.get(path.suffix.lower(), POINT_FORMATS[".csv"])(path)
    except (OSError, ValueError, TypeError, RecursionError, OverflowError) as error:
        raise MeshError(f"{path}: cannot be read as a list of points: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise MeshError(f"{path}: must be a list of points with three finite coordinates each, such as [[0, 0, 5]]")
    return points


# What meshio reads of VTK, VTU and older MSH files, with the groups that each format can name.

NODE_COUNTS = {"triangle": 3, "triangle6": 6, "tetra": 4, "tetra10": 10, "hexahedron": 8}

# Cell data of this prefix is 1 for the cells of a group and 0 for the others.
GROUP_PREFIX = "group:"


def _read_msh(path: Path) -> MeshContent:
    content = read_msh(path)
    if content is None:
        _refuse_truncated(path)
        content = _read_with_meshio(path, "gmsh", _named_groups)
    return content


def _read_with_meshio(
    path: Path, module: str, groups_of: "Callable[[Any, str], tuple[np.ndarray, dict[str, np.ndarray]]]"
) -> MeshContent:
    import meshio

    with np.errstate(all="ignore"):  # an index that is none is found when the mesh is checked
        content = getattr(meshio, module).read(path)
    if np.ndim(content.points) != 2 or content.points.shape[1] != 3:
        raise ValueError("its points do not have three coordinates")
    if module == "vtk":
        _refuse_lost_cells(path, sum(len(block.data) for block in content.cells))
    tetrahedra, element_groups = groups_of(content, _one_of(content, "tetra", "tetra10"))
    hexahedra, hexahedron_groups = groups_of(content, "hexahedron")
    triangles, surface_groups = groups_of(content, _one_of(content, "triangle", "triangle6"))
    if triangles.shape[1] == 6:
        triangles = four_triangles(triangles)
        surface_groups = {name: (4 * group[:, None] + np.arange(4)).ravel() for name, group in surface_groups.items()}
    others = Counter[str]()
    for block in content.cells:
        if block.dim == 3 and block.type not in NODE_COUNTS:
            others[block.type] += len(block.data)
    groups = element_groups, surface_groups
    return MeshContent(content.points, tetrahedra, triangles, *groups, others, hexahedra, hexahedron_groups)


def _named_groups(content: Any, cell_type: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """All cells of one type, (count, nodes), and the indices, (size,), of each physical group of MSH."""
    blocks = _blocks(content, cell_type)
    cells = _cells_of_kind(content, cell_type)
    tags = {
        name: int(tag)
        for name, (tag, dimension) in content.field_data.items()
        if dimension == (2 if cell_type.startswith("triangle") else 3)
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
    return _cells_of_kind(content, cell_type), groups


def _one_of(content: Any, linear: str, quadratic: str) -> str:
    """The one of two types that the file has cells of; ValueError if it has both."""
    present = [cell_type for cell_type in (linear, quadratic) if _blocks(content, cell_type)]
    if len(present) == 2:
        raise ValueError(f"it has cells of the types {linear} and {quadratic}; mesh again with one order of elements")
    return present[0] if present else linear


def _blocks(content: Any, cell_type: str) -> list[int]:
    return [number for number, block in enumerate(content.cells) if block.type == cell_type]


def _cells_of_kind(content: Any, cell_type: str) -> np.ndarray:
    blocks = [content.cells[b].data for b in _blocks(content, cell_type)]
    return np.concatenate([np.empty((0, NODE_COUNTS[cell_type]), int), *blocks])


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


# Surfaces in files: triangles as STL, OBJ and PLY.

SURFACE_SUFFIXES = (".stl", ".obj", ".ply")


def read_surface(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a triangulated surface from STL, OBJ or PLY; polygons are cut into triangles.

    Vertices at exactly the same place become one (STL repeats them for every triangle), those in no triangle
    are dropped, and so are triangles with two equal corners. What was read is kept for the next process.

    Returns:
        Vertices [mm], shape (vertex_count, 3), and triangles of vertex indices, shape (triangle_count, 3).

    Raises:
        MeshError: the file is missing, unreadable or of another kind, or has no triangle or a NaN.
    """
    path = existing_file(path, "surface", SURFACE_SUFFIXES)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    depends_on = [source_of(__file__), path.suffix.lower().encode(), content]
    vertices, triangles = kept_arrays("surfaces", depends_on, lambda: _parsed(path))
    return vertices, triangles


def _parsed(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What trimesh reads from a file, which takes half a second to import."""
    import trimesh

    try:
        if path.suffix.lower() == ".ply":
            _refuse_truncated_ply(path.read_bytes())
        surface = trimesh.load_mesh(path, process=False)
        if not isinstance(surface, trimesh.Trimesh):
            raise ValueError("no faces")
        vertices = np.array(surface.vertices, dtype=np.float64)
        triangles = np.array(surface.faces, dtype=np.int64)
    except Exception as error:  # trimesh's parsers raise exceptions of any kind for a broken file
        raise unreadable(path, error) from error
    if len(triangles) == 0:
        raise MeshError(f"{path}: has no faces; a surface of triangles is needed")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"{path}: a face names a vertex outside 0..{len(vertices) - 1}")
    refuse_coordinates(vertices, path, "vertex")
    return _merge_equal_vertices(vertices, triangles, path)


def write_stl(vertices: np.ndarray, triangles: np.ndarray, path: Path) -> None:
    """Write a surface as STL in text, every digit of its vertices kept; it appears under its name when complete.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        path: file to write.

    Raises:
        MeshError: the file cannot be written.
    """
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    with atomic_file(path, MeshError) as partial, partial.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"solid {path.stem}\n")
        for normal, corners in zip(normals.tolist(), vertices[triangles].tolist(), strict=True):
            file.write("facet normal {!r} {!r} {!r}\n outer loop\n".format(*normal))
            for corner in corners:
                file.write("  vertex {!r} {!r} {!r}\n".format(*corner))
            file.write(" endloop\nendfacet\n")
        file.write(f"endsolid {path.stem}\n")


def _refuse_truncated_ply(content: bytes) -> None:
    """Refuse a truncated PLY file in text: trimesh silently drops the missing end."""
    head, _, body = content.partition(b"end_header")
    if b"format ascii" in head:
        announced = sum(map(int, re.findall(rb"^element\s+\S+\s+(\d+)", head, re.MULTILINE)))
        there = sum(bool(line.strip()) for line in body.splitlines())
        if there < announced:
            raise ValueError(f"it says that it has {announced} vertices and faces, but only {there} are there")


def _merge_equal_vertices(vertices: np.ndarray, triangles: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    triangles = first[same.ravel()][triangles]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise MeshError(f"{path}: every face has two equal corners; a surface of triangles is needed")
    used, corners = np.unique(triangles[whole], return_inverse=True)
    return vertices[used], corners.reshape(-1, 3).astype(np.int32)


# Tetrahedra written to gmsh's MSH, VTU and legacy VTK, with the named groups that each format can keep.

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
    """Write legacy VTK for other programs: the tetrahedra alone."""
    import meshio

    # Version 4.2: most programs besides ParaView do not know the arrays of 5.1.
    meshio.vtk.write(
        path, meshio.Mesh(mesh.nodes, [(MESHIO_TETRAHEDRA[mesh.elements.shape[1]], mesh.elements)]), fmt_version="4.2"
    )


def write_vtu(mesh: VolumeMesh, path: Path) -> None:
    """Write VTU, with flags for the cells of each group that has any."""
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
    """The triangles of all surface groups, each once, in the order in which the groups name them; and the elements."""
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


# Meshes in files: tetrahedra as legacy VTK, VTU and gmsh's MSH.

FORMATS: Mapping[str, tuple[Callable[[Path], MeshContent], Callable[[VolumeMesh, Path], None]]] = {
    ".msh": (_read_msh, write_msh),
    ".vtk": (lambda path: _read_with_meshio(path, "vtk", _flagged_groups), write_vtk),
    ".vtu": (lambda path: _read_with_meshio(path, "vtu", _flagged_groups), write_vtu),
}
"""By suffix, what reads a file of volume meshes and what writes it."""
VOLUME_SUFFIXES = tuple(FORMATS)


def read_volume_mesh(path: str | Path) -> VolumeMesh:
    """Read tetrahedra of four or ten nodes from legacy VTK, VTU or MSH (1, 2.2, 4.0, 4.1, text or binary).

    Nodes and tetrahedra keep the file's order, in MSH 4.1 that of their numbers, but ten nodes of a tetrahedron come in
    VTK's order; positions are in [mm]. Named groups of triangles (the physical groups of MSH, cell data called
    "group:NAME" in VTK and VTU) become the mesh's surface groups, with four triangles for one of six nodes; groups of
    tetrahedra become its element groups; the file's points, lines and other triangles are ignored. No tetrahedron is
    ever turned round, because the corotational frames depend on the order of its nodes: an inverted one is an error.

    Args:
        path: file whose suffix, .msh, .vtk or .vtu, says the format.

    Raises:
        MeshError: the file is missing, unreadable, of another kind, or its mesh is not fit to simulate.
    """
    return read_unchecked_mesh(path).check()


def read_unchecked_mesh(path: str | Path) -> VolumeMesh:
    """Read a mesh as `read_volume_mesh` does, without checking that it is fit to simulate.

    Raises:
        MeshError: the file is missing, unreadable or of another kind, or has other cells than tetrahedra.
    """
    path = existing_file(path, "volume mesh", VOLUME_SUFFIXES)
    read, _ = FORMATS[path.suffix.lower()]
    try:
        content = read(path)
    # For a broken file the parsers raise exceptions of any kind, up to SystemExit.
    except (Exception, SystemExit) as error:
        raise unreadable(path, error) from error
    return content.mesh(str(path))


def write_volume_mesh(mesh: VolumeMesh, path: str | Path) -> None:
    """Write tetrahedra of four or ten nodes; reading them again gives equal nodes, bit for bit, and equal elements.

    MSH (4.1, as text) and VTU keep the groups: a triangle in several surface groups stands in the file once, and each
    group comes back in the order of the first that names its triangles. VTU has no place for a group of nothing.
    Triangles are written with three nodes, four of them on each side of a tetrahedron of ten nodes. Legacy VTK is for
    other programs: it has the tetrahedra alone. The file appears under its name when it is complete.

    Args:
        mesh: mesh of tetrahedra.
        path: file whose suffix, .msh, .vtu or .vtk, says the format.

    Raises:
        MeshError: the suffix is unknown, the file cannot be written, or a group cannot be kept.
    """
    path = require_suffix(path, "volume mesh", VOLUME_SUFFIXES)
    _, write = FORMATS[path.suffix.lower()]
    with atomic_file(path, MeshError) as partial:
        write(mesh, partial)
