"""Writing VTK's XML files for ParaView: unstructured grids (.vtu) and lists of such files with times (.pvd).

Arrays are compressed with zlib and stand as base64 in their elements (https://docs.vtk.org, "XML File Formats"). Raw
bytes behind the XML would be smaller by a quarter, but meshio cannot read these with Python from 3.13.4 on.
"""

import zlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from taichisoft.atomic_file import atomic_file

CELL_TYPES = {1: 1, 2: 3, 3: 5, 4: 10, 10: 24}
"""VTK's numbers of vertex, line, triangle, tetrahedron and quadratic tetrahedron, by their numbers of points."""

BLOCK_BYTES = 1 << 20
"""VTK packs arrays in blocks of this size before compression."""

COMPONENTS = {3: ("X", "Y", "Z"), 6: ("XX", "YY", "ZZ", "XY", "YZ", "XZ")}
"""Names in ParaView of the components of vectors and symmetric tensors."""


@dataclass(frozen=True)
class Grid:
    """Points and cells with data on them.

    Attributes:
        points: positions, shape (point_count, 3).
        cells: point indices of cells of one type after the other, each of shape (count, points_per_cell).
        point_data: arrays by name, each (point_count,) or (point_count, components).
        cell_data: arrays by name, each (cell_count,) or (cell_count, components).
    """

    points: np.ndarray
    cells: Sequence[np.ndarray]
    point_data: Mapping[str, np.ndarray] = field(default_factory=dict)
    cell_data: Mapping[str, np.ndarray] = field(default_factory=dict)


def write_vtu(path: Path, grid: Grid) -> None:
    """Write a grid; real numbers get single precision, all others keep their type. The file's folder is made.

    Raises:
        TaichisoftError: the file cannot be written.
    """
    points = np.concatenate([np.full(len(cells), cells.shape[1], dtype=np.int64) for cells in grid.cells])
    types = np.concatenate([np.full(len(cells), CELL_TYPES[cells.shape[1]], dtype=np.uint8) for cells in grid.cells])
    connectivity = np.concatenate([cells.astype(np.int64).ravel() for cells in grid.cells])
    cells = {"connectivity": connectivity, "offsets": np.cumsum(points), "types": types}
    content = [
        f'<Piece NumberOfPoints="{len(grid.points)}" NumberOfCells="{len(types)}">',
        *_section("PointData", grid.point_data),
        *_section("CellData", grid.cell_data),
        *_section("Points", {"Points": grid.points}),
        *_section("Cells", cells),
        "</Piece>",
    ]
    _write(path, "UnstructuredGrid", content, ' header_type="UInt64" compressor="vtkZLibDataCompressor"')


def write_pvd(path: Path, files: Sequence[tuple[float, Path]]) -> None:
    """Write the list that ParaView opens: times [s] and files, which are named relative to the list's folder.

    Raises:
        TaichisoftError: the file cannot be written.
    """
    named = [(time, quoteattr(file.relative_to(path.parent).as_posix())) for time, file in files]
    _write(path, "Collection", [f'<DataSet timestep="{time:.12g}" part="0" file={name}/>' for time, name in named])


def _write(path: Path, kind: str, content: Sequence[str], attributes: str = "") -> None:
    """Write a file of a kind of data set."""
    begin = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian"{attributes}>'
    with atomic_file(path) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = [begin, f"<{kind}>", *content, f"</{kind}>", "</VTKFile>", ""]
        partial.write_text("\n".join(lines), encoding="utf-8")


def _section(tag: str, arrays: Mapping[str, np.ndarray]) -> list[str]:
    """The element `tag` with its arrays."""
    return [f"<{tag}>", *(_element(name, values) for name, values in arrays.items()), f"</{tag}>"]


def _element(name: str, values: np.ndarray) -> str:
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    elif values.dtype.kind == "f":
        values = values.astype(np.float32)
    type_name = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
    attributes = [f'type="{type_name}"', f"Name={quoteattr(name)}"]
    if values.ndim == 2:
        components = enumerate(COMPONENTS[values.shape[1]])
        attributes.append(f'NumberOfComponents="{values.shape[1]}"')
        attributes += [f'ComponentName{index}="{component}"' for index, component in components]
    content = _packed(values.astype(values.dtype.newbyteorder("<")).tobytes())
    return f'<DataArray {" ".join(attributes)} format="binary">{content}</DataArray>'


def _packed(content: bytes) -> str:
    """Number of blocks, block size, size of a smaller last block or 0, compressed sizes; then the blocks."""
    blocks = [zlib.compress(content[start : start + BLOCK_BYTES], 1) for start in range(0, len(content), BLOCK_BYTES)]
    header = [len(blocks), BLOCK_BYTES, len(content) % BLOCK_BYTES, *map(len, blocks)]
    return (b64encode(np.array(header, dtype="<u8").tobytes()) + b64encode(b"".join(blocks))).decode()
