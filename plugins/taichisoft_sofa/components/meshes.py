"""Meshes of SOFA's loaders: readers of their files, and their transformation."""

import contextlib
import functools
import io
import itertools
import math
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mesh import existing_file, read_msh, unreadable
from taichisoft_sofa.components.reading import LOADERS, node_of
from taichisoft_sofa.tree.component import Component, component, derived, unused, without_effect
from taichisoft_sofa.tree.scene_modules import running
from taichisoft_sofa.tree.value_kinds import Declared, fixed, index_rows, vectors
from taichisoft_sofa.tree.value_kinds import numbers as parse_numbers

# Scale, rotation and translation as SOFA's loaders and mechanical objects apply them, to the last bit.
#
# Rotations are about the fixed x, y and z axes, in this order. The last bit matters if a box selects nodes on its
# faces.


def rotation_matrix(degrees: Sequence[float]) -> np.ndarray:
    """Matrix (3, 3) of rotations about the x, y and z axes [degrees], by way of a quaternion as in SOFA."""
    x, y, z, w = quaternion(degrees)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (z * x + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (z * z + x * x), 2 * (y * z - x * w)],
            [2 * (z * x - y * w), 2 * (y * z + x * w), 1 - 2 * (y * y + x * x)],
        ]
    )


def quaternion(degrees: Sequence[float]) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of rotations about the x, y and z axes [degrees]."""
    halves = [angle * math.pi / 180.0 / 2.0 for angle in degrees]
    (cx, cy, cz), (sx, sy, sz) = map(math.cos, halves), map(math.sin, halves)
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def multiply_quaternions(first: Sequence[float], second: Sequence[float]) -> np.ndarray:
    """Quaternion (x, y, z, w) of a rotation by `second`, then by `first`."""
    a, b = np.array(first[:3]), np.array(second[:3])
    return np.array([*(first[3] * b + second[3] * a + np.cross(a, b)), first[3] * second[3] - a @ b])


def placed(
    points: np.ndarray, scale: Sequence[float], rotation: Sequence[float], translation: Sequence[float]
) -> np.ndarray:
    """Points (count, 3) [mm] scaled, then rotated [degrees], then translated [mm]."""
    return _transformed(points, rotation_matrix(rotation) * np.asarray(scale), translation)


def placed_by_loader(
    points: np.ndarray, scale: Sequence[float], rotation: Sequence[float], translation: Sequence[float]
) -> np.ndarray:
    """Points transformed as by a loader: when it reads the file, and again at its initialisation.

    The second time it first inverts the first transformation, with round-off errors: a node of a rotated mesh that
    should lie on the plane z = 0 may lie 1e-30 below it, outside a box that ends there.
    """
    matrix = rotation_matrix(rotation) * np.asarray(scale)
    if (matrix == np.eye(3)).all() and not np.any(translation):
        return points
    inverse = _inverse(matrix)
    back = [-((row[0] * translation[0] + row[1] * translation[1]) + row[2] * translation[2]) for row in inverse]
    once = _transformed(points, matrix, translation)
    return _transformed(_transformed(once, inverse, back), matrix, translation)


def _transformed(points: np.ndarray, matrix: np.ndarray, shift: Sequence[float]) -> np.ndarray:
    x, y, z = np.asarray(points, dtype=np.float64).reshape(-1, 3).T
    return np.column_stack([((row[0] * x + row[1] * y) + row[2] * z) + s for row, s in zip(matrix, shift, strict=True)])


def _inverse(m: np.ndarray) -> np.ndarray:
    """Inverse by cofactors, with the round-off errors of SOFA instead of those by a factorisation."""
    determinant = (
        m[0, 0] * m[1, 1] * m[2, 2]
        + m[1, 0] * m[2, 1] * m[0, 2]
        + m[2, 0] * m[0, 1] * m[1, 2]
        - m[0, 0] * m[2, 1] * m[1, 2]
        - m[1, 0] * m[0, 1] * m[2, 2]
        - m[2, 0] * m[1, 1] * m[0, 2]
    )
    inverse = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = (m[a, c] * m[b, d] - m[b, c] * m[a, d]) / determinant
    return inverse


def no_cells(corners: int) -> np.ndarray:
    """An empty array of cells, shape (0, corners)."""
    return np.zeros((0, corners), dtype=np.int64)


@dataclass(frozen=True)
class LoadedMesh:
    """Points and cells in the order of the file.

    Attributes:
        points: positions [mm], shape (point_count, 3).
        edges: point indices, shape (edge_count, 2).
        triangles: point indices, shape (triangle_count, 3).
        quads: point indices, shape (quad_count, 4).
        tetrahedra: point indices, shape (tetrahedron_count, 4).
        hexahedra: point indices, shape (hexahedron_count, 8).
    """

    points: np.ndarray
    edges: np.ndarray = field(default_factory=lambda: no_cells(2))
    triangles: np.ndarray = field(default_factory=lambda: no_cells(3))
    quads: np.ndarray = field(default_factory=lambda: no_cells(4))
    tetrahedra: np.ndarray = field(default_factory=lambda: no_cells(4))
    hexahedra: np.ndarray = field(default_factory=lambda: no_cells(8))


def split_quads(quads: np.ndarray) -> np.ndarray:
    """Split each quad in two triangles, shape (2 * quad_count, 3)."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


# Stand-ins, with the same names and sizes, for meshes of SOFA itself that scenes use.


def _box(lower: tuple[float, float, float], upper: tuple[float, float, float], pieces: int) -> LoadedMesh:
    """Surface of a box, facing outward, with pieces x pieces squares of two triangles on each face."""
    grid = np.linspace(0.0, 1.0, pieces + 1)
    points = np.array([[x, y, z] for x in grid for y in grid for z in grid])
    number = np.arange(len(points)).reshape(pieces + 1, pieces + 1, pieces + 1)
    on_surface = ((points == 0.0) | (points == 1.0)).any(axis=1)
    quads = []
    for axis in range(3):
        for end, turned in ((0, True), (-1, False)):
            face = np.take(number, end, axis=axis)
            corners = np.stack([face[:-1, :-1], face[1:, :-1], face[1:, 1:], face[:-1, 1:]], axis=-1).reshape(-1, 4)
            # The cross product of the two other axes points along the third axis, or against it if that is y.
            quads.append(corners[:, ::-1] if turned != (axis == 1) else corners)
    renumbered = np.cumsum(on_surface) - 1
    quad = renumbered[np.vstack(quads)]
    triangles = quad[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return LoadedMesh(np.array(lower) + points[on_surface] * np.subtract(upper, lower), triangles=triangles)


def _plate(half_width: float) -> LoadedMesh:
    """A square in the plane y = 0, facing upward."""
    w = half_width
    corners = [[-w, 0.0, -w], [-w, 0.0, w], [w, 0.0, w], [w, 0.0, -w]]
    return LoadedMesh(np.array(corners), quads=np.array([[0, 1, 2, 3]]))


def _ball() -> LoadedMesh:
    """A sphere of radius 1, facing outward."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2)
    return LoadedMesh(np.array(ball.vertices), triangles=np.array(ball.faces, dtype=np.int64))


STOCK_MESHES: dict[str, Callable[[], LoadedMesh]] = {
    "mesh/smCube27.obj": lambda: _box((-3.5, -3.5, -3.5), (3.5, 3.5, 3.5), 2),
    "mesh/ball.obj": _ball,
    "mesh/cube.obj": lambda: _box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 1),
    "mesh/floorFlat.obj": lambda: _plate(20.0),
    "mesh/floor.obj": lambda: _box((-74.67, -5.33, -74.67), (74.67, -1.33, 74.67), 1),
}
"""Functions that make the meshes, by name."""


def find_mesh(name: str, find_file: Callable[[str], Path | None]) -> Path:
    """Path of a mesh: a file found by `find_file`, or the name of one of SOFA's meshes known to `read_mesh`."""
    found = find_file(str(Path(name).expanduser()))
    if found is not None:
        return found.resolve()
    if Path(name).as_posix() not in STOCK_MESHES:
        known = ", ".join(STOCK_MESHES)
        raise MeshError(f"{name}: no such file beside the scene or in its folders; SOFA's own that are known: {known}")
    return Path(name)


# Readers for the files of SOFA's loaders: VTK, STL, OBJ, Gmsh and GiD, in the order of the file.

# meshio's names of the cells of a loader.
CELLS = {"edges": "line", "triangles": "triangle", "quads": "quad", "tetrahedra": "tetra", "hexahedra": "hexahedron"}


def read_mesh(path: Path) -> LoadedMesh:
    """Read a mesh found by `find_mesh`, or make the stand-in for a mesh of SOFA's by its name."""
    if path.as_posix() in STOCK_MESHES:
        return STOCK_MESHES[path.as_posix()]()
    path = existing_file(path, "mesh", tuple(READERS))
    return _read_file(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=64)
def _read_file(path: Path, stamp: int) -> LoadedMesh:
    """Read a file; `stamp` is its time of modification, as a key of the cache."""
    try:
        # Suppress meshio's unescaped messages; errors are reported below.
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            mesh = READERS[path.suffix.lower()](path)
    except (Exception, SystemExit) as error:  # broken files make the parsers raise any exception
        raise error if isinstance(error, MeshError) else unreadable(path, error) from error
    for array in vars(mesh).values():
        array.flags.writeable = False  # shared by all readers of the file
    return mesh


def _read_vtk(path: Path) -> LoadedMesh:
    """Read a file of VTK's older format or in XML, with decimal coordinates in double precision."""
    import meshio

    content = path.read_bytes()
    xml = content.lstrip().startswith((b"<?xml", b"<VTKFile"))
    if xml and not re.search(rb"<VTKFile[^>]*type\s*=\s*[\"']UnstructuredGrid", content):
        raise MeshError(f"{path}: is XML of VTK, but not an UnstructuredGrid; save the mesh as one")
    doubles = re.sub(ASCII_ARRAY if xml else ASCII_POINTS, _in_doubles, content)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"mesh{'.vtu' if xml else '.vtk'}"
        copy.write_bytes(doubles)
        return _from_meshio(meshio.read(copy))


# Head of decimal arrays, with the precision in which they are read.
ASCII_ARRAY = rb"<DataArray[^>]*format\s*=\s*[\"']ascii[\"'][^>]*>|<DataArray(?![^>]*format)[^>]*>"
ASCII_POINTS = rb"\A[^\n]*\n[^\n]*\n\s*ASCII\b[\s\S]*?\bPOINTS\s+\d+\s+float\b"


def _in_doubles(head: re.Match[bytes]) -> bytes:
    """Replace the precision in the head of an array by double precision."""
    return re.sub(rb"Float32", b"Float64", re.sub(rb"\bfloat\Z", b"double", head[0]))


def _read_gmsh(path: Path) -> LoadedMesh:
    content = read_msh(path)
    if content is not None:
        return LoadedMesh(content.nodes, triangles=content.triangles, tetrahedra=content.tetrahedra)
    import meshio

    return _from_meshio(meshio.read(path))


def _from_meshio(mesh: Any) -> LoadedMesh:
    cells = {name: mesh.cells_dict[kind].astype(np.int64) for name, kind in CELLS.items() if kind in mesh.cells_dict}
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    return LoadedMesh(points, **cells)


def _read_stl(path: Path) -> LoadedMesh:
    """Read triangles; equal corners become one point, in the order of their first occurrence."""
    import trimesh

    soup = trimesh.load_mesh(path, process=False)
    _, first, same = np.unique(np.array(soup.vertices), axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    triangles = np.searchsorted(kept, first[same.ravel()])[np.array(soup.faces)]
    return LoadedMesh(np.array(soup.vertices, dtype=np.float64)[kept], triangles=triangles.astype(np.int64))


def _read_obj(path: Path) -> LoadedMesh:
    """Read all vertices, with or without faces, and faces; faces of more than four corners become triangles."""
    points: list[list[float]] = []
    faces: dict[int, list[list[int]]] = {2: [], 3: [], 4: []}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        word, *values = line.split() or [""]
        if word == "v":
            points.append([float(value) for value in values[:3]])
        elif word in ("f", "l"):
            corners = [int(value.partition("/")[0]) for value in values]
            corners = [corner - 1 if corner > 0 else len(points) + corner for corner in corners]
            if word == "l":
                faces[2] += [list(pair) for pair in itertools.pairwise(corners)]
            elif len(corners) <= 4:
                faces[len(corners)].append(corners)
            else:
                faces[3] += [[corners[0], *corners[i : i + 2]] for i in range(1, len(corners) - 1)]
    cells = [np.array(faces[count], dtype=np.int64) if faces[count] else no_cells(count) for count in (2, 3, 4)]
    for cell in cells:
        if cell.size and (cell.min() < 0 or cell.max() >= len(points)):
            raise MeshError(f"{path}: a face names a vertex outside 1..{len(points)}")
    return LoadedMesh(np.array(points, dtype=np.float64).reshape(-1, 3), *cells)


def _read_gid(path: Path) -> LoadedMesh:
    """Read a mesh of GiD: one kind of element of straight edges, whose numbers of nodes begin at 1."""
    text = path.read_text(encoding="utf-8", errors="replace")
    head = re.search(r"ElemType\s+(\w+)\s+Nnode\s+(\d+)", text, re.IGNORECASE)
    cells = GID_CELLS.get((head[1].lower(), int(head[2]))) if head else None
    if head is None or cells is None:
        kinds = ", ".join(f"{kind.capitalize()} of {count} nodes" for kind, count in GID_CELLS)
        raise MeshError(f"{path}: {head[0] if head else 'has no ElemType and Nnode'}; known are {kinds}")
    points, elements = (_gid_rows(path, text, block) for block in ("Coordinates", "Elements"))
    place = {int(number): index for index, number in enumerate(points[:, 0])}
    corners = elements[:, 1 : 1 + int(head[2])].astype(np.int64)
    if missing := sorted(set(corners.ravel().tolist()) - place.keys()):
        raise MeshError(f"{path}: an element names node {missing[0]}, which is not among the coordinates")
    position = np.zeros((len(points), 3))
    position[:, : min(points.shape[1] - 1, 3)] = points[:, 1:4]
    return LoadedMesh(position, **{cells: np.vectorize(place.__getitem__, otypes=[np.int64])(corners)})


GID_CELLS = {
    ("linear", 2): "edges",
    ("triangle", 3): "triangles",
    ("quadrilateral", 4): "quads",
    ("tetrahedra", 4): "tetrahedra",
    ("hexahedra", 8): "hexahedra",
}
"""Cells of a loader by GiD's type of element and number of nodes."""


def _gid_rows(path: Path, text: str, block: str) -> np.ndarray:
    """Numbers between the lines BLOCK and End BLOCK, a row for each line."""
    found = re.search(rf"^\s*{block}\s*$(.*?)^\s*End\s+{block}", text, re.IGNORECASE | re.MULTILINE | re.DOTALL)
    if found is None or not found[1].strip():
        raise MeshError(f"{path}: has no lines between '{block}' and 'End {block}'")
    return np.asarray(np.loadtxt(io.StringIO(found[1]), ndmin=2))


READERS: dict[str, Callable[[Path], LoadedMesh]] = {
    ".vtk": _read_vtk,
    ".vtu": _read_vtk,
    ".stl": _read_stl,
    ".obj": _read_obj,
    ".msh": _read_gmsh,
    ".gmsh": _read_gmsh,
    ".gidmsh": _read_gid,
    ".gid": _read_gid,
}


CORNERS = {"edges": 2, "triangles": 3, "quads": 4, "tetrahedra": 4, "hexahedra": 8}
"""Number of corners of each kind of cell."""

OTHER_NAMES = {"tetrahedra": ("tetras",), "hexahedra": ("hexas",)}
"""Older names of the data with cells."""


def read_loader(loader: "Component") -> LoadedMesh:
    """The mesh of a loader, as in the file."""
    name = loader.read_text("filename", "fileMesh", "fileTopology")
    if not name:
        raise loader.refused("filename is missing; name a mesh")
    try:
        return read_mesh(find_mesh(name, file_finder(loader)))
    except MeshError as error:
        raise loader.refused(f"{error}") from error


def file_finder(component: "Component") -> Callable[[str], Path | None]:
    """Function that finds the files of a scene: of its tree, or, during the construction, of the running scene."""
    root = node_of(component).getRoot()
    find: Callable[[str], Path | None] = getattr(root, "_find_file", None) or running().find_file
    return find


def loader_position(loader: "Component") -> np.ndarray:
    """Points of a loader [mm], scaled, rotated and translated, shape (count, 3)."""
    scale = loader.read_vector("scale3d") * loader.read_number("scale")
    rotation = loader.read_vector("rotation", "rotation2")
    translation = loader.read_vector("translation", "translation2")
    return placed_by_loader(read_loader(loader).points, scale.tolist(), rotation.tolist(), translation.tolist())


TRANSFORMED = {
    "scale": 1.0,
    "scale3d": (fixed(3), (1.0, 1.0, 1.0)),
    "rotation": fixed(3),
    "translation": fixed(3),
}
"""Data of components that scale, turn and shift points."""
TURNED_AGAIN = {"rotation2": fixed(3), "translation2": fixed(3)}


def cells_by(compute: Callable[..., np.ndarray]) -> dict[str, Declared]:
    """The data of every kind of cell, under all names, computed by a function of the component and the kind."""
    return {
        name: derived(index_rows(corners), partial(compute, kind=kind))
        for kind, corners in CORNERS.items()
        for name in (kind, *OTHER_NAMES.get(kind, ()))
    }


def _loader_cells(loader: "Component", kind: str) -> np.ndarray:
    return np.asarray(getattr(read_loader(loader), kind))


def _spheres(loader: "Component") -> np.ndarray:
    """Centres and radii of a file of spheres, before their transformation [mm], shape (count, 4)."""
    path = file_finder(loader)(loader.read_text("filename"))
    if path is None:
        raise loader.refused(
            f"filename '{loader.read_text('filename')}': no such file beside the scene or in its folders"
        )
    content = path.read_text(encoding="utf-8", errors="replace")
    rows = re.findall(r"^\s*sphe\s+\d+((?:\s+\S+){4})", content, re.MULTILINE)
    return parse_numbers(" ".join(rows)).reshape(-1, 4)


def _centres(loader: "Component") -> np.ndarray:
    scale, turn, shift = (loader.read_vector(name).tolist() for name in ("scale3d", "rotation", "translation"))
    return placed(_spheres(loader)[:, :3], scale, turn, shift)


@component(
    "SphereLoader",
    filename="",
    **TRANSFORMED,
    position=derived(vectors(3), _centres),
    listRadius=derived((), lambda loader: _spheres(loader)[:, 3]),
)
@component(
    *sorted(LOADERS),
    filename="",
    fileMesh="",
    fileTopology="",
    **TRANSFORMED,
    **TURNED_AGAIN,
    position=derived(vectors(3), loader_position),
    **cells_by(_loader_cells),
    transformation=unused(""),
    flipNormals=unused(False),
    **without_effect("triangulate fillMesh"),
)
def accept_loader(component: "Component", draft: object) -> None:
    """Accept a loader, which other components read."""
