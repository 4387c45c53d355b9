"""The adjoint of a step: derivatives by its start, by what acts in it and by its bodies, of those by its end.

With the unknowns u of a step (velocities and impulses) and its equations r(y, u) = 0 from a start y, a number J of its
end changes by dJ = -m . (dr/dy) dy, where the multipliers m solve the transposed equations, (dr/du)^T m = dJ/du:
`StepDerivative.multipliers`. This module has the products m . dr/dy, with u as it is:

    soft bodies:   r = M (v - v0) + h a M v - h f(x0 + (h + b) v; R(x0)) - h (loads at x0) - J(x0)^T l
    rigid bodies:  r = w - free(y) - W(y) (impulses)
    rows:          r = target(y) - J(y) u, of contacts by where the search has measured surfaces: `contact_slopes.py`
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import scipy.sparse as sparse

from taichisoft.base.rotations import edge_frames, matrices_from_quaternions, quaternion_from_matrix, turn_matrices
from taichisoft.contact.model import Model
from taichisoft.errors import SceneError
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.kernels.domain_deformation import DILATION, LAMBDA, MU, SHAPE
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.contact_slopes import contact_slopes
from taichisoft.step.step_derivative import Multipliers, StepDerivative

TURN, SPEED = 1e-4, 1e-3
"""Half widths of differences by turns of rigid bodies [rad] and by their angular velocities [rad/s]."""
MOVE = 1e-2
"""Largest move of a node in differences of the actuators' gradients, which are polynomials of it or nearly so [mm]."""


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

    def add(self, other: "Slopes") -> None:
        """Add another one."""
        for one in fields(self):
            getattr(self, one.name)[...] += getattr(other, one.name)


class ElasticSlopes:
    """The product of multipliers and the elastic forces of a step, and its derivatives.

    In a step they are f = -sum w R sigma(R^T F - 1) g with the deformation F at x0 + lag v and the rotation R at x0.
    """

    def __init__(self, model: Model):
        """Lay out the pieces with one deformation each, linear tetrahedra and integration domains."""
        elasticity = model.elasticity
        assert elasticity is not None
        linear, counts = elasticity.linear_elements, [len(elasticity.linear)]
        starts, nodes = [np.arange(len(linear)) * 4], [linear.ravel()]
        gradients, lags = [elasticity.gradient[:, 0].reshape(-1, 3)], [elasticity.element_data.lag]
        moduli, elements = [elasticity.element_data.force_modulus], [elasticity.linear]
        if elasticity.domains is not None and elasticity.domains.hooke is not None:
            hooke = elasticity.domains.hooke
            data = hooke.data
            starts.append(data.start[:-1] + linear.size)
            nodes.append(data.node)
            gradients.append(data.gradient)
            lags.append(data.lag)
            weighted = data.volume[:, [DILATION, SHAPE]] * data.modulus[:, [LAMBDA, MU]]
            moduli.append(weighted)
            elements.append(hooke.element)
            counts.append(len(data.lag))
        node, gradient = np.concatenate(nodes), np.vstack(gradients)
        piece = np.repeat(np.arange(sum(counts)), np.diff(np.append(np.concatenate(starts), len(node))))
        places = (3 * piece[:, None] + np.arange(3)).ravel(), np.repeat(node, 3)
        shape = 3 * sum(counts), model.node_count
        self._gradient = sparse.csr_array(sparse.coo_array((gradient.ravel(), places), shape))
        self._transposed = sparse.csr_array(self._gradient.T)
        self._lag, self._modulus, element = np.concatenate(lags), np.vstack(moduli), np.concatenate(elements)
        self._material, self._rest_modulus = model.element_material[element], model.young_modulus
        body_of_element = np.repeat(np.arange(len(model.soft_bodies)), [len(b.elements) for b in model.soft_bodies])
        self._body = body_of_element[element]
        polar = np.concatenate([elasticity.element_data.polar != 0, np.ones(sum(counts[1:]), dtype=bool)])
        self._edges = np.flatnonzero(~polar)
        self._edge_nodes, self._rest_frame = linear[self._edges, :3], elasticity.element_data.rest_frame[self._edges]

    def add(self, start: State, time_step: float, velocity: np.ndarray, multiplier: np.ndarray, slopes: Slopes) -> Any:
        """Subtract the derivative of m . r by the start from the slopes.

        Returns:
            Those of the number by Young's moduli, (material_count,), and by the damping b, (body_count,).
        """
        deformation, rate, along = (self._deformation(one) for one in (start.position, velocity, multiplier))
        lagged = deformation + self._lag[:, None, None] * rate
        turn = polar_rotations(deformation)
        frames = self._frames(start.position)
        turn[self._edges] = frames @ self._rest_frame.transpose(0, 2, 1)
        back = turn.transpose(0, 2, 1)
        strain, measured = back @ lagged - np.eye(3), back @ along
        modulus = self._modulus * (start.young_modulus / self._rest_modulus)[self._material, None]
        stress, virtual = (_hooke(one, modulus) for one in (strain, measured))
        # m . r = h sum (R sigma(S)) : L with L = R T; it changes with F, and with the turn w of R by t . w.
        of_lagged = time_step * turn @ virtual
        turned = back @ (lagged @ virtual + along @ stress)
        torque = time_step * axial_vectors(turned)
        of_place = of_lagged + turn @ cross_matrices(self._by_polar(back @ deformation, torque))
        slopes.position -= self._on_nodes(of_place)
        self._subtract_edges(start.position, frames, torque, slopes.position)
        product = time_step * (stress * measured).sum(axis=(1, 2))
        by_modulus = -np.bincount(self._material, product, len(self._rest_modulus)) / start.young_modulus
        by_lag = -np.bincount(self._body, (of_lagged * rate).sum(axis=(1, 2)), self._body.max() + 1)
        return by_modulus, by_lag

    def _deformation(self, of_nodes: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray((self._gradient @ of_nodes).reshape(-1, 3, 3).transpose(0, 2, 1))

    def _on_nodes(self, of_deformation: np.ndarray) -> np.ndarray:
        product: np.ndarray = self._transposed @ of_deformation.transpose(0, 2, 1).reshape(-1, 3)
        return product

    def _by_polar(self, stretch: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """The axial vector that a torque is on R^T dF: (tr(S) - S) w = axial(R^T dF)."""
        matrix = np.trace(stretch, axis1=1, axis2=2)[:, None, None] * np.eye(3) - stretch
        matrix[self._edges], torque = np.eye(3), torque.copy()
        torque[self._edges] = 0.0
        return np.linalg.solve(matrix, torque[..., None])[..., 0]

    def _frames(self, position: np.ndarray) -> np.ndarray:
        first, second, third = position[self._edge_nodes].transpose(1, 0, 2)
        return edge_frames(second - first, third - first)

    def _subtract_edges(
        self, position: np.ndarray, frames: np.ndarray, torque: np.ndarray, of_node: np.ndarray
    ) -> None:
        """The same of rotations by two edges: a frame turns with its first edge, and about it with the second."""
        if not len(self._edges):
            return
        corners = position[self._edge_nodes]
        along, across = (np.einsum("eji,ej->ei", frames, corners[:, k] - corners[:, 0]) for k in (1, 2))
        # R = frame rest^T turns by frame w frame^T, in its own axes by rest w.
        own = np.einsum("eji,ej->ei", self._rest_frame, torque[self._edges])
        length, (beside, height) = along[:, 0], across[:, :2].T
        by_first, by_second = np.zeros_like(own), np.zeros_like(own)
        by_second[:, 2] = own[:, 0] / height
        by_first[:, 1] = own[:, 2] / length
        by_first[:, 2] = -(own[:, 1] + own[:, 0] * beside / height) / length
        for corner, part in ((1, by_first), (2, by_second), (0, -by_first - by_second)):
            np.subtract.at(of_node, self._edge_nodes[:, corner], np.einsum("eij,ej->ei", frames, part))


def _hooke(strain: np.ndarray, modulus: np.ndarray) -> np.ndarray:
    trace = np.trace(strain, axis1=1, axis2=2)
    shear: np.ndarray = modulus[:, 1, None, None] * (strain + strain.transpose(0, 2, 1))
    return shear + (modulus[:, 0] * trace)[:, None, None] * np.eye(3)


def axial_vectors(matrix: np.ndarray) -> np.ndarray:
    """Vectors t with t . w = A : [w], of which [t] is A - A^T."""
    odd = matrix - matrix.transpose(0, 2, 1)
    return np.stack([odd[:, 2, 1], odd[:, 0, 2], odd[:, 1, 0]], axis=1)


def cross_matrices(vector: np.ndarray) -> np.ndarray:
    """Matrices of cross products with vectors, shape (count, 3, 3)."""
    x, y, z = vector.T
    nought = np.zeros_like(x)
    return np.stack([nought, -z, y, z, nought, -x, -y, x, nought], axis=1).reshape(-1, 3, 3)


def polar_rotations(matrices: np.ndarray) -> np.ndarray:
    """The nearest rotations, shape (count, 3, 3), by Newton's method (Higham 1986, Computing the polar
    decomposition); of matrices turned inside out by their singular values."""
    found, inverted = matrices.copy(), np.linalg.det(matrices) <= 0.0
    found[inverted] = np.eye(3)
    for _ in range(30):
        cofactor = np.stack([np.cross(found[:, i - 2], found[:, i - 1]) for i in range(3)], axis=1)
        inverse = cofactor / (found[:, 0] * cofactor[:, 0]).sum(axis=1)[:, None, None]
        change = 0.5 * (inverse - found)
        found += change
        if np.abs(change).max(initial=0.0) < 1e-9:  # it is quadratic: the next would be round-off
            break
    left, _, right = np.linalg.svd(matrices[inverted])
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    found[inverted] = left @ right
    return found


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
        self._elastic = ElasticSlopes(model) if model.elasticity is not None else None
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
        (elasticity is not None and elasticity.reinforcements is not None, "membranes and fibres; leave them out"),
        (bool(actuators.has_law.any()), 'air that is shut in or flows; take air = "pressure"'),
        (len(actuators.coordinates.rigid_body) > 0, "cables over rigid bodies"),
        (actuators.count > len(actuators.names), "cables that rub; leave their friction out"),
        (any(one.any() for one in actuators.compliance), "cables that stretch; leave their stiffness out"),
    ):
        if is_there:
            raise SceneError(f"gradient: a run has no gradient here with {what}")
