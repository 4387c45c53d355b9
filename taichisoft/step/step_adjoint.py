"""The adjoint of a step: derivatives by its start, by what acts in it and by its bodies, of those by its end.

With the unknowns u of a step (velocities and impulses) and its equations r(y, u) = 0 from a start y, a number J of its
end changes by dJ = -m . (dr/dy) dy, where the multipliers m solve the transposed equations, (dr/du)^T m = dJ/du:
`StepDerivative.multipliers`. This module has the products m . dr/dy, with u as it is:

    soft bodies:   r = M (v - v0) + h a M v - h f(x0 + (h + b) v; R(x0)) - h (loads at x0) - J(x0)^T l
    rigid bodies:  r = w - free(y) - W(y) (impulses)
    rows:          r = target(y) - J(y) u, of contacts by where the search has measured surfaces: `contact_slopes.py`
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse

from taichisoft.base.rotations import matrices_from_quaternions, quaternion_from_matrix, turn_matrices
from taichisoft.contact.model import Model
from taichisoft.errors import SceneError
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.domain_elasticity import domain_data
from taichisoft.mechanics.domains import quadrature_domains
from taichisoft.mechanics.elastic_laws import ElasticLaws, elastic_law, joined_arrays
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.mechanics.kernels.domain_deformation import HOOKE, Domains, Movement
from taichisoft.mechanics.kernels.elastic_slopes import PieceSlopes, elastic_slopes
from taichisoft.mechanics.kernels.hooke_domains import POLAR
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.soft_body_arrays import reshaped
from taichisoft.mechanics.state import State
from taichisoft.scene.soft_body import SoftBodySettings
from taichisoft.step.contact_slopes import contact_slopes
from taichisoft.step.step_derivative import Multipliers, StepDerivative

TURN, SPEED = 1e-4, 1e-3
"""Half widths of differences by turns of rigid bodies [rad] and by their angular velocities [rad/s]."""
MOVE = 1e-2
"""Largest move of a node in differences of the actuators' gradients, which are polynomials of it or nearly so [mm]."""
REST_MOVE = 1e-6
"""Largest move of a node at rest in differences by it [mm]: round-off is some 1e-8, and laws of rubber have kinks."""
COEFFICIENT = 1e-4
"""Half width of differences by a coefficient of a law, over the coefficient [-]."""


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

    def __init__(self, model: Model, elasticity: Elasticity, chosen: np.ndarray | None = None):
        """Lay out the pieces with one deformation each: linear tetrahedra, domains, those of reduced bodies.

        Without those of elements that are not `chosen`, shape (element_count,).
        """
        data, domains, reduced = elasticity.element_data, elasticity.domains, elasticity.reduced
        linear = quadrature_domains(elasticity.linear_elements, elasticity.gradient, elasticity.volume)
        laws = ElasticLaws.joined([body.laws for body in model.soft_bodies]).select(elasticity.linear)
        parts = [(domain_data(linear, laws, data.lag, data.lag, model.scene.time.step), elasticity.linear)]
        kinds = () if domains is None else (domains.hooke, domains.rubber)
        parts += [(one.data, one.element) for one in (*kinds, reduced) if one is not None]
        pieces, element = Domains(**joined_arrays([part for part, _ in parts])), np.concatenate([e for _, e in parts])
        corotation, frames = np.full(len(element), POLAR, np.int32), np.tile(np.eye(3), (len(element), 1, 1))
        corotation[: len(data.lag)], frames[: len(data.lag)] = data.corotation, data.rest_frame
        if chosen is not None:
            own = chosen[element]
            pieces, corotation, frames, element = _selected(pieces, own), corotation[own], frames[own], element[own]
        self._pieces, self._corotation, self._frames, nodes = pieces, corotation, frames, pieces.node
        self._modulus, self._is_rubber = self._pieces.modulus.copy(), bool((self._pieces.law != HOOKE).any())
        self._slopes = PieceSlopes(*np.zeros((2, len(element))), *np.zeros((3, len(nodes), 3)))
        self._start, self._known, self._change, self._multiplier = np.zeros((4, model.node_count, 3))
        entries = np.ones(len(nodes)), (nodes, np.arange(len(nodes)))
        self._on_nodes = sparse.csr_array(sparse.coo_array(entries, (model.node_count, len(nodes))))
        self._material, self._rest_modulus = model.element_material[element], model.young_modulus
        counts = [len(body.elements) for body in model.soft_bodies]
        self._body, self._body_count = np.repeat(np.arange(len(counts)), counts)[element], len(counts)

    def add(self, derivative: StepDerivative, multiplier: np.ndarray) -> tuple[np.ndarray, ...]:
        """Derivatives of m . r in a step, of which the multipliers are m.

        Returns:
            Those by positions of the nodes, by their velocities before the step (with those after it as they are) and
            after it, (node_count, 3), by Young's moduli, (material_count,), and by the damping b, (body_count,).
        """
        total: list[Any] = [0.0] * 5
        for term in elastic_terms(derivative):
            self._measure(derivative, term, multiplier)
            by_modulus = np.bincount(self._material, self._slopes.product, len(self._rest_modulus))
            by_lag = np.bincount(self._body, self._slopes.by_lag, self._body_count)
            parts = (
                self._on_nodes @ self._slopes.by_position,
                self._on_nodes @ self._slopes.by_known if self._is_rubber and term.is_at_start else 0.0,
                self._on_nodes @ self._slopes.by_velocity if derivative.reduced is not None else 0.0,
                by_modulus / derivative.start.young_modulus,
                by_lag,
            )
            total = [one + more for one, more in zip(total, parts, strict=True)]
        return tuple(total)

    def product(self, derivative: StepDerivative, multiplier: np.ndarray) -> float:
        """m . r of the elastic forces in a step [mN mm per unit of the multipliers]."""
        terms = elastic_terms(derivative)
        return float(sum(self._measure(derivative, term, multiplier, only_product=1).sum() for term in terms))

    def take(self, law: ElasticLaws) -> None:
        """Give all pieces the law of one material."""
        self._modulus[:], self._pieces.pure_number[:] = law.modulus, law.pure_number

    def _measure(
        self, derivative: StepDerivative, term: "ElasticTerm", multiplier: np.ndarray, only_product: int = 0
    ) -> np.ndarray:
        """Fill in the slopes of a term; returns the products."""
        self._start[:], self._known[:], self._change[:] = term.position, term.known, term.velocity - term.known
        self._multiplier[:] = derivative.time_step * multiplier
        scale = (derivative.start.young_modulus / self._rest_modulus)[self._material, None]
        np.multiply(self._modulus, scale, out=self._pieces.modulus)
        of_pieces = self._pieces, self._corotation, self._frames
        moving, change = Movement(self._start, self._known), Movement(self._change, self._multiplier)
        elastic_slopes(*of_pieces, moving, change, float(term.is_elastic), only_product, self._slopes)
        return self._slopes.product


def _selected(pieces: Domains, chosen: np.ndarray) -> Domains:
    sizes, arrays = np.diff(pieces.start), pieces._asdict()
    rows = {name: np.repeat(chosen, sizes) if name in ("node", "gradient") else chosen for name in arrays}
    arrays["start"] = np.append(0, np.cumsum(sizes[chosen])).astype(np.int32)
    return Domains(**{name: one if name == "start" else one[rows[name]] for name, one in arrays.items()})


class ElasticTerm(NamedTuple):
    """A part of the elastic forces of a step, `is_elastic` or of damping alone, where it is linearised.

    Velocities are those before and after the step, or none at its end, not `is_at_start`.
    """

    position: np.ndarray
    known: np.ndarray
    velocity: np.ndarray
    is_at_start: bool = True
    is_elastic: bool = True


def elastic_terms(derivative: StepDerivative) -> list[ElasticTerm]:
    """The elastic forces: linearised at the start of the step, or at its end, damped as at its start."""
    start, velocity = derivative.start, derivative.solution.node_velocity
    if not derivative.is_nonlinear:
        return [ElasticTerm(start.position, derivative.known_velocity, velocity)]
    end, at_rest = start.position + derivative.time_step * velocity, np.zeros_like(velocity)
    damping = ElasticTerm(start.position, start.velocity, velocity, is_elastic=False)
    return [ElasticTerm(end, at_rest, at_rest, is_at_start=False), damping]


def inertia(model: Model, derivative: StepDerivative) -> np.ndarray:
    """What masses are multiplied with in a step [mm/s], shape (node_count, 3)."""
    assert model.elasticity is not None
    start, velocity, drag = derivative.start, derivative.solution.node_velocity, model.elasticity.node_rayleigh_mass
    change: np.ndarray = velocity - start.velocity + derivative.time_step * (drag[:, None] * velocity - start.gravity)
    return change


class CoefficientSlopes:
    """Derivatives by a coefficient of a material's law, with Poisson's ratio as it is: by differences of products."""

    def __init__(self, model: Model, name: str):
        """Change the coefficient by its name in `coefficients`."""
        number, coefficient, body, table = coefficients(model)[name]
        poisson_ratio = body.poisson_ratio if table.poisson_ratio is None else table.poisson_ratio
        given, law = table.coefficients, table.law or body.law
        self._half = COEFFICIENT * max(abs(given[coefficient]), 0.01 * max(abs(value) for value in given.values()))
        sides = [{**given, coefficient: given[coefficient] + change} for change in (self._half, -self._half)]
        self._laws = [elastic_law(law, None, side, poisson_ratio) for side in sides]
        assert model.elasticity is not None
        self._elastic = ElasticSlopes(model, model.elasticity, model.element_material == number)

    def along(self, derivative: StepDerivative, found: Multipliers) -> float:
        """The derivative of what a step makes of a coefficient, with its start as it is."""
        products = []
        for law in self._laws:
            self._elastic.take(law)
            products.append(self._elastic.product(derivative, found.node))
        return -(products[0] - products[1]) / (2.0 * self._half)


def coefficients(model: Model) -> dict[str, tuple[int, str, SoftBodySettings, Any]]:
    """Number of the material, name, body and table of each coefficient, by "c10.finger" or "mu1.finger.regions.0"."""
    tables = [(body.settings, one) for body in model.soft_bodies for one in body.settings.materials]
    return {
        f"{coefficient}.{name}": (number, coefficient, *tables[number])
        for number, name in enumerate(model.material_names)
        for coefficient in tables[number][1].coefficients or {}
    }


class RestSlopes:
    """Derivatives by a number that moves the nodes at rest: by differences of elements and masses, which it shapes."""

    def __init__(self, model: Model, move: np.ndarray):
        """Shape the bodies a little more and a little less by a move [mm per unit], shape (node_count, 3).

        Raises:
            SceneError: the model has cables or embedded surfaces, whose points lie in other elements then, or modes.
        """
        for is_there, what in (
            (model.cables.names, "with cables; take cavities alone"),
            (any(body.modes is not None for body in model.soft_bodies), "of reduced bodies; leave `reduced` out"),
        ):
            if is_there:
                raise SceneError(f"gradient: moves of nodes at rest have no derivative here {what}")
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
        h, start, nodes, elasticity = derivative.time_step, derivative.start, found.node, self._model.elasticity
        assert elasticity is not None
        more, less = (side.product(derivative, nodes) for side in self._sides)
        change = (inertia(self._model, derivative) * nodes).sum(axis=1)
        total = -(more - less) / (2.0 * self._half) - float(self._mass @ change)
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
        touching: whether a contact of the last step has a kink by its start, see `contact_slopes`.
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
        self.touching = False

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
        self.carried[:], self.touching = 0.0, False
        if derivative.contact_count:
            self._add_contacts(derivative, found, slopes)
        derivative.rigid.begin(start)
        return slopes, found

    def _add_soft(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        model, h, velocity = self._model, self._time_step, derivative.solution.node_velocity
        elasticity, nodes = model.elasticity, found.node
        assert elasticity is not None and self._elastic is not None
        mass, stiffness = elasticity.node_mass, elasticity.anchor_stiffness
        held, relative = h * stiffness * nodes, velocity
        by_position, by_known, by_velocity, by_material, by_damping = self._elastic.add(derivative, nodes)
        slopes.position -= by_position + held
        by_start, reduced = mass[:, None] * nodes - by_known, derivative.reduced
        if reduced is not None:
            # Their velocities v' + T Phi w are the nearest ones to those before the step that lead to modes, and more.
            is_reduced, drag = reduced.is_reduced, h * (elasticity.node_rayleigh_mass * mass)[:, None] * nodes
            of_known = found.velocity - by_known - by_velocity - elasticity.anchor_lag[:, None] * held
            of_known = np.where(is_reduced, of_known, 0.0)
            of_modes = mass[:, None] * reduced.node_velocity(reduced.on_unknowns(of_known))
            slopes.position += (of_modes - of_known) / h
            by_start = np.where(is_reduced, of_modes - drag, by_start)
            modal = reduced.node_velocity(reduced.rates(derivative.start.velocity))
            relative = np.where(is_reduced, velocity - derivative.known_velocity + modal, velocity)
        slopes.velocity += by_start
        is_damped = np.array([body.settings.damped_anchors for body in model.soft_bodies])[self._node_body]
        damped = (held * velocity).sum(axis=1) * is_damped
        drag = h * mass * (relative * nodes).sum(axis=1)
        inertial = mass * (inertia(model, derivative) * nodes).sum(axis=1)
        self.by_material -= by_material
        self.by_damping -= by_damping
        for total, part in ((self.by_damping, damped), (self.by_drag, drag), (self.by_density, inertial)):
            total -= np.bincount(self._node_body, part, len(total))

    def _add_actuators(self, derivative: StepDerivative, found: Multipliers, slopes: Slopes) -> None:
        """Loads turn and grow with the bodies, and rows of coordinates with what they are of.

        A row has q + dq/dx w at the place of the linearisation, with the way w from there to the end of the step.
        """
        model, start, solution, h = self._model, derivative.start, derivative.solution, self._time_step
        if not model.actuators.count or model.elasticity is None:
            return
        coordinates, entries = model.actuators.coordinates, np.diff(model.actuators.coordinates.entry_start)
        row = np.zeros(model.actuators.count)
        row[derivative.coordinates] = -found.row[3 * derivative.contact_count :]
        lead = model.elasticity.node_lead[:, None]
        passed = h * solution.node_velocity if derivative.is_nonlinear else lead * start.velocity
        place, bent = start.position + passed, np.zeros_like(slopes.position)
        directions = (found.node, -h * solution.effort), (solution.node_velocity - passed / h, row)
        for direction, weight in directions:
            largest = float(np.abs(direction).max(initial=0.0))
            if not (largest > 0.0 and weight.any()):
                continue
            share = MOVE / largest
            more, less = (self._gradients(start, place + sign * share * direction) for sign in (1.0, -1.0))
            change = 0.5 / share * (more - less)
            np.subtract.at(bent, coordinates.entry_node, np.repeat(weight, entries)[:, None] * change)
        slopes.position += bent
        if not derivative.is_nonlinear:
            slopes.velocity += lead * bent
        here = np.repeat(row / h, entries)[:, None] * self._gradients(start, place)
        np.subtract.at(slopes.position, coordinates.entry_node, here)

    def _gradients(self, start: State, position: np.ndarray) -> np.ndarray:
        ahead = PosesAhead(position, start.rigid_position, start.rigid_rotation)
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

        def turned(way: np.ndarray) -> np.ndarray:
            turn = turn_matrices(way[None])[0]
            return np.array([quaternion_from_matrix(turn @ one) for one in turns])

        for of, width, name, moved in (
            (slopes.rigid_position, MOVE, "rigid_position", start.rigid_position.__add__),
            (slopes.rigid_turn, TURN, "rigid_rotation", turned),
            (slopes.rigid_velocity[:, :3], MOVE, "rigid_velocity", start.rigid_velocity.__add__),
            (slopes.rigid_velocity[:, 3:], SPEED, "rigid_angular_velocity", start.rigid_angular_velocity.__add__),
        ):
            for axis, way in enumerate(width * np.eye(3)):
                sides = []
                for one in (way, -way):
                    rigid.begin(start.changed(**{name: moved(one)}))
                    free = rigid.state.free + np.einsum("bij,bj->bi", rigid.state.inverse_mass, impulse)
                    sides.append((found.rigid * free).sum(axis=1))
                of[:, axis] += (sides[0] - sides[1]) / (2.0 * width)

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
        self.touching = bool(places.touching.any())
        sliding = np.flatnonzero([one.slides for one in derivative.contact_conditions()])
        pairs = derivative.problem.contacts.found.bodies[derivative.contacts[sliding]]
        by_friction = found.condition[3 * sliding + 1] * derivative.impulse[3 * sliding]
        np.subtract.at(self.by_friction, tuple(pairs.T), by_friction)


def _refuse(model: Model) -> None:
    """Raise the error of what has no derivative by the start of a step here."""
    time, actuators = model.scene.time, model.actuators
    elasticity = model.elasticity
    reduced = any(body.modes is not None for body in model.soft_bodies)
    for is_there, what in (
        (time.dynamics != "inertial", f'time.dynamics = "{time.dynamics}"; leave it "inertial"'),
        (time.theta < 1.0, f"time.theta = {time.theta:g}; leave it 1"),
        (reduced and time.newton > 1, f"reduced bodies and time.newton = {time.newton}; leave one of them out"),
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
