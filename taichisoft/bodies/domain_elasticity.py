"""The integration domains of all soft bodies together, and what they add to the system of a step."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.bodies.domains import IntegrationDomains
from taichisoft.bodies.laws import ElasticLaws
from taichisoft.kernels import domains as kernels
from taichisoft.kernels.laws import HOOKE, LAMBDA, MU

if TYPE_CHECKING:
    from taichisoft.bodies.soft_body import SoftBody


class DomainElasticity:
    """Integration domains with their materials; they never change.

    Attributes:
        domains: nodes and elements numbered as in the whole model.
        data: what the kernels read of them.
        parts: which of their entries make up which blocks of the system matrix, once `find_parts` was called.
    """

    parts: kernels.DomainParts

    def __init__(self, bodies: "Sequence[SoftBody]", lag: np.ndarray, factor: np.ndarray, step: float):
        """Lay out the arrays.

        Args:
            bodies: all bodies; those without domains are passed over.
            lag: h + b [s] of each element of all bodies, shape (element_count,).
            factor: of the stiffness in A, likewise.
            step: time step h [s].
        """
        first_element = np.cumsum([0, *(len(body.elements) for body in bodies)])
        found = [
            replace(body.domains, node=body.domains.node + body.nodes.start, element=body.domains.element + first)
            for body, first in zip(bodies, first_element[:-1], strict=True)
            if body.domains is not None
        ]
        self.domains = IntegrationDomains.joined(found)
        element = self.domains.element
        laws = ElasticLaws.joined([body.laws for body in bodies]).of(element)
        self.data = kernels.Domains(
            start=self.domains.start,
            node=self.domains.node.astype(np.int32),
            gradient=self.domains.gradient,
            volume=self.domains.volume,
            law=laws.kind,
            modulus=laws.modulus,
            exponent=laws.exponent,
            lag=lag[element],
            factor=factor[element],
            undamped=step / np.maximum(lag[element], step),
        )

    def node_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes that share a domain, as two arrays; pairs of several domains occur as often."""
        row, column = self.domains.node_pairs()
        return self.domains.node[row], self.domains.node[column]

    def find_parts(self, block_pairs: np.ndarray) -> None:
        """Find `parts` for blocks of these two nodes (row, column), shape (block_count, 2)."""
        row, column = self.domains.node_pairs()
        node_count = int(block_pairs.max()) + 1
        key = self.domains.node[row].astype(np.int64) * node_count + self.domains.node[column]
        stored = block_pairs.astype(np.int64) @ [node_count, 1]
        by_key = np.argsort(stored)
        place = np.minimum(np.searchsorted(stored[by_key], key), len(stored) - 1)
        found = stored[by_key[place]] == key  # the other half is the transpose of a stored block
        block, row, column = by_key[place[found]], row[found], column[found]
        blocks, own_block = np.unique(block, return_inverse=True)
        domain = np.repeat(np.arange(len(self.data.law)), np.diff(self.data.start))[row]
        kind_and_block = 3 * own_block.reshape(-1) + self._kind()[domain]
        order = np.argsort(kind_and_block, kind="stable")
        pairs = block_pairs[blocks]
        self.parts = kernels.DomainParts(
            block=blocks.astype(np.int32),
            start=np.searchsorted(kind_and_block[order], np.arange(3 * len(blocks) + 1)).astype(np.int32),
            row_entry=row[order].astype(np.int32),
            column_entry=column[order].astype(np.int32),
            lame_ratio=self._lame_ratio()[domain[order]],
            node=np.where(pairs[:, 0] == pairs[:, 1], pairs[:, 0], -1).astype(np.int32),
        )

    def _kind(self) -> np.ndarray:
        """What the parts of each domain are, shape (domain_count,)."""
        shaped = np.where(self.data.volume[:, kernels.SHAPE] > 0.0, kernels.SHAPED, kernels.DILATED)
        return np.where(self.data.law == HOOKE, shaped, kernels.RESPONDING)

    def _lame_ratio(self) -> np.ndarray:
        """Lambda over mu of each domain in which both energies of Hooke's law count, shape (domain_count,)."""
        both = (self.data.law == HOOKE) & (self.data.volume > 0.0).all(axis=1)
        ratio = np.zeros(len(both))
        np.divide(self.data.modulus[:, LAMBDA], self.data.modulus[:, MU], out=ratio, where=both)
        return ratio


class DomainSystem:
    """The domains at present positions, with present stiffnesses."""

    def __init__(
        self,
        elasticity: DomainElasticity,
        position: np.ndarray,
        velocity: np.ndarray,
        force: np.ndarray,
        blocks: np.ndarray,
    ):
        """Make room.

        Args:
            elasticity: the model's domains.
            position, velocity: of the nodes [mm] and [mm/s], which the caller fills, shape (node_count, 3).
            force: to which `add` adds the nodal forces [mN], shape (node_count, 3).
            blocks: to which it adds the stiffness, shape (block_count, 3, 3).
        """
        self._elasticity = elasticity
        self._data = elasticity.data
        self._own_data: kernels.Domains | None = None  # with room for other stiffnesses than the model's
        self._undamped_data: kernels.Domains | None = None
        entry_count = len(elasticity.data.node)
        responding = entry_count if (elasticity.data.law != HOOKE).any() else 0
        self._strained = kernels.Strained(
            position=position,
            velocity=velocity,
            force=np.zeros((entry_count, 3)),
            gradient=_aligned(entry_count, 4),
            response=_aligned(3 * responding, 8),
            last_response=_aligned(responding, 4),
        )
        self._sums = kernels.DomainSums(force, blocks, np.zeros(2, dtype=np.int32))

    def leave_out_damping(self) -> None:
        """Get ready for `add` without damping, with the stiffnesses of now."""
        model = self._elasticity.data
        if self._undamped_data is None:
            lag, factor = model.undamped * model.lag, model.undamped * model.factor
            self._undamped_data = model._replace(lag=lag, factor=factor, undamped=np.ones_like(lag))
        self._undamped_data = self._undamped_data._replace(modulus=self._data.modulus)

    def scale_stiffness(self, factor: np.ndarray) -> None:
        """Make each element so many times as stiff as in the model, shape (element_count,)."""
        model, factor = self._elasticity.data, factor[self._elasticity.domains.element]
        if (factor == 1.0).all():
            self._data = model
            return
        if self._own_data is None:
            self._own_data = model._replace(modulus=np.empty_like(model.modulus))
        self._data = self._own_data
        np.multiply(model.modulus, factor[:, None], out=self._data.modulus)

    def add(self, damped: bool) -> None:
        """Add forces and stiffness as `ElasticSystem.assemble` does."""
        self._sums.progress[:] = 0
        data = self._data if damped or self._undamped_data is None else self._undamped_data
        kernels.add_domains(data, self._strained, self._elasticity.parts, self._sums)


def _aligned(count: int, width: int) -> np.ndarray:
    """Rows of zeros that do not straddle lines of the cache, shape (count, width)."""
    entries = np.zeros(count * width + 8)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + count * width].reshape(count, width)
