"""How the fronts of a sparse Cholesky factorisation lie in memory.

Indices are in scalars, three for a node, unless said otherwise. A panel has rows for its own columns, padded to whole
tiles, and then for its rows below, padded likewise.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from taichisoft.cholesky.kernels.front_layout import IN_PARENT, Fronts
from taichisoft.cholesky.supernodes import Supernodes
from taichisoft.cholesky.tasks import FrontSizes, share_out
from taichisoft.errors import MeshError
from taichisoft.runtime.tiles import TILE

LARGEST_INDEX = 2**31 - 1


@dataclass(frozen=True)
class Layout:
    """The layout of all fronts.

    Attributes:
        fronts: what the kernels read.
        block_pairs: position of the row and the column node of each stored block, shape (block_count, 2).
        size: columns of tiles of all panels and update matrices.
    """

    fronts: Fronts
    block_pairs: np.ndarray
    size: int


def lay_out(adjacency: sparse.csr_matrix, supernodes: Supernodes) -> Layout:
    """Assign every part of every front its place in memory.

    Raises:
        MeshError: there are more numbers than the kernels can count.
    """
    width = 3 * np.diff(supernodes.first_column)
    columns = _padded(width)
    rest = 3 * np.diff(supernodes.row_start) - width
    tiles = _padded(rest) // TILE
    padding = columns - width
    panel_start = _offsets((columns // TILE + tiles) * columns)
    update_start = panel_start[-1] + _offsets(TILE * tiles * (tiles + 1) // 2)
    if TILE * update_start[-1] > LARGEST_INDEX:
        raise MeshError(
            f"the soft bodies' {len(supernodes.order)} nodes need {TILE * update_start[-1]:.3g} numbers for the "
            f"factorisation, of which the kernels can count {LARGEST_INDEX:.3g}; mesh the bodies more coarsely"
        )
    block_pairs, block_start, local_row, local_column = _place_blocks(adjacency, supernodes)
    owner = np.repeat(np.arange(supernodes.count), np.diff(block_start))
    child_start, child = _children(supernodes.parent)
    row_start = _offsets(TILE * tiles)
    table = np.column_stack(
        [
            np.append(width, 0),
            np.append(columns, 0),
            np.append(rest, 0),
            panel_start,
            update_start,
            block_start,
            child_start,
            row_start,
            3 * supernodes.first_column,
            np.zeros(supernodes.count + 1),
        ]
    ).astype(np.int32)
    position = np.full(row_start[-1] + 1, 3 * len(supernodes.order), dtype=np.int32)
    relative = np.zeros_like(position)
    for s, parent in enumerate(supernodes.parent):
        if parent >= 0:
            below = supernodes.rows[supernodes.row_start[s] + width[s] // 3 : supernodes.row_start[s + 1]]
            above = supernodes.rows[supernodes.row_start[parent] : supernodes.row_start[parent + 1]]
            place = slice(row_start[s], row_start[s] + rest[s])
            position[place] = _scalars(3 * below)
            local = 3 * np.searchsorted(above, below)
            relative[place] = _scalars(np.where(local < width[parent], local, local + padding[parent]))
            relative[place.stop : row_start[s + 1]] = relative[place.stop - 1]
            table[s, IN_PARENT] = np.searchsorted(relative[place], columns[parent])
    tasks, pieces, patience = share_out(FrontSizes(supernodes.parent, width, columns, rest, table[:-1, IN_PARENT]))
    block_row = np.where(local_row < width[owner], local_row, local_row + padding[owner])[:, None] + np.arange(3)
    block_column = panel_start[owner] + local_column
    block_place = TILE * (block_row // TILE * columns[owner][:, None] + block_column[:, None]) + block_row % TILE
    fronts = Fronts(
        table=table,
        rows=position,
        relative=relative,
        children=child,
        block_place=block_place.astype(np.int32),
        tasks=tasks,
        pieces=pieces,
        patience=np.array([patience], dtype=np.int32),
    )
    return Layout(fronts, block_pairs, int(update_start[-1]))


def _padded(count: np.ndarray) -> np.ndarray:
    return TILE * -(-count // TILE)


def _offsets(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)])


def _scalars(first: np.ndarray) -> np.ndarray:
    """The three scalars of each node from the first one."""
    return (first[:, None] + np.arange(3)).reshape(-1)


def _place_blocks(
    adjacency: sparse.csr_matrix, supernodes: Supernodes
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Blocks of the lower triangle by columns: node positions, start per supernode, row and column in its panel."""
    position = np.empty(len(supernodes.order), dtype=np.int64)
    position[supernodes.order] = np.arange(len(supernodes.order))
    owner = np.repeat(np.arange(supernodes.count), np.diff(supernodes.first_column))
    pattern = adjacency.tocoo()
    row, column = position[pattern.row], position[pattern.col]
    lower = row >= column
    row, column = row[lower], column[lower]
    by_column = np.lexsort((row, column))
    row, column = row[by_column], column[by_column]
    s = owner[column]
    start = np.searchsorted(s, np.arange(supernodes.count + 1))
    # Rows are ascending within a supernode, so one search over (supernode, row) finds every local row.
    key = np.repeat(np.arange(supernodes.count), np.diff(supernodes.row_start)) * (len(owner) + 1) + supernodes.rows
    local_row = np.searchsorted(key, s * (len(owner) + 1) + row) - supernodes.row_start[s]
    local_column = column - supernodes.first_column[s]
    return np.column_stack([row, column]), start, 3 * local_row, 3 * local_column


def _children(parent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Children of every supernode as one list, with the start of each, ascending."""
    child = np.flatnonzero(parent >= 0)
    child = child[np.argsort(parent[child], kind="stable")]
    start = np.searchsorted(parent[child], np.arange(len(parent) + 1))
    return start, np.append(child, 0).astype(np.int32)
