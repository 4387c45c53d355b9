"""The soft bodies of a model together: element arrays, forces and the system matrix of a step."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from taichisoft.base.rotations import edge_frames
from taichisoft.mechanics.cholesky import Cholesky, SymbolicFactor
from taichisoft.mechanics.domain_elasticity import DomainElasticity, DomainSystem, aligned, undamped_data
from taichisoft.mechanics.elastic_laws import find_blocks, find_parts, node_of_block
from taichisoft.mechanics.element_kinds import linear_tetrahedra
from taichisoft.mechanics.kernels import hooke_domains, reinforcement_forces
from taichisoft.mechanics.kernels.domain_deformation import HOOKE, DomainSums, Movement
from taichisoft.mechanics.kernels.hooke_domains import BlockParts, HookeEntries
from taichisoft.mechanics.reduced_system import ReducedElasticity, ReducedSystem, no_modes
from taichisoft.mechanics.reinforcements import Reinforcements
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.runtime.arithmetic import COUNTERS
from taichisoft.runtime.language import THREADS
from taichisoft.scene.scene import Time

# The membranes, fibres and springs of all soft bodies together, and what they add to the system of a step.


class ReinforcementElasticity:
    """All membranes, fibres and springs of a model.

    Attributes:
        parts: what the kernels read.
        undamped_parts: the same without damping.
        is_damped: whether springs have a drag.
        blocks: set by `find_blocks`.
    """

    blocks: reinforcement_forces.ReinforcedBlocks

    def __init__(self, bodies: Sequence[SoftBody], lag: np.ndarray, factor: np.ndarray, step: float, dragging: float):
        """Lay out the arrays; lag s + b [s] and factor of the stiffness in A of each body, s [s] of the step, and the
        factor of drags in A [s]."""
        own = [body.reinforcements for body in bodies]
        counts = [0 if one is None else len(one.measure) for one in own]
        found = [one.moved(body.nodes.start) for one, body in zip(own, bodies, strict=True) if one is not None]
        joined = Reinforcements.joined(found)
        lag, factor = np.repeat(lag, counts), np.repeat(factor, counts)
        rates = {"lag": lag, "factor": factor, "undamped": step / np.maximum(lag, step)}
        rates |= {"drag": joined.drag * (lag > 0.0), "dragged": dragging * joined.drag}
        self.parts = reinforcement_forces.ReinforcementParts(**{**vars(joined), **rates})
        without = np.zeros_like(joined.drag)
        self.undamped_parts = undamped_data(self.parts)._replace(drag=without, dragged=without)
        self.is_damped = bool(rates["dragged"].any())

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
        self.blocks = reinforcement_forces.ReinforcedBlocks(
            block=some.astype(np.int32),
            node=node_of_block(block_pairs[some]),
            start=np.append(start, len(order)).astype(np.int32),
            part=part[order].astype(np.int32),
            row=row[order].astype(np.int32),
            column=column[order].astype(np.int32),
        )


class ReinforcementSystem:
    """The membranes, fibres and springs at present positions."""

    def __init__(self, elasticity: ReinforcementElasticity, movement: Movement, force: np.ndarray, blocks: np.ndarray):
        """Allocate the work space; `add` adds to force [mN], shape (node_count, 3), and to the blocks of A."""
        self._elasticity, self._movement = elasticity, movement
        self._total = DomainSums(force, blocks, np.zeros(COUNTERS, dtype=np.int32))
        first, second, tension = (np.zeros((len(elasticity.parts.lag), 3)) for _ in range(3))
        of_entries, slope = np.zeros((len(elasticity.parts.node), 3)), np.zeros((len(elasticity.parts.lag), 6))
        self._states = reinforcement_forces.PartStates(first, second, tension, slope, of_entries)

    def add(self, damped: bool) -> None:
        """Add forces and stiffness as `ElasticSystem.assemble` does."""
        parts = self._elasticity.parts if damped else self._elasticity.undamped_parts
        reinforcement_forces.add_reinforcements(
            parts, self._movement, self._elasticity.blocks, self._states, self._total
        )


class Elasticity:
    """All soft bodies, whose matrix A = (1 + s a) M + s (s + b) K has one block of trees per body; it never changes.

    s = theta h, `Time.stage`, is where in the step forces are taken; h in implicit Euler.
    In overdamped dynamics A = h M + h^2 K: mass is a drag, so M v = f - h K v, here times h; in statics A = h^2 K. A
    times a velocity is an impulse as before, so that contacts and actuators need not know the difference.

    Linear tetrahedra under Hooke's law have a kernel of their own; all other elements are integration domains.

    Attributes:
        elements: corners of all elements, shape (element_count, 4).
        rest_position: of the nodes [mm], shape (node_count, 3).
        linear: numbers of the elements that are linear tetrahedra under Hooke's law, shape (linear_count,).
        linear_elements: their node indices, shape (linear_count, 4).
        lame: Lame's lambda and mu of each of them [kPa], shape (linear_count, 2).
        gradient: of their shape functions [1/mm], shape (linear_count, point_count, nodes_per_element, 3).
        volume: of their quadrature points [mm^3], shape (linear_count, point_count).
        node_mass: [kg], shape (node_count,).
        node_rayleigh_mass: Rayleigh's factor a [1/s], shape (node_count,).
        node_lag: s + b [s]: forces are taken at positions so far ahead along the velocities; 0 in overdamped dynamics,
            where there are no velocities before the step; shape (node_count,).
        node_lead: how far ahead along the velocities a node's body is turned before it is linearised [s]: s under laws
            of rubber, else 0; shape (node_count,).
        turns_ahead: whether that is so of any node.
        undamped: s / (s + b) of each linear element, 1 in overdamped dynamics, shape (linear_count,).
        inertia: masses with their drag on the diagonal of the system's matrix [kg], in overdamped dynamics drag times
            time step, shape (node_count,).
        anchor_stiffness: along x, y and z [mN/mm], shape (node_count, 3).
        anchor_lag: as node_lag, of the anchors' springs [s]: s + r (h - s), or that and b where a body's anchors are
            damped; shape (node_count,).
        rigidity: r = h^2 k / (m + h^2 k) of the anchors' springs along x, y and z [-]: 1 of rigid ones, which are where
            they are put at the end of the step, 0 of soft ones; shape (node_count, 3).
        diagonal: the rest of A beside the stiffness of the elements: masses with their damping, and anchors [kg], shape
            (node_count, 3).
        symbolic: the pattern of A and of its factor.
        element_data, block_parts: the arrays that the kernels read of the linear elements.
        domains: integration domains of all others; None without any.
        reduced: bodies that move by modes, whose elements are in none of the above; None without any.
        reinforcements: membranes, fibres and springs; None without any.
    """

    def __init__(self, bodies: Sequence[SoftBody], time: Time):
        """Lay out the arrays for steps of `time`."""
        counts = [len(body.elements) for body in bodies]
        self.elements = np.vstack([body.elements[:, :4] + body.nodes.start for body in bodies]).astype(np.int32)
        self.rest_position = np.vstack([body.rest_position for body in bodies])
        self.linear = np.flatnonzero(
            np.repeat([body.domains is None and body.modes is None for body in bodies], counts)
        )
        self.linear_elements = np.ascontiguousarray(self.elements[self.linear])
        self.gradient, self.volume = linear_tetrahedra(self.rest_position, self.linear_elements)
        self.lame = np.vstack([body.lame for body in bodies])[self.linear]
        self.node_mass = np.concatenate([body.node_mass for body in bodies])
        self.anchor_stiffness = np.vstack([body.anchor_stiffness for body in bodies])
        node_counts = [len(body.rest_position) for body in bodies]
        rayleigh_mass = np.array([body.settings.rayleigh_mass for body in bodies])
        stage = time.stage
        lag = np.array([stage + body.settings.rayleigh_stiffness for body in bodies])
        # A spring taken at the end of the step pulls its node to where the base is then, however fast that moves.
        is_damped = np.array([body.settings.damped_anchors for body in bodies])
        anchor_lag = np.where(is_damped, lag, stage)
        mass_factor, stiffness_factor = 1.0 + stage * rayleigh_mass, stage * lag
        anchor_factor, dragging = stage * anchor_lag, stage
        if time.dynamics != "inertial":
            drag = dragging = time.step if time.dynamics == "overdamped" else 0.0
            rayleigh_mass, lag, anchor_lag = (np.zeros(len(bodies)) for _ in range(3))
            mass_factor, stiffness_factor = np.full(len(bodies), drag), np.full(len(bodies), time.step**2)
            anchor_factor = stiffness_factor
        self.node_rayleigh_mass = np.repeat(rayleigh_mass, node_counts)
        self.node_lag = np.repeat(lag, node_counts)
        stiffness = time.step**2 * self.anchor_stiffness
        self.rigidity = stiffness / (self.node_mass[:, None] + stiffness)
        beyond = (time.step - stage) * self.rigidity.max(axis=1)
        self.anchor_lag = np.repeat(anchor_lag, node_counts) + beyond
        kinds = {"edges": hooke_domains.EDGES, "polar": hooke_domains.POLAR, "none": hooke_domains.NONE}
        corotation = np.repeat([kinds[body.settings.corotation] for body in bodies], counts).astype(np.int32)
        element_lag, element_factor = np.repeat(lag, counts), np.repeat(stiffness_factor, counts)
        some = self.linear
        self.undamped = stage / np.maximum(element_lag[some], stage)
        turns_ahead = np.array([body.domains is not None and (body.laws.kind != HOOKE).any() for body in bodies])
        self.node_lead = np.repeat(np.where(turns_ahead & (lag > 0.0), stage, 0.0), node_counts)
        self.turns_ahead = bool(self.node_lead.any())
        self.element_data = self._element_data(corotation[some], element_lag[some], element_factor[some])
        held = (np.repeat(anchor_factor, node_counts) + stage * beyond)[:, None] * self.anchor_stiffness
        self.inertia = np.repeat(mass_factor, node_counts) * self.node_mass
        self.diagonal = self.inertia[:, None] + held
        own_domains = any(body.domains is not None and body.modes is None for body in bodies)
        self.domains = DomainElasticity(bodies, element_lag, element_factor, stage) if own_domains else None
        self.reduced: ReducedElasticity | None = None
        if any(body.modes is not None for body in bodies):
            factors = (mass_factor, anchor_factor, rayleigh_mass)
            # The velocities that lead back to the modes count as well where there are no others.
            reduced_lag = np.maximum(element_lag, time.step)
            self.reduced = ReducedElasticity(bodies, reduced_lag, element_factor, *factors, time.step)
            is_reduced = np.repeat([body.modes is not None for body in bodies], node_counts)
            self.anchor_lag = np.where(is_reduced, np.maximum(self.anchor_lag, time.step), self.anchor_lag)
            self.diagonal[is_reduced] = 0.0  # they have theirs
        self.reinforcements: ReinforcementElasticity | None = None
        if any(body.reinforcements is not None for body in bodies):
            self.reinforcements = ReinforcementElasticity(bodies, lag, stiffness_factor, stage, dragging)
        self.symbolic = SymbolicFactor(self._pattern())
        self.block_parts = self._block_parts()
        if self.domains is not None:
            self.domains.find_blocks(self.symbolic.block_pairs, self.rest_position)
        if self.reduced is not None:
            self.reduced.find_blocks(self.symbolic.block_pairs)
        if self.reinforcements is not None:
            self.reinforcements.find_blocks(self.symbolic.block_pairs)

    def _pattern(self) -> sparse.csr_matrix:
        """The pattern of A: nodes that share an element or a domain."""
        elements, node_count = self.linear_elements, len(self.rest_position)
        nodes_per_element = elements.shape[1]
        row, column = (
            np.repeat(elements, nodes_per_element, axis=1).ravel(),
            np.tile(elements, nodes_per_element).ravel(),
        )
        for others in (self.domains, self.reduced, self.reinforcements):
            if others is not None:
                pairs = others.node_pairs()
                row, column = np.concatenate([row, pairs[0]]), np.concatenate([column, pairs[1]])
        return sparse.csr_matrix((np.ones(row.size), (row, column)), (node_count, node_count))

    def _element_data(
        self, corotation: np.ndarray, lag: np.ndarray, stiffness_factor: np.ndarray
    ) -> hooke_domains.Elements:
        corners = self.rest_position[self.linear_elements[:, :3]]
        force_modulus = self.volume * self.lame
        return hooke_domains.Elements(
            nodes=self.linear_elements,
            corotation=corotation,
            rest_frame=edge_frames(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
            gradient=np.ascontiguousarray(self.gradient[:, 0, 1:]),
            force_modulus=force_modulus,
            root=np.sqrt(stiffness_factor * force_modulus[:, 1]),
            lag=lag,
        )

    def _block_parts(self) -> BlockParts:
        corners, pairs = (
            np.arange(self.linear_elements.size).reshape(self.linear_elements.shape),
            self.symbolic.block_pairs,
        )
        row, column = (part.ravel() for part in (np.repeat(corners, 4, axis=1), np.tile(corners, 4)))
        nodes = self.linear_elements.reshape(-1)
        block = find_blocks(pairs, nodes[row], nodes[column])
        row, column, block = row[block >= 0], column[block >= 0], block[block >= 0]
        lame_ratio = (self.lame[:, 0] / self.lame[:, 1])[row // 4]
        return find_parts(pairs, block, row, column, lame_ratio, np.ones(len(row)))


class ElasticSystem:
    """The elastic forces and the matrix A at present positions, and with present stiffnesses.

    Attributes:
        position, velocity: of the nodes [mm] and [mm/s], which the caller fills, shape (node_count, 3).
        force: elastic force less the lagged stiffness term, f - (s + b) K v [mN], shape (node_count, 3).
        solver: the direct solver, whose blocks are A.
        reduced: the bodies that move by modes; None without any.
        modes: what kernels read of them; without entries where there are none.
    """

    def __init__(self, elasticity: Elasticity):
        self._elasticity = elasticity
        data, node_count = elasticity.element_data, len(elasticity.rest_position)
        self._elements = data._replace(force_modulus=data.force_modulus.copy(), root=data.root.copy())
        self._undamped_elements = self._elements._replace(lag=elasticity.undamped * data.lag, root=data.root.copy())
        self.solver = Cholesky(elasticity.symbolic)
        self.position, self.velocity, self.force = (np.zeros((node_count, 3)) for _ in range(3))
        self._rotation = np.empty((len(elasticity.linear), 3, 3))  # unread, but the compiler's last bits depend on it
        entry_count = elasticity.linear_elements.size
        self._entries = HookeEntries(np.zeros((entry_count, 3)), aligned(entry_count, 4))
        self._sums = DomainSums(self.force, self.solver.blocks, np.zeros(COUNTERS, dtype=np.int32))
        self._domains: DomainSystem | None = None
        if elasticity.domains is not None:
            moving = (self.position, self.velocity, self.force)
            self._domains = DomainSystem(elasticity.domains, *moving, self.solver.blocks)
        self._movement = movement = Movement(self.position, self.velocity)
        self._reinforcements: ReinforcementSystem | None = None
        if elasticity.reinforcements is not None:
            sums = (self.force, self.solver.blocks)
            self._reinforcements = ReinforcementSystem(elasticity.reinforcements, movement, *sums)
        self._has_full_bodies = elasticity.domains is not None or len(elasticity.linear) > 0
        self.reduced: ReducedSystem | None = None
        if elasticity.reduced is not None:
            self.reduced = ReducedSystem(elasticity.reduced, movement, self.solver.blocks)
        self.modes = no_modes(node_count) if self.reduced is None else self.reduced.modes

    def scale_stiffness(self, factor: np.ndarray) -> None:
        """Multiply the stiffness of each element in the model by a factor, shape (element_count,), with Poisson's
        ratios kept.

        Ones restore the model bit for bit.
        """
        if self._domains is not None:
            self._domains.scale_stiffness(factor)
        if self.reduced is not None:
            self.reduced.scale_stiffness(factor)
        model, factor = self._elasticity.element_data, factor[self._elasticity.linear]
        np.multiply(model.force_modulus, factor[:, None], out=self._elements.force_modulus)
        np.multiply(model.root, np.sqrt(factor), out=self._elements.root)

    def leave_out_damping(self) -> None:
        """Prepare `assemble(damped=False)` with the present stiffnesses."""
        np.multiply(self._elements.root, np.sqrt(self._elasticity.undamped), out=self._undamped_elements.root)

    def assemble(self, damped: bool = True) -> None:
        """Fill `force`, and the solver's blocks with A, its rotations frozen at `position`, under laws of rubber turned
        on with `velocity`; without damping by stiffness, f - h K v and b = 0 in A."""
        self._sums.progress[:] = 0
        elements, parts = self._elements if damped else self._undamped_elements, self._elasticity.block_parts
        if self._has_full_bodies:
            hooke_domains.assemble(
                elements,
                self._movement,
                self._rotation,
                self._entries,
                parts,
                self._elasticity.diagonal,
                self._sums,
                THREADS,
            )
        if self._domains is not None:
            self._domains.add(damped)
        if self._reinforcements is not None:
            self._reinforcements.add(damped)
        if self.reduced is not None:
            self.reduced.assemble(damped)


def internal_force(elasticity: Elasticity, position: np.ndarray) -> np.ndarray:
    """Elastic force on each node at rest in these positions [mN], position [mm] and result of shape (node_count, 3)."""
    system = ElasticSystem(elasticity)
    system.position[:] = position
    system.assemble()
    return system.force
