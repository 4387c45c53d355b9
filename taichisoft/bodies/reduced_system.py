"""The reduced soft bodies at present positions: their amplitudes, forces and blocks of the system matrix."""

import numpy as np

from taichisoft.bodies.domain_elasticity import aligned, undamped_data
from taichisoft.bodies.kernels import mode_motion, reduced_domains
from taichisoft.bodies.kernels.domain_deformation import Movement
from taichisoft.bodies.reduced_elasticity import ReducedElasticity, padded
from taichisoft.bodies.soft_body_arrays import SoftBody
from taichisoft.runtime.tiles import TILE


class ReducedSystem:
    """The reduced bodies at present positions, with present stiffnesses.

    Attributes:
        modes: the modes, with the frames of the bodies in the step.
        is_reduced: whether a node moves by modes, shape (node_count, 1).
    """

    def __init__(self, elasticity: ReducedElasticity, movement: Movement, blocks: np.ndarray):
        """Allocate the work space.

        Args:
            elasticity: the model's reduced bodies.
            movement: positions and velocities of all nodes, which `begin` changes.
            blocks: of the system matrix, which `assemble` fills, shape (block_count, 3, 3).
        """
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
        moments = [_moment(body, int(width)) for body, width in zip(elasticity.bodies, widths, strict=True)]
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

    def begin(
        self, turn: np.ndarray, shift: np.ndarray, gravity: np.ndarray, time_step: float, has_inertia: bool
    ) -> None:
        """Replace the velocities of the reduced bodies by the nearest ones that lead to positions by modes.

        The frames are where they will be at the end of the step, so that velocities have their motion; in overdamped
        dynamics they have nothing else.

        Args:
            turn: rotation of the frame that each reduced body follows, shape (body_count, 3, 3).
            shift: its shift [mm], shape (body_count, 3): it has moved what was at x at rest to turn @ x + shift.
            gravity: acceleration of gravity [mm/s^2], shape (3,).
            time_step: time step h [s].
            has_inertia: whether bodies have inertia.
        """
        self._follow(turn, shift)
        self._amplitudes.gravity[0] = gravity
        movement = self._movement
        moving = (self._amplitudes, movement.position, movement.velocity)
        mode_motion.find_reference(time_step, float(has_inertia), self.modes, self._blocks, *moving, 1)

    def _follow(self, turn: np.ndarray, shift: np.ndarray) -> None:
        """Let the bodies' own axes follow the frames."""
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
        found = np.zeros((self._elasticity.node_count, 3))
        for place, start in zip(self._places, self._amplitudes.start[:-1].tolist(), strict=True):
            count = 3 * (place.stop - place.start)
            found[place] = self._stiffness.force[start : start + -(-count // TILE)].reshape(-1)[:count].reshape(-1, 3)
        return found

    def right_hand_side(self, node_impulse: np.ndarray, time_step: float) -> np.ndarray:
        """Impulses on the unknowns in a step, shape (node_count, 3): on the nodes of full bodies as they are.

        Args:
            node_impulse: on the nodes [mN s], without weight and drag of reduced bodies, shape (node_count, 3).
            time_step: time step h [s].
        """
        self._impulse[:] = self._unknown[:] = node_impulse
        force = self._stiffness.force
        mode_motion.project_impulses(
            time_step, self.modes, self._blocks, self._impulse, force, self._amplitudes, self._unknown, 1
        )
        return self._unknown

    def on_unknowns(self, node_impulse: np.ndarray) -> np.ndarray:
        """Impulses on the unknowns by these on the nodes alone [mN s], shape (node_count, 3) each."""
        found = self.right_hand_side(node_impulse, 0.0)
        for body, place in zip(self._elasticity.bodies, self._places, strict=True):
            found[place.stop : body.nodes.stop] = 0.0  # where no amplitude has its place
        return found.copy()

    def rates(self, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of the unknowns that are nearest to velocities of the nodes [mm/s], shape (node_count, 3) each."""
        return self.on_unknowns(self._node_factor * node_velocity)

    def node_velocity(self, unknown: np.ndarray) -> np.ndarray:
        """Velocities of the nodes [mm/s] by rates of the unknowns, shape (node_count, 3) each."""
        self._velocity[:] = self._unknown[:] = unknown
        mode_motion.expand_velocities(self.modes, self._blocks, self._unknown, self._amplitudes, self._velocity, 1)
        return self._velocity.copy()


def _moment(body: SoftBody, width: int) -> np.ndarray:
    """Phi^T M along x, y and z in columns of eight, shape (3 width / 8, 8)."""
    assert body.modes is not None
    return np.asarray((body.node_mass[:, None, None] * padded(body.modes.modes, width)).sum(axis=0)).reshape(-1, TILE)
