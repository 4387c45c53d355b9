"""The laws of elasticity of a body's elements, as the kernels read them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft.mechanics.kernels.domain_deformation import LAMBDA, LAW_NUMBERS, MODULI, MU, PURE_NUMBERS, term_columns
from taichisoft.mechanics.kernels.hooke_domains import BlockParts
from taichisoft.runtime.rubber_laws import RUBBER_LAWS
from taichisoft.scene.material import Law, initial_shear_modulus, lame_parameters

# The blocks of the system matrix under Hooke's law: which entries of which domains add to each.


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


def joined_arrays(parts: Sequence[Any]) -> dict[str, np.ndarray]:
    """The arrays by name of several data classes or bundles of one kind, one after the other.

    Those called `start`, which say where the entries of each thing begin, count on.
    """
    tables = [part._asdict() if hasattr(part, "_asdict") else vars(part) for part in parts]
    joined = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    if "start" in joined:
        sizes = np.concatenate([np.diff(table["start"]) for table in tables])
        joined["start"] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    return joined


@dataclass(frozen=True)
class ElasticLaws:
    """Laws of some elements or materials.

    Attributes:
        kind: number in LAW_NUMBERS, shape (count,).
        modulus: in the columns of `mechanics/kernels/domain_deformation.py` [kPa], shape (count, MODULI).
        pure_number: coefficients without unit, shape (count, PURE_NUMBERS).
        lame: Lame's lambda and mu at rest [kPa], shape (count, 2).
    """

    kind: np.ndarray
    modulus: np.ndarray
    pure_number: np.ndarray
    lame: np.ndarray

    @classmethod
    def joined(cls, parts: "list[ElasticLaws]") -> "ElasticLaws":
        """Several, one after the other."""
        return cls(**joined_arrays(parts))

    def select(self, indices: np.ndarray) -> "ElasticLaws":
        """Laws at these indices."""
        return ElasticLaws(self.kind[indices], self.modulus[indices], self.pure_number[indices], self.lame[indices])


def elastic_law(
    law: Law, young_modulus: float | None, coefficients: Mapping[str, float] | None, poisson_ratio: float
) -> ElasticLaws:
    """The law of one material, as arrays of length 1; lambda follows from Poisson's ratio as in Hooke's law."""
    if young_modulus is None:
        young_modulus = 2.0 * (1.0 + poisson_ratio) * initial_shear_modulus(law, coefficients or {})
    lame = lame_parameters(np.array([young_modulus]), np.array([poisson_ratio]))
    modulus, pure_number = np.zeros((1, MODULI)), np.zeros((1, PURE_NUMBERS))
    modulus[0, LAMBDA] = lame[0, 0]
    if law == "hooke":
        modulus[0, MU] = lame[0, 1]
    else:
        rubber = RUBBER_LAWS[law]
        for term, values in enumerate(rubber.given_terms(coefficients or rubber.of_shear_modulus(lame[0, 1]))):
            moduli, pure_numbers = term_columns(rubber, term)
            modulus[0, moduli] = values[: len(moduli)]
            pure_number[0, pure_numbers] = values[len(moduli) :]
    return ElasticLaws(np.array([LAW_NUMBERS[law]], dtype=np.int32), modulus, pure_number, lame)
