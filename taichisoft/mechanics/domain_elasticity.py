"""The integration domains of all soft bodies together, and what they add to the system of a step."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from taichisoft.mechanics.domains import IntegrationDomains, along_curve, group_domains
from taichisoft.mechanics.elastic_laws import ElasticLaws, find_blocks, find_parts
from taichisoft.mechanics.kernels import domain_deformation as kernels
from taichisoft.mechanics.kernels import hooke_domains, rubber_domains
from taichisoft.mechanics.kernels.domain_deformation import HOOKE, LAMBDA, MU
from taichisoft.mechanics.kernels.hooke_domains import BlockParts, HookeEntries
from taichisoft.mechanics.kernels.reinforcement_forces import ReinforcementParts
from taichisoft.runtime.arithmetic import COUNTERS
from taichisoft.runtime.language import THREADS

if TYPE_CHECKING:
    from taichisoft.mechanics.soft_body_arrays import SoftBody


Bundle = TypeVar("Bundle", kernels.Domains, ReinforcementParts)


class DomainElasticity:
    """Integration domains with their materials, which never change.

    Attributes:
        domains: nodes and elements numbered as in the whole model.
        data: the arrays that the kernels read.
        hooke, rubber: domains under Hooke's law and under other laws, set by `find_blocks`; None without any.
    """

    hooke: "HookeDomains | None" = None
    rubber: "RubberDomains | None" = None

    def __init__(self, bodies: "Sequence[SoftBody]", lag: np.ndarray, factor: np.ndarray, stage: float):
        """Lay out the arrays.

        Args:
            bodies: all bodies; bodies without domains are skipped.
            lag: s + b [s] of each element of all bodies, shape (element_count,).
            factor: of the stiffness in A, likewise.
            stage: s, from the start of a step to where forces are taken [s].
        """
        first_element = np.cumsum([0, *(len(body.elements) for body in bodies)])
        parts = [
            replace(body.domains, node=body.domains.node + body.nodes.start, element=body.domains.element + first)
            for body, first in zip(bodies, first_element[:-1], strict=True)
            if body.domains is not None and body.modes is None
        ]
        self.domains = IntegrationDomains.joined(parts)
        laws = ElasticLaws.joined([body.laws for body in bodies])
        self._arrays = (laws, lag, factor, stage)
        self.data = domain_data(self.domains, *self._arrays)

    def node_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes that share a domain, as two arrays; pairs of several domains occur as often."""
        row, column = self.domains.node_pairs()
        return self.domains.node[row], self.domains.node[column]

    def find_blocks(self, block_pairs: np.ndarray, rest_position: np.ndarray) -> None:
        """Find which domains add to which block; nodes at rest are at positions [mm], shape (node_count, 3)."""
        hooke = self.data.law == HOOKE
        if hooke.any():
            domains = self.domains.select(np.flatnonzero(hooke))
            self.hooke = HookeDomains(domains, domain_data(domains, *self._arrays), block_pairs)
        if not hooke.all():
            domains = self.domains.select(np.flatnonzero(~hooke))
            domains = domains.select(along_curve(domains.centres(rest_position)))
            self.rubber = RubberDomains(domains, domain_data(domains, *self._arrays), block_pairs)


class HookeDomains:
    """Domains under Hooke's law.

    Attributes:
        data: the arrays that the kernels read.
        element: one element of each domain, shape (domain_count,).
        block: numbers of the blocks that the domains add to, shape (count,).
        parts: entries of domains that add to each of these blocks.
    """

    def __init__(self, domains: IntegrationDomains, data: kernels.Domains, block_pairs: np.ndarray):
        """Find the parts of the blocks, whose two nodes (row, column) are `block_pairs`, shape (block_count, 2)."""
        self.data, self.element = data, domains.element
        row, column = domains.node_pairs()
        block = find_blocks(block_pairs, domains.node[row], domains.node[column])
        row, column, block = row[block >= 0], column[block >= 0], block[block >= 0]
        self.block, own_block = np.unique(block.astype(np.int32), return_inverse=True)
        domain = np.repeat(np.arange(len(data.law)), np.diff(data.start))[row]
        shaped, dilated = (data.volume > 0.0).T
        ratio = np.where(shaped, dilated * data.modulus[:, LAMBDA] / data.modulus[:, MU], 1.0)
        self.parts: BlockParts = find_parts(
            block_pairs[self.block], own_block.reshape(-1), row, column, ratio[domain], shaped[domain]
        )


class RubberDomains:
    """Domains under other laws.

    Attributes:
        data: the arrays that the kernels read.
        element: one element of each domain, shape (domain_count,).
        groups, copies: the layout of their sums.
    """

    def __init__(self, domains: IntegrationDomains, data: kernels.Domains, block_pairs: np.ndarray):
        """Lay out the sums; arguments as of `group_domains`."""
        self.data, self.element = data, domains.element
        self.groups, self.copies = group_domains(domains, block_pairs)


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
        """Allocate the work space for nodes that the caller moves; `add` adds to their forces and to the blocks."""
        self._hooke, self._rubber = elasticity.hooke, elasticity.rubber
        self._movement = kernels.Movement(position, velocity)
        self._total = kernels.DomainSums(force, blocks, np.zeros(COUNTERS, dtype=np.int32))
        # Of Hooke's and other laws: the arrays with present moduli, and the same without damping.
        self._data = {
            model: model.data._replace(modulus=model.data.modulus.copy())
            for model in (self._hooke, self._rubber)
            if model is not None
        }
        self._undamped = {model: undamped_data(data) for model, data in self._data.items()}
        if self._hooke is not None:
            entry_count = len(self._hooke.data.node)
            self._entries = HookeEntries(np.zeros((entry_count, 3)), aligned(entry_count, 4))
        if self._rubber is not None:
            slot_count, most_entries = (
                int(self._rubber.groups.first_slot[-1]),
                int(np.diff(self._rubber.data.start).max()),
            )
            self._sums = rubber_domains.GroupSums(
                block=aligned(slot_count, 8),
                rest=aligned(slot_count, 4),
                tangent=aligned(rubber_domains.ROWS * THREADS, 8),
                last_tangent=aligned(3 * THREADS, 4),
                gradient=aligned(most_entries * THREADS, 4),
            )

    def scale_stiffness(self, factor: np.ndarray) -> None:
        """Multiply the stiffness of each element in the model by `factor`, shape (element_count,)."""
        for model, data in self._data.items():
            np.multiply(model.data.modulus, factor[model.element, None], out=data.modulus)

    def add(self, damped: bool) -> None:
        """Add forces and stiffness as `ElasticSystem.assemble` does."""
        data = self._data if damped else self._undamped
        if self._hooke is not None:
            self._total.progress[:] = 0
            own, parts = data[self._hooke], self._hooke.parts
            block, workers = self._hooke.block, THREADS
            hooke_domains.add_hooke_domains(own, self._movement, block, self._entries, parts, self._total, workers)
        if self._rubber is not None:
            self._total.progress[:] = 0
            own, groups, copies = data[self._rubber], self._rubber.groups, self._rubber.copies
            rubber_domains.add_rubber_domains(own, self._movement, groups, self._sums, copies, self._total)


def aligned(count: int, width: int) -> np.ndarray:
    """Rows of zeros that do not straddle cache lines, shape (count, width)."""
    entries = np.zeros(count * width + 8)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + count * width].reshape(count, width)


def domain_data(
    domains: IntegrationDomains, laws: ElasticLaws, lag: np.ndarray, factor: np.ndarray, stage: float
) -> kernels.Domains:
    """The arrays that kernels read, from laws, lag and factor of all elements, and the time s to where forces are."""
    element = domains.element
    own_laws = laws.select(element)
    return kernels.Domains(
        start=domains.start,
        node=domains.node.astype(np.int32),
        gradient=domains.gradient,
        volume=domains.volume,
        law=own_laws.kind,
        modulus=own_laws.modulus,
        pure_number=own_laws.pure_number,
        lag=lag[element],
        factor=factor[element],
        undamped=stage / np.maximum(lag[element], stage),
    )


def undamped_data(data: Bundle) -> Bundle:
    """The same domains or membranes without damping; they share all other arrays."""
    lag, factor = data.undamped * data.lag, data.undamped * data.factor
    return data._replace(lag=lag, factor=factor, undamped=np.ones_like(lag))
