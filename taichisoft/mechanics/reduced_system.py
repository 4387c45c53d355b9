"""The reduced soft bodies at present positions: their amplitudes, forces and blocks of the system matrix."""

from collections.abc import Sequence

import numpy as np

from taichisoft.base.rotations import rotation_from_degrees
from taichisoft.mechanics.domain_elasticity import aligned, domain_data, undamped_data
from taichisoft.mechanics.domains import IntegrationDomains
from taichisoft.mechanics.elastic_laws import joined_arrays
from taichisoft.mechanics.kernels import mode_motion, reduced_domains
from taichisoft.mechanics.kernels.domain_deformation import HOOKE, MU, SHAPE, Domains, Movement
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.runtime.arithmetic import TILE

# The reduced soft bodies of a model: their modes and chosen domains, and what they add to the system of a step.


class ReducedElasticity:
    """Reduced bodies, which never change.

    Attributes:
        bodies: the reduced ones among the soft bodies.
        modes: what kernels read of the modes, with each body's frame at the start.
        blocks: the modes of eight nodes at a time, with their rest positions and masses.
        data: the chosen domains, whose volumes have their weights.
        domains: where they lie.
        element: an element of each domain, among those of all soft bodies, shape (domain_count,).
        mass_factor, anchor_factor: of mass and of the anchors' springs in A, shape (body_count,).
        drag: Rayleigh's factor a [1/s], shape (body_count,).
        anchors: for each body stiffness [mN/mm] and modes of its anchored nodes, shapes (count, 3), (count, 3, width).
        block: numbers of their blocks in the system matrix, set by `find_blocks`; with body and first amplitudes.
    """

    def __init__(
        self,
        bodies: "Sequence[SoftBody]",
        lag: np.ndarray,
        factor: np.ndarray,
        mass_factor: np.ndarray,
        anchor_factor: np.ndarray,
        rayleigh_mass: np.ndarray,
        step: float,
    ):
        """Lay out the arrays.

        Args:
            bodies: all soft bodies, of which some are reduced.
            lag: h + b [s] of each element of all bodies, shape (element_count,).
            factor: of the stiffness in A, likewise.
            mass_factor, anchor_factor: of each body, shape (body_count,).
            rayleigh_mass: Rayleigh's factor a of each body, 0 in overdamped dynamics [1/s], shape (body_count,).
            step: time step h [s].
        """
        numbers = [number for number, body in enumerate(bodies) if body.modes is not None]
        self.bodies = tuple(bodies[number] for number in numbers)
        self.mass_factor, self.anchor_factor = mass_factor[numbers], anchor_factor[numbers]
        self.drag = rayleigh_mass[numbers]
        self.node_count = bodies[-1].nodes.stop
        first_element = np.cumsum([0, *(len(body.elements) for body in bodies)])[numbers]
        self._lay_out_modes()
        self._lay_out_domains(first_element, lag, factor, step)
        self.anchors = [self._anchors_of(body, number) for number, body in enumerate(self.bodies)]

    @property
    def widths(self) -> np.ndarray:
        """Amplitudes of each body with the padding, shape (body_count,)."""
        return TILE * self.modes.tiles

    def _lay_out_modes(self) -> None:
        start, body_of_node = (np.full(self.node_count, -1, dtype=np.int32) for _ in range(2))
        tables: dict[tuple[str | None, str], int] = {}
        shapes: list[np.ndarray] = []
        blocks: list[np.ndarray] = []
        tiles, threes, size = [], [], 0
        block_starts: dict[tuple[str | None, str], int] = {}
        block_start = []
        for number, body in enumerate(self.bodies):
            assert body.modes is not None
            mode_count = body.modes.mode_count
            threes.append(-(-mode_count // 3))
            tiles.append(-(-3 * threes[-1] // TILE))
            key = (body.settings.reduced, body.mesh.source)
            if key not in tables:
                tables[key] = size
                shapes.append(padded(body.modes.modes, TILE * tiles[-1]).reshape(-1, TILE))
                size += len(shapes[-1])
                blocks.append(in_blocks(padded(body.modes.modes, 3 * threes[-1]).transpose(0, 2, 1)))
                block_starts[key] = sum(map(len, blocks[:-1]))
            start[body.nodes] = tables[key] + 3 * tiles[-1] * np.arange(len(body.mesh.nodes))
            block_start.append(block_starts[key])
            body_of_node[body.nodes] = number
        turns = [rotation_from_degrees(body.settings.rotation) for body in self.bodies]
        self.modes = mode_motion.ModeShapes(
            start=start,
            body=body_of_node,
            shape=_aligned_copy(np.vstack(shapes)),
            tiles=np.array(tiles, dtype=np.int32),
            first_node=np.array([(b.nodes.start, b.nodes.stop) for b in self.bodies], dtype=np.int32).reshape(-1),
            threes=np.array(threes, dtype=np.int32),
            axes=np.array(turns),
            origin=np.array([body.settings.translation for body in self.bodies], dtype=float),
        )
        mass = [in_blocks(body.node_mass[:, None]) for body in self.bodies]
        rest = np.vstack([in_blocks(body.mesh.nodes) for body in self.bodies])
        self.blocks = mode_motion.NodeBlocks(
            start=np.array(block_start, dtype=np.int32),
            shape=_aligned_copy(np.vstack(blocks)),
            first=np.cumsum([0, *map(len, mass)]).astype(np.int32),
            rest=_aligned_copy(rest),
            mass=_aligned_copy(np.vstack(mass)),
            displacement=aligned(len(rest), TILE),
        )

    def _lay_out_domains(self, first_element: np.ndarray, lag: np.ndarray, factor: np.ndarray, step: float) -> None:
        parts: list[Domains] = []
        tables: dict[tuple[str | None, str], tuple[IntegrationDomains, np.ndarray, int]] = {}
        slopes, slope_start, element = [], [], []
        size = 0
        for number, body in enumerate(self.bodies):
            assert body.modes is not None
            key, tiles = (body.settings.reduced, body.mesh.source), int(self.modes.tiles[number])
            if key not in tables:
                domains, weight = chosen_domains(body)
                slope = mode_slopes(domains, padded(body.modes.modes, TILE * tiles))
                tables[key] = domains, weight, size
                slopes.append(slope.reshape(-1, 9, tiles, TILE).transpose(0, 2, 1, 3).reshape(-1, TILE))
                size += len(slopes[-1])
            domains, weight, first_slope = tables[key]
            own = slice(first_element[number], first_element[number] + len(body.elements))
            data = domain_data(domains, body.laws, lag[own], factor[own], step)
            parts.append(data._replace(node=data.node + body.nodes.start, volume=data.volume * weight[:, None]))
            slope_start.append(first_slope + 9 * tiles * np.arange(len(weight)))
            element.append(domains.element + first_element[number])
        self.data, self.element = Domains(**joined_arrays(parts)), np.concatenate(element)
        self.domains = reduced_domains.ReducedDomains(
            body_start=np.cumsum([0, *(len(part.law) for part in parts)]).astype(np.int32),
            slope_start=np.concatenate(slope_start).astype(np.int32),
            slope=_aligned_copy(np.vstack(slopes)),
        )

    def slope_products(self, number: int, data: Domains) -> np.ndarray:
        """The sum of 2 w mu B_k : B_l, times the factor of K in A, over a body's domains under Hooke's law."""
        own, tiles = slice(*self.domains.body_start[number : number + 2]), int(self.modes.tiles[number])
        first = int(self.domains.slope_start[own.start])
        count = own.stop - own.start
        slope = self.domains.slope[first : first + 9 * tiles * count].reshape(count, tiles, 9, TILE)
        weight = 2.0 * (data.factor * data.volume[:, SHAPE] * data.modulus[:, MU] * (data.law == HOOKE))[own]
        rows = (np.sqrt(weight)[:, None, None, None] * slope).transpose(0, 2, 1, 3).reshape(9 * count, TILE * tiles)
        return np.asarray(rows.T @ rows)

    def _anchors_of(self, body: "SoftBody", number: int) -> tuple[np.ndarray, np.ndarray]:
        assert body.modes is not None
        held = np.flatnonzero(body.anchored)
        return body.anchor_stiffness[held], padded(body.modes.modes[held], int(self.widths[number]))

    def node_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """The places of the amplitudes of each body, all of which meet, as two arrays of nodes."""
        rows, columns = [], []
        for body, threes in zip(self.bodies, self.modes.threes.tolist(), strict=True):
            places = body.nodes.start + np.arange(threes)
            rows.append(np.repeat(places, threes))
            columns.append(np.tile(places, threes))
        return np.concatenate(rows), np.concatenate(columns)

    def find_blocks(self, block_pairs: np.ndarray) -> None:
        """Find the blocks of the system matrix, whose two nodes (row, column) are `block_pairs`, (block_count, 2)."""
        blocks, owners, first = [], [], []
        for number, body in enumerate(self.bodies):
            own = (block_pairs[:, 0] >= body.nodes.start) & (block_pairs[:, 0] < body.nodes.stop)
            blocks.append(np.flatnonzero(own))
            owners.append(np.full(len(blocks[-1]), number))
            first.append(3 * (block_pairs[own] - body.nodes.start))
        row, column = np.vstack(first).astype(np.int32).T
        self.block = np.concatenate(blocks).astype(np.int32)
        self.block_body = np.concatenate(owners).astype(np.int32)
        self.block_row, self.block_column = np.ascontiguousarray(row), np.ascontiguousarray(column)


def chosen_domains(body: "SoftBody") -> tuple[IntegrationDomains, np.ndarray]:
    """The domains that stand for all of a reduced body, and the factors of their volumes."""
    assert body.modes is not None
    domains, numbers = body.mesh_domains, body.modes.domain
    if numbers is None:
        return domains, np.ones(len(domains.element))
    weight = body.modes.weight if body.modes.weight is not None else np.ones(len(numbers))
    return domains.select(numbers), weight


def mode_slopes(domains: IntegrationDomains, modes: np.ndarray) -> np.ndarray:
    """B of each domain: its deformation gradient by an amplitude of 1 of each mode, shape (domain_count, 9,
    mode_count), entry 00 first, then 01.
    """
    slopes = np.empty((len(domains.element), 9, modes.shape[2]))
    for d, (a, b) in enumerate(zip(domains.start[:-1].tolist(), domains.start[1:].tolist(), strict=True)):
        products = np.tensordot(modes[domains.node[a:b]], domains.gradient[a:b], axes=(0, 0))
        slopes[d] = products.transpose(0, 2, 1).reshape(9, -1)
    return slopes


def padded(modes: np.ndarray, width: int) -> np.ndarray:
    """Modes with zeros up to `width` of them, shape (node_count, 3, width)."""
    wide = np.zeros((*modes.shape[:2], width))
    wide[..., : modes.shape[2]] = modes
    return wide


def in_blocks(values: np.ndarray) -> np.ndarray:
    """Values of nodes, shape (node_count, ...), in columns of eight nodes, padded with zeros."""
    flat = values.reshape(len(values), -1)
    blocks = np.zeros((-(-len(flat) // TILE) * TILE, flat.shape[1]))
    blocks[: len(flat)] = flat
    return blocks.reshape(-1, TILE, flat.shape[1]).transpose(0, 2, 1).reshape(-1, TILE)


def no_modes(node_count: int) -> mode_motion.ModeShapes:
    """For kernels, where all of so many nodes are unknowns themselves."""
    none = np.zeros(0, dtype=np.int32)
    start, body = (np.full(node_count, -1, dtype=np.int32) for _ in range(2))
    return mode_motion.ModeShapes(
        start=start,
        body=body,
        shape=np.zeros((0, TILE)),
        tiles=none,
        first_node=none,
        threes=none,
        axes=np.zeros((0, 3, 3)),
        origin=np.zeros((0, 3)),
    )


def _aligned_copy(rows: np.ndarray) -> np.ndarray:
    copy = aligned(len(rows), TILE)
    copy[:] = rows
    return copy


class ReducedSystem:
    """The reduced bodies at present positions, with present stiffnesses.

    Attributes:
        modes: the modes, with the frames of the bodies in the step.
        is_reduced: whether a node moves by modes, shape (node_count, 1).
    """

    def __init__(self, elasticity: ReducedElasticity, movement: Movement, blocks: np.ndarray):
        """Allocate the work space; `begin` changes the movement of the nodes, `assemble` fills the blocks."""
        self._elasticity, self._movement = elasticity, movement
        own = elasticity.modes
        self.modes = own._replace(axes=own.axes.copy(), origin=own.origin.copy())
        tiles, widths = own.tiles, elasticity.widths
        start = np.cumsum([0, *tiles]).astype(np.int32)
        position, velocity, total = (aligned(int(start[-1]), TILE) for _ in range(3))
        self._amplitudes = mode_motion.Amplitudes(
            start,
            position,
            velocity,
            total,
            scalars=total.reshape(-1),
            sums=aligned(TILE * int(start[-1]), TILE),
            other_sums=aligned(TILE * int(start[-1]), TILE),
            moment=aligned(3 * int(start[-1]), TILE),
            drag=elasticity.drag,
            gravity=np.empty((1, 3)),
        )
        moments = []  # Phi^T M along x, y and z in columns of eight
        for body, width in zip(elasticity.bodies, widths, strict=True):
            assert body.modes is not None
            weighted = body.node_mass[:, None, None] * padded(body.modes.modes, int(width))
            moments.append(weighted.sum(axis=0).reshape(-1, TILE))
        self._amplitudes.moment[:] = np.vstack(moments)
        self.is_reduced = own.start[:, None] >= 0
        shared = elasticity.blocks
        self._blocks = shared._replace(displacement=aligned(*shared.displacement.shape))
        self._node_factor = np.ones((elasticity.node_count, 1))
        for body in elasticity.bodies:
            self._node_factor[body.nodes, 0] = body.node_mass
        self._data = elasticity.data._replace(modulus=elasticity.data.modulus.copy())
        self._undamped_data = undamped_data(self._data)
        places = zip(elasticity.bodies, own.threes.tolist(), strict=True)
        self._places = [slice(body.nodes.start, body.nodes.start + threes) for body, threes in places]
        squares = np.cumsum([0, *(tiles * widths)])
        self._stiffness = reduced_domains.ReducedStiffness(
            rows=aligned(reduced_domains.ROWS * int(tiles.max()), TILE),
            share=np.zeros(9 * reduced_domains.RUBBER_SHARES),
            force=aligned(int(start[-1]), TILE),
            square_start=squares[:-1].astype(np.int32),
            constant=aligned(int(squares[-1]), TILE),
            square=aligned(int(squares[-1]), TILE),
            block=elasticity.block,
            block_body=elasticity.block_body,
            block_row=elasticity.block_row,
            block_column=elasticity.block_column,
            blocks=blocks,
        )
        self._undamped_stiffness = self._stiffness._replace(constant=aligned(int(squares[-1]), TILE))
        self._velocity, self._impulse = (np.zeros((elasticity.node_count, 3)) for _ in range(2))
        self._unknown = np.zeros((elasticity.node_count, 3))
        self._frames: tuple[bytes, bytes] | None = None
        self._multiply_slopes()
        self._set_constant()

    def scale_stiffness(self, factor: np.ndarray) -> None:
        """Multiply the stiffness of each element in the model by `factor`, shape (element_count,)."""
        model = self._elasticity
        np.multiply(model.data.modulus, factor[model.element, None], out=self._data.modulus)
        self._multiply_slopes()
        self._set_constant()

    def begin(self, turn: np.ndarray, shift: np.ndarray, gravity: np.ndarray, time_step: float, inertia: float) -> None:
        """Replace the velocities of the reduced bodies by the nearest ones that lead to positions by modes.

        The frames that they follow are where they will be at the end of the step, so that velocities have their
        motion; in overdamped dynamics, with the `inertia` 0 instead of 1, they have nothing else.
        """
        self._follow(turn, shift)
        self._amplitudes.gravity[0] = gravity
        movement = self._movement
        moving = (self._amplitudes, movement.position, movement.velocity)
        mode_motion.find_reference(time_step, inertia, self.modes, self._blocks, *moving, 1)

    def _follow(self, turn: np.ndarray, shift: np.ndarray) -> None:
        pose = turn.tobytes(), shift.tobytes()
        if pose == self._frames:
            return
        turned = self._frames is None or pose[0] != self._frames[0]
        self._frames, own = pose, self._elasticity.modes
        self.modes.axes[:] = turn @ own.axes
        self.modes.origin[:] = np.einsum("bij,bj->bi", turn, own.origin) + shift
        if turned:
            self._set_constant()

    def _multiply_slopes(self) -> None:
        """The part of the matrix that depends on stiffnesses alone: not on the frames, which may turn in every step."""
        numbers, multiply = range(len(self._elasticity.bodies)), self._elasticity.slope_products
        self._slopes = [[multiply(n, data) for n in numbers] for data in (self._data, self._undamped_data)]

    def _set_constant(self) -> None:
        """The matrix beside the rows: masses with damping, the anchors' springs, and 2 mu B : B of Hooke's law."""
        model = self._elasticity
        for number, (springs, modes) in enumerate(model.anchors):
            own = model.bodies[number].modes
            assert own is not None
            along = np.einsum("ij,njk->nik", self.modes.axes[number], modes)  # axes of space
            flat = (np.sqrt(springs)[:, :, None] * along).reshape(-1, modes.shape[2])
            is_mode = np.arange(flat.shape[1]) < own.mode_count
            mass = np.where(is_mode, model.mass_factor[number], 1.0)  # what is padded stays 0, also without masses
            matrix = model.anchor_factor[number] * (flat.T @ flat) + np.diag(mass)
            start = int(self._stiffness.square_start[number])
            place = slice(start, start + matrix.size // TILE)
            for stiffness, products in zip((self._stiffness, self._undamped_stiffness), self._slopes, strict=True):
                stiffness.constant[place] = (matrix + products[number]).reshape(-1, TILE)

    def assemble(self, damped: bool = True) -> None:
        """Fill the blocks of the reduced bodies, and find the elastic forces on the amplitudes."""
        reduced_domains.assemble_reduced(
            self.modes,
            self._elasticity.domains,
            self._data if damped else self._undamped_data,
            self._movement,
            self._amplitudes,
            self._stiffness if damped else self._undamped_stiffness,
            1,
        )

    @property
    def elastic(self) -> np.ndarray:
        """Elastic forces on the unknowns, as `assemble` found them, shape (node_count, 3); 0 for full bodies."""
        force = np.zeros((self._elasticity.node_count, 3))
        for place, start in zip(self._places, self._amplitudes.start[:-1].tolist(), strict=True):
            count = 3 * (place.stop - place.start)
            force[place] = self._stiffness.force[start : start + -(-count // TILE)].reshape(-1)[:count].reshape(-1, 3)
        return force

    def right_hand_side(self, node_impulse: np.ndarray, time_step: float) -> np.ndarray:
        """Impulses on the unknowns in a step, shape (node_count, 3): on the nodes of full bodies as they are.

        Those on the nodes [mN s] are without weight and drag of reduced bodies.
        """
        self._impulse[:] = self._unknown[:] = node_impulse
        force = self._stiffness.force
        mode_motion.project_impulses(
            time_step, self.modes, self._blocks, self._impulse, force, self._amplitudes, self._unknown, 1
        )
        return self._unknown

    def on_unknowns(self, node_impulse: np.ndarray) -> np.ndarray:
        """Impulses on the unknowns by these on the nodes alone [mN s], shape (node_count, 3) each."""
        impulse = self.right_hand_side(node_impulse, 0.0)
        for body, place in zip(self._elasticity.bodies, self._places, strict=True):
            impulse[place.stop : body.nodes.stop] = 0.0  # where no amplitude has its place
        return impulse.copy()

    def rates(self, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of the unknowns that are nearest to velocities of the nodes [mm/s], shape (node_count, 3) each."""
        return self.on_unknowns(self._node_factor * node_velocity)

    def node_velocity(self, unknown: np.ndarray) -> np.ndarray:
        """Velocities of the nodes [mm/s] by rates of the unknowns, shape (node_count, 3) each."""
        self._velocity[:] = self._unknown[:] = unknown
        mode_motion.expand_velocities(self.modes, self._blocks, self._unknown, self._amplitudes, self._velocity, 1)
        return self._velocity.copy()
