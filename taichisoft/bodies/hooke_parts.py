"""The blocks of the system matrix under Hooke's law: which entries of which domains add to each."""

import numpy as np

from taichisoft.bodies.kernels.hooke_blocks import BlockParts


def find_blocks(block_pairs: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Number of the block of each pair of nodes, -1 where it is not stored.

    Args:
        block_pairs: the two nodes (row, column) of each stored block, shape (block_count, 2); of two blocks that are
            each other's transpose one is stored.
        row, column: nodes, of equal shapes.
    """
    node_count = int(block_pairs.max()) + 1
    key = row.astype(np.int64) * node_count + column
    stored = block_pairs.astype(np.int64) @ [node_count, 1]
    by_key = np.argsort(stored)
    place = np.minimum(np.searchsorted(stored[by_key], key), len(stored) - 1)
    return np.where(stored[by_key[place]] == key, by_key[place], -1)


def node_of_block(block_pairs: np.ndarray) -> np.ndarray:
    """The node of each block on the diagonal, -1 for others."""
    return np.where(block_pairs[:, 0] == block_pairs[:, 1], block_pairs[:, 0], -1).astype(np.int32)


def find_parts(
    block_pairs: np.ndarray,
    block: np.ndarray,
    row: np.ndarray,
    column: np.ndarray,
    lame_ratio: np.ndarray,
    shaped: np.ndarray,
) -> BlockParts:
    """The parts of each block, sorted into runs of domains that are alike.

    Args:
        block_pairs: the two nodes (row, column) of each block, shape (block_count, 2).
        block: number of the block that each part belongs to, shape (part_count,); the arrays that follow alike.
        row, column: entries of the block's two nodes in the domain.
        lame_ratio: lambda / mu of the domain, or as `BlockParts` says.
        shaped: whether energy of shape counts.
    """
    order = np.lexsort((lame_ratio, shaped, block))
    alike = np.column_stack([block, shaped, lame_ratio])[order]
    first = np.flatnonzero(np.append(True, (alike[1:] != alike[:-1]).any(axis=1))[: len(order)])
    return BlockParts(
        run_start=np.searchsorted(block[order[first]], np.arange(len(block_pairs) + 1)).astype(np.int32),
        start=np.append(first, len(order)).astype(np.int32),
        lame_ratio=np.ascontiguousarray(alike[first, 2]),
        shaped=np.ascontiguousarray(alike[first, 1]),
        row=row[order].astype(np.int32),
        column=column[order].astype(np.int32),
        node=node_of_block(block_pairs),
    )
