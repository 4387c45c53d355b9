"""The adjoint of a step: derivatives by its start, by what acts in it and by its bodies, of those by its end.

With the unknowns u of a step (velocities and impulses) and its equations r(y, u) = 0 from a start y, a number J of its
end changes by dJ = -m . (dr/dy) dy, where the multipliers m solve the transposed equations, (dr/du)^T m = dJ/du:
`StepDerivative.multipliers`. This module has the products m . dr/dy, with u as it is:

    soft bodies:   r = M (v - v0) + h a M v - h f(x0 + (h + b) v; R(x0)) - h (loads at x0) - J(x0)^T l
    rigid bodies:  r = w - free(y) - W(y) (impulses)
    rows:          r = target(y) - J(y) u, of contacts by where the search has measured surfaces: `contact_slopes.py`
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from taichisoft.base.rotations import matrices_from_quaternions, quaternion_from_matrix, turn_matrices
from taichisoft.contact.model import Model
from taichisoft.errors import SceneError
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.mechanics.kernels.domain_deformation import DILATION, LAMBDA, MU, SHAPE
from taichisoft.mechanics.kernels.elastic_slopes import ElasticPieces, PieceSlopes, elastic_slopes
from taichisoft.mechanics.kernels.hooke_domains import POLAR
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.soft_body_arrays import reshaped
from taichisoft.mechanics.state import State
from taichisoft.step.contact_slopes import contact_slopes
from taichisoft.step.step_derivative import Multipliers, StepDerivative

TURN, SPEED = 1e-4, 1e-3
"""Half widths of differences by turns of rigid bodies [rad] and by their angular velocities [rad/s]."""
MOVE = 1e-2
"""Largest move of a node in differences of the actuators' gradients, which are polynomials of it or nearly so [mm]."""

REST_MOVE = 1e-4
"""Largest move of a node at rest in differences by it [mm]: its square and round-off are both some 1e-9 of it."""


@dataclass
class Slopes:
    """Derivatives of a number by a state.

    Attributes:
        position, velocity: by those of the nodes [1/mm] and [s/mm], shape (node_count, 3).
        rigid_position, rigid_turn: by the centres of mass [1/mm] and by turns of the rigid bodies, as rotation vectors
            about them in world axes [1/rad], shape (rigid_count, 3).
        rigid_velocity: by their linear [s/mm] and angular velocities [s/rad], shape (rigid_count, 6).
    """

    position: np.ndarray
    velocity: np.ndarray
    rigid_position: np.ndarray
    rigid_turn: np.ndarray
    rigid_velocity: np.ndarray

    @classmethod
    def none(cls, model: Model) -> "Slopes":
        """All 0."""
        nodes, rigid = (model.node_count, 3), (len(model.rigid_bodies), 3)
        return cls(*(np.zeros(shape) for shape in (nodes, nodes, rigid, rigid, (rigid[0], 6))))


class ElasticSlopes:
    """The product of multipliers and the elastic forces of a step, and its derivatives."""

    def __init__(self, model: Model, elasticity: Elasticity):
        """Lay out the pieces with one deformation each, linear tetrahedra and integration domains."""
        data = elasticity.element_data
        count, nodes = len(data.lag), [elasticity.linear_elements.ravel()]
        sizes, gradients, lags = [np.full(count, 4)], [elasticity.gradient[:, 0].reshape(-1, 3)], [data.lag]
        moduli, elements = [data.force_modulus], [elasticity.linear]
        if elasticity.domains is not None and elasticity.domains.hooke is not None:
            hooke = elasticity.domains.hooke
            nodes.append(hooke.data.node)
            sizes.append(np.diff(hooke.data.start))
            gradients.append(hooke.data.gradient)
            lags.append(hooke.data.lag)
            moduli.append(hooke.data.volume[:, [DILATION, SHAPE]] * hooke.data.modulus[:, [LAMBDA, MU]])
            elements.append(hooke.element)
        element, node = np.concatenate(elements), np.concatenate(nodes)
        rest_frame, corotation = np.tile(np.eye(3), (len(element), 1, 1)), np.full(len(element), POLAR, dtype=np.int32)
        rest_frame[:count], corotation[:count] = data.rest_frame, data.corotation
        self._modulus = np.vstack(moduli)
        self._pieces = ElasticPieces(
            start=np.cumsum([0, *np.concatenate(sizes)]).astype(np.int32),
            node=node.astype(np.int32),
            gradient=np.vstack(gradients),
            corotation=corotation,
            rest_frame=rest_frame,
            modulus=self._modulus.copy(),
            lag=np.concatenate(lags),
        )
        self._slopes = PieceSlopes(np.zeros(len(element)), np.zeros(len(element)), np.zeros((len(node), 3)))
        self._start, self._velocity, self._multiplier = np.zeros((3, model.node_count, 3))
        entries = np.ones(len(node)), (node, np.arange(len(node)))
        self._on_nodes = sparse.csr_array(sparse.coo_array(entries, (model.node_count, len(node))))
        self._material, self._rest_modulus = model.element_material[element], model.young_modulus
        counts = [len(body.elements) for body in model.soft_bodies]
        self._body, self._body_count = np.repeat(np.arange(len(counts)), counts)[element], len(counts)

    def add(self, start: State, time_step: float, velocity: np.ndarray, multiplier: np.ndarray, slopes: Slopes) -> Any:
        """Subtract the derivative of m . r by the start from the slopes.

        Returns:
            Those of the number by Young's moduli, (material_count,), and by the damping b, (body_count,).
        """
        self.measure(start, velocity, time_step * multiplier)
        slopes.position -= self._on_nodes @ self._slopes.by_position
        by_modulus = -np.bincount(self._material, self._slopes.product, len(self._rest_modulus))
        by_lag = -np.bincount(self._body, self._slopes.by_lag, self._body_count)
        return by_modulus / start.young_modulus, by_lag

    def measure(self, start: State, velocity: np.ndarray, multiplier: np.ndarray) -> float:
        """Derive the product of the forces with multipliers, which it returns [mN mm per unit of these]."""
        self._start[:], self._velocity[:], self._multiplier[:] = start.position, velocity, multiplier
        scale = (start.young_modulus / self._rest_modulus)[self._material, None]
        np.multiply(self._modulus, scale, out=self._pieces.modulus)
        elastic_slopes(self._pieces, self._start, self._velocity, self._multiplier, self._slopes)
        return float(self._slopes.product.sum())


class RestSlopes:
    """Derivatives by a number that moves the nodes at rest: by differences of elements and masses, which it shapes."""

    def __init__(self, model: Model, move: np.ndarray):
        """Shape the bodies a little more and a little less by a move [mm per unit], shape (node_count, 3).

        Raises:
            SceneError: the model has cables or embedded surfaces, whose points lie in other elements then.
        """
        if model.cables.names:
            raise SceneError(
                "gradient: moves of nodes at rest have no derivative here with cables; take cavities alone"
            )
        self._model, self._move = model, move
        self._half = REST_MOVE / max(float(np.abs(move).max()), 1e-300)
        bodies = [
            [reshaped(body, sign * self._half * move[body.nodes]) for body in model.soft_bodies] for sign in (1.0, -1.0)
        ]
        more, less = (Elasticity(one, model.scene.time) for one in bodies)
        self._sides = ElasticSlopes(model, more), ElasticSlopes(model, less)
        self._mass = (more.node_mass - less.node_mass) / (2.0 * self._half)
        geometry, rest = ActuatorGeometry(model.actuators, model.node_count), model.initial_state()
        geometry.update(rest, model.placed_pull_points(rest))
        self._value = geometry.rates(move, np.zeros((len(model.rigid_bodies), 6)))

    def along(self, derivative: StepDerivative, found: Multipliers) -> float:
        """The derivative of what a step makes of a number, with its start as it is but for the anchors."""
        h, start, nodes = self._model.scene.time.step, derivative.start, found.node
        elasticity, velocity = self._model.elasticity, derivative.solution.node_velocity
        assert elasticity is not None
        more, less = (side.measure(start, velocity, h * nodes) for side in self._sides)
        change = velocity - start.velocity - h * start.gravity + h * elasticity.node_rayleigh_mass[:, None] * velocity
        total = -(more - less) / (2.0 * self._half) - float(self._mass @ (change * nodes).sum(axis=1))
        anchored = self._model.anchored_nodes
        turn = self._model.places(start).turn[self._model.anchor_frame]
        targets = np.einsum("aij,aj->ai", turn, self._move[anchored])
        total += h * float((elasticity.anchor_stiffness[anchored] * nodes[anchored] * targets).sum())
        rows = found.row[3 * derivative.contact_count :]
        imposed = start.actuator_imposed[derivative.coordinates]  # each cavity has one coordinate
        return total - float((rows * imposed) @ self._value[derivative.coordinates]) / h


class StepAdjoint:
    """Takes derivatives by the end of a step back to its start.

    Attributes:
        by_material, by_damping, by_drag, by_density, by_mass, by_friction: derivatives, summed over all steps, by
            Young's moduli [1/kPa], by Rayleigh's factors of stiffness [1/s] and of mass [s], by a share of the density
            of soft bodies and of the mass of rigid bodies [-], and by friction [-] of each two bodies.
        carried: derivatives by the velocities that lead bodies to where frames carry them, where contacts are sought;
            of the last step, shape (rigid_count, 6).
        inexact: number of contacts, of all `contacts`, whose derivatives leave something out, see `contact_slopes`.
    """

    def __init__(self, model: Model):
        """Prepare for the steps of a model.

        Raises:
            SceneError: the model has something whose steps have no derivative by their start here.
        """
        _refuse(model)
        self._model, self._time_step = model, model.scene.time.step
        self._elastic = ElasticSlopes(model, model.elasticity) if model.elasticity is not None else None
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        bodies = model.soft_bodies
        self._node_body = np.repeat(np.arange(len(bodies)), [len(body.rest_position) for body in bodies])
        self.by_material, self.by_damping = np.zeros(len(model.young_modulus)), np.zeros(len(bodies))
        self.by_drag, self.by_density, self.by_mass = (*np.zeros((2, len(bodies))), np.zeros(len(model.rigid_bodies)))
        self.by_friction = np.zeros((len(model.body_names),) * 2)
        self.carried = np.zeros((len(model.rigid_bodies), 6))
        self.inexact = self.contacts = 0

    def back(self, derivative: StepDerivative, end: Slopes, impulse: np.ndarray) -> tuple[Slopes, Multipliers]:
        """Derivatives by the start, and multipliers, of those by the end and by the rows' impulses, (row_count,)."""
        h, solution, start = self._time_step, derivative.solution, derivative.start
        moved = h * solution.rigid_velocity[:, 3:]
        of_rigid = end.rigid_velocity.copy()
        of_rigid[:, :3] += h * end.rigid_position
        of_rigid[:, 3:] += h * (turn_matrices(moved, mean=True).transpose(0, 2, 1) @ end.rigid_turn[..., None])[..., 0]
        found = derivative.multipliers(end.velocity + h * end.position, of_rigid, impulse)
        turned = (turn_matrices(moved).transpose(0, 2, 1) @ end.rigid_turn[..., None])[..., 0]
        nothing = Slopes.none(self._model)
        slopes = Slopes(
            end.position.copy(), nothing.velocity, end.rigid_position.copy(), turned, nothing.rigid_velocity
        )
        if self._elastic is not None:
            self._add_soft(derivative, found, slopes)
        self._add_actuators(derivative, found, slopes)
        self._add_rigid(derivative, found, slopes)
        self.carried[:] = 0.0
        if derivative.contact_count:
            self._add_contacts(derivative, found, slopes)
        derivative.rigid.begin(start)
        return slopes, found

    def _add_soft(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        model, h, start, velocity = self._model, self._time_step, derivative.start, derivative.solution.node_velocity
        elasticity, nodes = model.elasticity, found.node
        assert elasticity is not None and self._elastic is not None
        slopes.velocity += elasticity.node_mass[:, None] * nodes
        anchored = model.anchored_nodes
        slopes.position[anchored] -= h * elasticity.anchor_stiffness[anchored] * nodes[anchored]
        by_material, by_damping = self._elastic.add(start, h, velocity, nodes, slopes)
        self.by_material += by_material
        self.by_damping += by_damping
        is_damped = np.array([body.settings.damped_anchors for body in model.soft_bodies])[self._node_body]
        anchors = h * (elasticity.anchor_stiffness * velocity * nodes).sum(axis=1) * is_damped
        drag = h * elasticity.node_mass * (velocity * nodes).sum(axis=1)
        change = velocity - start.velocity - h * start.gravity + h * elasticity.node_rayleigh_mass[:, None] * velocity
        inertia = elasticity.node_mass * (change * nodes).sum(axis=1)
        for total, part in ((self.by_damping, anchors), (self.by_drag, drag), (self.by_density, inertia)):
            total -= np.bincount(self._node_body, part, len(total))

    def _add_actuators(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        """Loads turn and grow with the bodies, and rows of coordinates with what they are of."""
        model, start, solution, h = self._model, derivative.start, derivative.solution, self._time_step
        if not model.actuators.count:
            return
        coordinates, entries = model.actuators.coordinates, np.diff(model.actuators.coordinates.entry_start)
        row = np.zeros(model.actuators.count)
        row[derivative.coordinates] = -found.row[3 * derivative.contact_count :]
        directions = (found.node, -h * solution.effort), (solution.node_velocity, row)
        for direction, weight in directions:
            largest = float(np.abs(direction).max(initial=0.0))
            if not (largest > 0.0 and weight.any()):
                continue
            share = MOVE / largest
            change = (
                0.5 / share * (self._gradients(start, share * direction) - self._gradients(start, -share * direction))
            )
            np.subtract.at(slopes.position, coordinates.entry_node, np.repeat(weight, entries)[:, None] * change)
        here = np.repeat(row / h, entries)[:, None] * self._gradients(start, 0.0)
        np.subtract.at(slopes.position, coordinates.entry_node, here)

    def _gradients(self, start: State, move: Any) -> np.ndarray:
        ahead = PosesAhead(start.position + move, start.rigid_position, start.rigid_rotation)
        self._geometry.update(ahead, self._model.placed_pull_points(start))
        return self._geometry.gradient.soft.copy()

    def _add_rigid(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        """Free motion and inertia change with poses and velocities: by differences, of all bodies at once."""
        start, rigid, impulse = derivative.start, derivative.rigid, derivative.solution.rigid_impulse
        if not len(start.rigid_position):
            return
        rigid.begin(start)
        response = np.einsum("bi,bij,bj->b", found.rigid, rigid.state.inverse_mass, impulse)
        self.by_mass -= np.where(self._model.rigid_frame < 0, response, 0.0)
        turns = matrices_from_quaternions(start.rigid_rotation)
        for axis in range(3):
            vector = np.eye(3)[axis]
            for name, width in (("place", MOVE), ("turn", TURN), ("linear", MOVE), ("angular", SPEED)):
                sides = []
                for sign in (width, -width):
                    changes: dict[str, np.ndarray] = {}
                    if name == "turn":
                        turn = turn_matrices((sign * vector)[None])[0]
                        changes["rigid_rotation"] = np.array([quaternion_from_matrix(turn @ one) for one in turns])
                    else:
                        field = {"place": "position", "linear": "velocity", "angular": "angular_velocity"}[name]
                        changes[f"rigid_{field}"] = getattr(start, f"rigid_{field}") + sign * vector
                    rigid.begin(start.changed(**changes))
                    free = rigid.state.free + np.einsum("bij,bj->bi", rigid.state.inverse_mass, impulse)
                    sides.append((found.rigid * free).sum(axis=1))
                change = (sides[0] - sides[1]) / (2.0 * width)
                of = {
                    "place": slopes.rigid_position[:, axis],
                    "turn": slopes.rigid_turn[:, axis],
                    "linear": slopes.rigid_velocity[:, axis],
                    "angular": slopes.rigid_velocity[:, 3 + axis],
                }
                of[name][:] += change

    def _add_contacts(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        derivative.rigid.begin(derivative.start)
        places = contact_slopes(self._model, derivative, found, derivative.rigid.state)
        slopes.position += places.position
        slopes.velocity += places.velocity
        own = places.rigid
        # What frames carry has the velocity that leads to where they are.
        carried = derivative.rigid.carried.index
        self.carried[carried] = own[carried, 2:].reshape(-1, 6)
        own[carried, :2] -= own[carried, 2:] / self._time_step
        own[carried, 2:] = 0.0
        slopes.rigid_position += own[:, 0]
        slopes.rigid_turn += own[:, 1]
        slopes.rigid_velocity += own[:, 2:].reshape(-1, 6)
        self.inexact += int(places.inexact.sum())
        self.contacts += len(places.inexact)
        sliding = np.flatnonzero([one.slides for one in derivative.contact_conditions()])
        pairs = derivative.problem.contacts.found.bodies[derivative.contacts[sliding]]
        by_friction = found.condition[3 * sliding + 1] * derivative.impulse[3 * sliding]
        np.subtract.at(self.by_friction, tuple(pairs.T), by_friction)


def _refuse(model: Model) -> None:
    """Raise the error of what has no derivative by the start of a step here."""
    time, actuators = model.scene.time, model.actuators
    elasticity = model.elasticity
    rubber = elasticity is not None and elasticity.domains is not None and elasticity.domains.rubber is not None
    for is_there, what in (
        (time.dynamics != "inertial", f'time.dynamics = "{time.dynamics}"; leave it "inertial"'),
        (time.most_linearisations > 1, f"time.newton = {time.newton}; leave it 1"),
        (time.theta < 1.0, f"time.theta = {time.theta:g}; leave it 1"),
        (any(body.modes is not None for body in model.soft_bodies), "reduced bodies; leave `reduced` out"),
        (rubber, 'laws of rubber; take law = "hooke"'),
        (
            elasticity is not None and elasticity.reinforcements is not None,
            "membranes, fibres or springs",
        ),
        (bool(actuators.has_law.any()), 'air that is shut in or flows; take air = "pressure"'),
        (len(actuators.coordinates.rigid_body) > 0, "cables over rigid bodies"),
        (actuators.count > len(actuators.names), "cables that rub; leave their friction out"),
        (any(one.any() for one in actuators.compliance), "cables that stretch; leave their stiffness out"),
    ):
        if is_there:
            raise SceneError(f"gradient: a run has no gradient here with {what}")
