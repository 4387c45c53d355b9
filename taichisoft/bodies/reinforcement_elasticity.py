"""The membranes and fibres of all soft bodies together, and what they add to the system of a step."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.hooke_parts import find_blocks, node_of_block
from taichisoft.bodies.kernels import reinforcement_forces as kernels
from taichisoft.bodies.kernels.domain_deformation import DomainSums, Movement
from taichisoft.bodies.reinforcements import Reinforcements
from taichisoft.bodies.soft_body_arrays import SoftBody
from taichisoft.runtime.waiting import COUNTERS


class ReinforcementElasticity:
    """All membranes and fibres of a model.

    Attributes:
        parts: what the kernels read.
        undamped_parts: the same without damping.
        blocks: set by `find_blocks`.
    """

    blocks: kernels.ReinforcedBlocks

    def __init__(self, bodies: Sequence[SoftBody], lag: np.ndarray, factor: np.ndarray, step: float):
        """Lay out the arrays; lag s + b [s] and factor of the stiffness in A of each body, and s [s] of the step."""
        own = [body.reinforcements for body in bodies]
        counts = [0 if one is None else len(one.measure) for one in own]
        found = [one.moved(body.nodes.start) for one, body in zip(own, bodies, strict=True) if one is not None]
        joined = Reinforcements.joined(found)
        lag, factor = np.repeat(lag, counts), np.repeat(factor, counts)
        undamped = step / np.maximum(lag, step)
        arrays = (joined.start, joined.node, joined.gradient, joined.measure, joined.stiffness, joined.slackening)
        self.parts = kernels.ReinforcementParts(*arrays, lag, factor, undamped)
        self.undamped_parts = kernels.ReinforcementParts(*arrays, undamped * lag, undamped * factor, np.ones(len(lag)))

    def _pairs(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Part, and entries of every ordered pair of its nodes."""
        size = np.diff(self.parts.start)
        part = np.repeat(np.arange(len(size)), size**2)
        within = np.arange(len(part)) - np.repeat(np.cumsum(size**2) - size**2, size**2)
        row, column = np.divmod(within, size[part])
        first = self.parts.start[part]
        return part, first + row, first + column

    def node_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes that share a part, as two arrays."""
        _, row, column = self._pairs()
        return self.parts.node[row], self.parts.node[column]

    def find_blocks(self, block_pairs: np.ndarray) -> None:
        """Find which parts add to which blocks, whose nodes (row, column) are `block_pairs`, shape (block_count, 2)."""
        part, row, column = self._pairs()
        block = find_blocks(block_pairs, self.parts.node[row], self.parts.node[column])
        order = np.argsort(block, kind="stable")[np.count_nonzero(block < 0) :]
        some, start = np.unique(block[order], return_index=True)
        self.blocks = kernels.ReinforcedBlocks(
            block=some.astype(np.int32),
            node=node_of_block(block_pairs[some]),
            start=np.append(start, len(order)).astype(np.int32),
            part=part[order].astype(np.int32),
            row=row[order].astype(np.int32),
            column=column[order].astype(np.int32),
        )


class ReinforcementSystem:
    """The membranes and fibres at present positions."""

    def __init__(self, elasticity: ReinforcementElasticity, movement: Movement, force: np.ndarray, blocks: np.ndarray):
        """Allocate the work space; `add` adds to force [mN], shape (node_count, 3), and to the blocks of A."""
        self._elasticity, self._movement = elasticity, movement
        self._total = DomainSums(force, blocks, np.zeros(COUNTERS, dtype=np.int32))
        first, second, tension = (np.zeros((len(elasticity.parts.lag), 3)) for _ in range(3))
        of_entries, slope = np.zeros((len(elasticity.parts.node), 3)), np.zeros((len(elasticity.parts.lag), 6))
        self._states = kernels.PartStates(first, second, tension, slope, of_entries)

    def add(self, damped: bool) -> None:
        """Add forces and stiffness as `ElasticSystem.assemble` does."""
        parts = self._elasticity.parts if damped else self._elasticity.undamped_parts
        kernels.add_reinforcements(parts, self._movement, self._elasticity.blocks, self._states, self._total)
