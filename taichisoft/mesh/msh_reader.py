"""gmsh's MSH 1, and 4.1 as text and binary: with the groups of entities that are in several of them, or in none."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from taichisoft.mesh.volume_mesh import MeshContent, four_triangles

# By gmsh's number of a type of cell: how many nodes it has, and a name for those with a volume.
NODE_COUNTS = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1}
NODE_COUNTS |= {16: 8, 17: 20, 18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 29: 20, 30: 35, 31: 56}
VOLUME_NAMES = {6: "wedge", 7: "pyramid", 29: "tetra20"}
TRIANGLE, SIX_NODES, TETRAHEDRON, TEN_NODES, HEXAHEDRON = 2, 9, 4, 11, 5
VTK_ORDER = [*range(8), 9, 8]  # of the nodes of a ten-node tetrahedron in gmsh's order

Entity = tuple[int, int]
"""Dimension and tag of a piece of the geometry."""


class Numbers:
    """The numbers of a section in their order, as text or in this machine's bytes; ValueError where there are too few.

    Args:
        section: content between the two lines of the section.
        size_bytes: bytes of a `size_t` in a binary file; 0 for text.
    """

    def __init__(self, section: bytes, size_bytes: int):
        self._binary, self._size = bool(size_bytes), np.dtype(f"u{size_bytes or 8}")
        self._content = section if size_bytes else np.array(section.split(), dtype=bytes).astype(np.float64).tobytes()
        self._place = 0

    def floats(self, count: int) -> np.ndarray:
        """The next coordinates: gmsh's `double`."""
        return self._take(count, np.dtype(np.float64))

    def integers(self, count: int) -> np.ndarray:
        """The next tags and dimensions: gmsh's `int`."""
        return self._whole(count, np.dtype(np.int32))

    def sizes(self, count: int) -> np.ndarray:
        """The next counts, or numbers of nodes and cells: gmsh's `size_t`."""
        return self._whole(count, self._size)

    def _whole(self, count: int, kind: np.dtype) -> np.ndarray:
        values = self._take(count, kind if self._binary else np.dtype(np.float64))
        whole = np.nan_to_num(values).astype(np.int64)  # exact, also in text: no file has 2^53 of anything
        if (whole != values).any():
            raise ValueError(f"{values[np.argmax(whole != values)]:g} stands where a whole number is needed")
        return whole

    def _take(self, count: int, kind: np.dtype) -> np.ndarray:
        if count < 0 or self._place + count * kind.itemsize > len(self._content):
            raise ValueError("a section has fewer numbers than it says")
        values = np.frombuffer(self._content, kind, count, self._place)
        self._place += count * kind.itemsize
        return values


def read_msh(path: Path) -> MeshContent | None:
    """Read nodes and cells in the order of their numbers, and of MSH 4.1 the named groups.

    None for a file of another version; gmsh calls 4.1 4, too.

    Raises:
        ValueError: the file is broken.
        OSError: it cannot be read.
    """
    content = path.read_bytes()
    match content[:80].split()[:2]:
        case [b"$NOD", _]:
            return _read_msh1(content.decode(errors="replace"))
        case [b"$MeshFormat", b"4.1" | b"4"]:
            return _read_msh41(content)
    return None


def _read_msh1(text: str) -> MeshContent:
    """Nodes between $NOD and $ENDNOD, cells between $ELM and $ENDELM: number, type, group, entity, count and nodes."""
    (nod, _, *numbers), elm = (part.split() for part in text.partition("$ENDNOD")[::2])
    if nod != "$NOD" or elm[:1] != ["$ELM"] or elm[-1:] != ["$ENDELM"]:
        raise ValueError("it stops before $ENDELM")
    rows = np.array(numbers, dtype=np.float64).reshape(-1, 4)
    order = np.argsort(rows[:, 0], kind="stable")
    values, place = np.array(elm[2:-1], dtype=np.int64), 0
    listed: dict[int, list[np.ndarray]] = {}
    for _ in range(int(elm[1])):
        _, kind, _, _, count = values[place : place + 5]
        listed.setdefault(int(kind), []).append(values[place + 5 : place + 5 + count])
        place += 5 + int(count)
    cells = {
        kind: _indices(np.array(listed.get(kind, np.empty((0, NODE_COUNTS[kind]))), dtype=np.int64), rows[order, 0])
        for kind in (TRIANGLE, SIX_NODES, TETRAHEDRON, TEN_NODES, HEXAHEDRON)
    }
    return _content(rows[order, 1:], cells, {kind: len(nodes) for kind, nodes in listed.items()}, lambda *_: {})


def _read_msh41(content: bytes) -> MeshContent:
    sections = _sections(content)
    for needed in ("MeshFormat", "Nodes", "Elements"):
        if needed not in sections:
            raise ValueError(f"it has no ${needed}")
    size_bytes = _binary_size(sections["MeshFormat"])
    names = _names(sections.get("PhysicalNames", b""))
    tags = _tags_of_entities(Numbers(sections["Entities"], size_bytes)) if "Entities" in sections else {}
    node_numbers, nodes = _nodes(Numbers(sections["Nodes"], size_bytes))
    cells, entities, counts = _cells(Numbers(sections["Elements"], size_bytes), node_numbers)

    def groups(dimension: int, *kinds: int) -> dict[str, np.ndarray]:
        # A triangle of six nodes becomes four.
        entity = np.concatenate([np.repeat(entities[kind], 4 if kind == SIX_NODES else 1) for kind in kinds])
        inside = {
            tag: [number for (dim, number), carried in tags.items() if dim == dimension and tag in carried]
            for dim, tag in names
            if dim == dimension
        }
        return {names[dimension, tag]: np.flatnonzero(np.isin(entity, members)) for tag, members in inside.items()}

    return _content(nodes, cells, counts, groups)


def _content(
    nodes: np.ndarray,
    cells: Mapping[int, np.ndarray],
    counts: Mapping[int, int],
    groups: Callable[..., dict[str, np.ndarray]],
) -> MeshContent:
    """What was read, with the groups of a dimension and of cells of some types."""
    if TETRAHEDRON in counts and TEN_NODES in counts:
        raise ValueError("it has tetrahedra of four and of ten nodes; mesh again with one order of elements")
    tetrahedra, kind = cells[TETRAHEDRON], TETRAHEDRON
    if TEN_NODES in counts:
        tetrahedra, kind = cells[TEN_NODES][:, VTK_ORDER], TEN_NODES
    return MeshContent(
        nodes,
        tetrahedra,
        np.concatenate([cells[TRIANGLE], four_triangles(cells[SIX_NODES])]),
        groups(3, kind),
        groups(2, TRIANGLE, SIX_NODES),
        {name: counts[kind] for kind, name in VOLUME_NAMES.items() if kind in counts},
        cells[HEXAHEDRON],
        groups(3, HEXAHEDRON),
    )


def _sections(content: bytes) -> dict[str, bytes]:
    """Content between $Name and $EndName, by name."""
    sections = {}
    start = content.find(b"$")
    while start >= 0:
        name, _, _ = content[start + 1 : start + 80].partition(b"\n")
        closing = b"$End" + name.strip()
        body = start + 1 + len(name) + 1
        end = content.find(closing, body) if name.strip() else -1
        if end < 0:
            raise ValueError(f"the file stops in the middle of ${name.strip().decode(errors='replace')}")
        sections[name.strip().decode(errors="replace")] = content[body:end]
        start = content.find(b"$", end + len(closing))
    return sections


def _binary_size(head: bytes) -> int:
    """Bytes of a `size_t` in a binary file; 0 for text."""
    line, _, rest = head.partition(b"\n")
    _, binary, size_bytes = line.split()
    if binary == b"1" and np.frombuffer(rest, np.int32, 1)[0] != 1:
        raise ValueError("it was written by a machine of another byte order; save it again as text")
    return int(size_bytes) if binary == b"1" else 0


def _names(section: bytes) -> dict[Entity, str]:
    """Names of groups by dimension and tag, in the file's order."""
    names = {}
    for line in section.decode("utf-8").splitlines()[1:]:
        dimension, tag, quoted = line.split(maxsplit=2)
        names[int(dimension), int(tag)] = quoted.strip().removeprefix('"').removesuffix('"')
    return names


def _tags_of_entities(numbers: Numbers) -> dict[Entity, set[int]]:
    """The groups of each entity. A negative tag is gmsh's way to say that the group has the entity turned round."""
    tags = {}
    for dimension, count in enumerate(numbers.sizes(4)):
        for _ in range(count):
            entity = dimension, int(numbers.integers(1)[0])
            numbers.floats(6 if dimension else 3)  # its bounding box
            tags[entity] = {abs(int(tag)) for tag in numbers.integers(int(numbers.sizes(1)[0]))}
            if dimension:
                numbers.integers(int(numbers.sizes(1)[0]))  # what bounds it
    return tags


def _nodes(numbers: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the nodes, (node_count,), ascending, and their positions [mm], (node_count, 3)."""
    block_count, node_count, _, _ = numbers.sizes(4)
    tags, positions = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for _ in range(block_count):
        dimension, _, parametric = numbers.integers(3)
        count = int(numbers.sizes(1)[0])
        tags.append(numbers.sizes(count))
        width = 3 + (int(dimension) if parametric else 0)
        positions.append(numbers.floats(count * width).reshape(count, width)[:, :3])
    distinct, first = np.unique(np.concatenate(tags), return_index=True)
    if len(distinct) != node_count:
        raise ValueError(f"it has {len(distinct)} nodes with numbers of their own instead of {node_count}")
    return distinct, np.concatenate(positions)[first]


def _cells(
    numbers: Numbers, node_numbers: np.ndarray
) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray], Mapping[int, int]]:
    """Triangles, tetrahedra, hexahedra with indices of nodes, the entity of each, and how many cells each type has."""
    rows = {
        kind: [np.empty((0, 2 + NODE_COUNTS[kind]), dtype=np.int64)]
        for kind in (TRIANGLE, SIX_NODES, TETRAHEDRON, TEN_NODES, HEXAHEDRON)
    }
    counts: dict[int, int] = {}
    for _ in range(numbers.sizes(4)[0]):
        _, entity, kind = (int(value) for value in numbers.integers(3))
        count = int(numbers.sizes(1)[0])
        if kind not in NODE_COUNTS:
            raise ValueError(f"it has cells of type {kind}, which is not known here")
        block = numbers.sizes(count * (1 + NODE_COUNTS[kind])).reshape(count, -1)
        counts[kind] = counts.get(kind, 0) + count
        if kind in rows:
            rows[kind].append(np.column_stack([np.full(count, entity), block]))
    cells, entities = {}, {}
    for kind, blocks in rows.items():
        whole = np.concatenate(blocks)
        whole = whole[np.argsort(whole[:, 1], kind="stable")]
        cells[kind], entities[kind] = _indices(whole[:, 2:], node_numbers), whole[:, 0]
    return cells, entities, counts


def _indices(corners: np.ndarray, node_numbers: np.ndarray) -> np.ndarray:
    places = np.searchsorted(node_numbers, corners)
    known = places < len(node_numbers)
    known[known] = node_numbers[places[known]] == corners[known]
    if not known.all():
        raise ValueError(f"a cell names the node {corners[~known][0]}, which it does not have")
    return places
