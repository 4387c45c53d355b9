"""Checks after each step: divergence, loads out of balance, stretch beyond the range of a law."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.errors import BeyondLaw, SimulationDiverged
from taichisoft.mechanics.domain_elasticity import domain_data, undamped_data
from taichisoft.mechanics.domains import IntegrationDomains
from taichisoft.mechanics.elastic_laws import ElasticLaws
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.mechanics.kernels.domain_deformation import (
    DILATION,
    HOOKE,
    MODULI,
    PURE_NUMBERS,
    SHAPE,
    Domains,
    Movement,
)
from taichisoft.mechanics.kernels.mode_motion import DomainsOfNodes, sample_forces
from taichisoft.mechanics.state import State
from taichisoft.mechanics.strain import Stretches, spread, valid_stretch
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.points_of_step import PointsOfStep
from taichisoft.step.solution import StepReport, StepSolution

if TYPE_CHECKING:
    from taichisoft.mechanics.soft_body_arrays import SoftBody

# How far the full equations of motion of reduced bodies are from being solved, at a sample of their nodes.
#
# Modes and chosen integration domains solve Phi^T r = 0 for the residual r of the full equations. What else r has are
# forces that the modes cannot give way to, or that the chosen domains do not know of. Divided by the stiffness of its
# node alone r is a length, which grows with the error of the motion; how much error goes with it, the validation of a
# reduced model measures (residuals as indicators of error: Drohmann and Carlberg 2015).

SAMPLE = 64
"""Nodes of each body that are always looked at, beside those that something presses."""


class Imbalance:
    """The full equations of the reduced bodies of a model; all of their integration domains are kept for it."""

    def __init__(self, model: "Model"):
        """Lay out the domains of the reduced bodies of a model, which has some."""
        self._model, time = model, model.scene.time
        self._at_end = time.most_linearisations > 1
        first_element = np.cumsum([0, *(len(body.elements) for body in model.soft_bodies)])
        both = zip(model.soft_bodies, first_element, strict=False)
        reduced = [(body, first) for body, first in both if body.modes is not None]
        self._bodies = [body for body, _ in reduced]
        domains = IntegrationDomains.joined([_numbered(body, first) for body, first in reduced])
        has_damping = time.dynamics == "inertial"
        damping = [has_damping * body.settings.rayleigh_stiffness for body in model.soft_bodies]
        lag = np.repeat(time.step + np.array(damping), np.diff(first_element))
        laws = ElasticLaws.joined([body.laws for body in model.soft_bodies])
        self._data = domain_data(domains, laws, lag, np.ones(len(lag)), time.step)
        self._undamped = undamped_data(self._data)
        self._modulus, self._element = self._data.modulus.copy(), domains.element
        counts = np.bincount(domains.node, minlength=model.node_count)
        domain_of_entry = np.repeat(np.arange(len(domains.element)), np.diff(domains.start))
        self._around = DomainsOfNodes(
            start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            entry=np.argsort(domains.node, kind="stable").astype(np.int32),
            domain=domain_of_entry.astype(np.int32),
        )
        first, second = laws.lame[domains.element].T
        trace = 4.0 * second * domains.volume[:, SHAPE] + first * domains.volume[:, DILATION]
        square = (domains.gradient**2).sum(axis=1)
        self._stiffness = np.bincount(domains.node, trace[domain_of_entry] * square / 3.0, model.node_count)
        self._sample = [spread_nodes(body) for body in self._bodies]
        assert model.elasticity is not None
        self._mass = model.elasticity.node_mass[:, None]
        self._drag = model.elasticity.node_rayleigh_mass[:, None]
        self._constant = np.vstack([body.node_force for body in model.soft_bodies])

    def find(
        self, start: "State", end_position: np.ndarray, solution: StepSolution, gradient: np.ndarray
    ) -> dict[str, float]:
        """By body, the largest displacement [mm] that one of the nodes would give way by if all others were held.

        The gradients are those of the actuators' coordinates where the step took them.
        """
        stiffening = (start.young_modulus / self._model.young_modulus)[self._model.element_material]
        np.multiply(self._modulus, stiffening[self._element, None], out=self._data.modulus)
        movement = Movement(start.position, solution.node_velocity)
        at_rest = Movement(end_position, np.zeros_like(end_position))
        loads, found = self._loads(start, solution, gradient), {}
        for one in self._model.external_forces.on_nodes(start):
            loads[one.node] += one.at(end_position if self._at_end else start.position)
        for body, sample in zip(self._bodies, self._sample, strict=True):
            pressed = solution.contact_node_impulse[body.nodes].any(axis=1) & ~body.anchored
            own = np.union1d(sample, np.flatnonzero(pressed))
            node = (own + body.nodes.start).astype(np.int32)
            elastic = self._elastic(node, self._data, movement)
            if self._at_end:  # damped as the first linearisation is
                elastic += self._elastic(node, self._undamped, at_rest) - self._elastic(node, self._undamped, movement)
            lacking = np.linalg.norm(elastic + loads[node], axis=1)
            found[body.name] = float((lacking / self._stiffness[node]).max())
        return found

    def _loads(self, start: "State", solution: StepSolution, gradient: np.ndarray) -> np.ndarray:
        """All other forces on the nodes, less the change of their momentum [mN], shape (node_count, 3)."""
        coordinates, time = self._model.actuators.coordinates, self._model.scene.time
        effort = np.repeat(solution.effort, np.diff(coordinates.entry_start))
        parts = [np.bincount(coordinates.entry_node, effort * one, self._model.node_count) for one in gradient.T]
        rate = velocity = solution.node_velocity
        if time.dynamics == "inertial":
            rate = (velocity - start.velocity) / time.step + self._drag * velocity
        elif time.dynamics == "static":
            rate = np.zeros_like(velocity)
        loads: np.ndarray = self._constant + np.column_stack(parts) + solution.contact_node_impulse / time.step
        return loads + self._mass * (start.gravity - rate)

    def _elastic(self, node: np.ndarray, data: Domains, movement: Movement) -> np.ndarray:
        force = np.empty((len(node), 3))
        sample_forces(node, self._around, data, movement, force)
        return force


def _numbered(body: "SoftBody", first_element: int) -> IntegrationDomains:
    own = body.mesh_domains
    node, element = own.node + body.nodes.start, own.element + first_element
    return IntegrationDomains(own.start, node, own.gradient, own.volume, element)


def spread_nodes(body: "SoftBody") -> np.ndarray:
    """Some nodes that are not held, each as far as possible from those before it, in rising order."""
    free = np.flatnonzero(~body.anchored)
    place, chosen = body.mesh.nodes[free], [0]
    distance = np.full(len(free), np.inf)
    while len(chosen) < min(SAMPLE, len(free)):
        distance = np.minimum(distance, np.linalg.norm(place - place[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return np.sort(free[chosen])


# Checks for stretches beyond the range of a body's law, in steps, in equilibria, and at the end of a run.

EVERY = 20
"""Steps between two checks: a check takes about as long as a step without contact."""
FAR_BEYOND = 2.0
"""A run is beyond a law if 1 % of a body's elements are stretched by more than this multiple of the law's range. At a
stretch of 2.4 rubber has 0.53 of the force of Hooke's law; shipped scenes reach 1.57 under Hooke's law, and 1.40 under
a fitted law with range 3."""
FARTHEST_BEYOND = 4.0
"""The multiple for a single element: at a sharp corner it may be stretched more than twice as far as all others."""


class StrainWatch:
    """Measures the stretches of all soft bodies when it is asked, and keeps the largest."""

    def __init__(self, model: Model):
        """Prepare; without soft bodies there is nothing to do."""
        self._bodies = model.soft_bodies
        self._ranges = [valid_stretch(body.settings) for body in self._bodies]
        self._waiting = True
        self.restart()

    @cached_property
    def _stretches(self) -> list[Stretches]:
        return [Stretches(body.rest_position, body.elements) for body in self._bodies]

    def restart(self, is_new_run: bool = False) -> None:
        """Forget the largest stretches when a run restarts; in a new run say again what is beyond a law."""
        self._found = [(1.0, 1.0) for _ in self._bodies]
        self._waiting = self._waiting or is_new_run

    def over_law(self, state: State) -> dict[str, float]:
        """By soft body: largest stretch of an element, over that up to which its law holds [-]; 0 of a law without."""
        return {
            body.name: float(stretches.largest(state.position[body.nodes]).max()) / limit
            for body, stretches, (limit, _) in zip(self._bodies, self._stretches, self._ranges, strict=True)
        }

    def complaint(self, state: State) -> str | None:
        """Line for the first state with a body beyond the range of its law, else None."""
        lines = [self._measure_stretches(number, state) for number in range(len(self._bodies))]
        line = next((line for line in lines if line is not None), None)
        if line is None or not self._waiting:
            return None
        self._waiting = False
        return line

    def judge(self, state: State, report: StepReport | None) -> None:
        """Check the last state of a run, and refuse the run if a body was stretched far beyond its law."""
        for number, body in enumerate(self._bodies):
            self._measure_stretches(number, state)
            (largest, most), (limit, law) = self._found[number], self._ranges[number]
            if largest > FARTHEST_BEYOND * limit or most > FAR_BEYOND * limit:
                raise BeyondLaw(
                    f"beyond the law: '{body.name}' was stretched {largest:.2f}-fold, 1 % of its elements at least "
                    f"{most:.2f}-fold, where {law} holds up to {limit:g}: the result is not physical; "
                    "try a lower pressure or thicker walls"
                )
        if report is not None and report.inverted_elements:
            raise BeyondLaw(
                f"beyond the law: {report.inverted_elements} elements are inverted at the end: the result is not "
                "physical; try a smaller time.step, time.newton = 20, a lower pressure, or a finer mesh"
            )

    def _measure_stretches(self, number: int, state: State) -> str | None:
        """Update the largest stretches of a body; returns a warning if one is beyond the range of its law."""
        body, stretches = self._bodies[number], self._stretches[number]
        position = state.position[body.nodes]
        found = stretches.largest(position)
        largest, most = spread(found)
        before = self._found[number]
        self._found[number] = max(largest, before[0]), max(most, before[1])
        limit, law = self._ranges[number]
        if largest <= limit:
            return None
        x, y, z = position[stretches.tetrahedra[int(np.argmax(found))]].mean(axis=0)
        return (
            f"'{body.name}' is stretched {largest:.2f}-fold at ({x:.1f}, {y:.1f}, {z:.1f}) mm at "
            f"{state.time:.2f} s, and {law} holds up to {limit:g}: beyond it, forces are not realistic; "
            "metrics.json of a run has the largest stretch"
        )


# Checks for a diverged simulation after each step.

# Single inverted elements under Hooke's law may recover; a body with more than this fraction of them will not.
INVERTED_SHARE = 0.25
# Largest move of a point in a step, in sizes of its body, unless its velocity led there: a small body in free fall
# reaches it gradually, an exploding body at once.
LARGEST_MOVE = 10.0
LARGEST_TURN = 100.0
"""Largest turn of a rigid body in a step [rad], on which contacts can still be found in a reasonable time."""

NO_DOMAINS = Domains(
    start=np.zeros(1, dtype=np.int32),
    node=np.zeros(0, dtype=np.int32),
    gradient=np.zeros((0, 3)),
    volume=np.zeros((0, 2)),
    law=np.zeros(0, dtype=np.int32),
    modulus=np.zeros((0, MODULI)),
    pure_number=np.zeros((0, PURE_NUMBERS)),
    lag=np.zeros(0),
    factor=np.zeros(0),
    undamped=np.zeros(0),
)

ADVICE = "a smaller time.step, a lower pressure or pressure rate, or a finer mesh"
CRUSHED = (
    "frames that stop where rigid bodies touch what they carry, since nothing gives way there, or a smaller time.step"
)
# One linearisation misses the change of volume by t^2 in a rotation by t per step: fast, nearly incompressible rubber
# gets pressures of lambda t^2 and explodes.
RUBBER_ADVICE = "a smaller time.step, time.newton = 20, a lower pressure or pressure rate, or a finer mesh"


class DivergenceCheck:
    """Compares the states before and after a step: nodes of soft bodies, centres of rigid bodies.

    Attributes:
        inverted: number of inverted elements of all soft bodies after the step.
    """

    def __init__(self, model: Model, points: PointsOfStep):
        soft, rigid, self._of_step = model.soft_bodies, model.rigid_bodies, points
        self._bodies = soft
        self._time_step = model.scene.time.step
        self._actuators = model.actuators
        self._advice = [ADVICE if (body.laws.kind == HOOKE).all() else RUBBER_ADVICE for body in soft]
        self._names = [*(body.name for body in soft), *(body.name for body in rigid)]
        # What frames press together gives way to nothing.
        crushed = CRUSHED if any(body.follows is not None for body in rigid) else ADVICE
        self._advice += [crushed] * len(rigid)
        shapes = [*(body.rest_position for body in soft), *(body.vertices for body in rigid)]
        self._furthest = LARGEST_MOVE * np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        starts = [*(body.nodes.start for body in soft), *(model.node_count + np.arange(len(rigid) + 1))]
        largest, body_start = np.empty(len(shapes)), np.array(starts, dtype=np.int32)
        self._points = kernels.Points(points.before, points.velocity, points.after, body_start, largest)
        counts = [len(body.elements) for body in soft]
        # Laws of rubber can restore inverted elements, however many.
        follows_hooke = np.array([bool((body.laws.kind == HOOKE).any()) for body in soft])
        self._largest_inverted = np.where(follows_hooke, INVERTED_SHARE, 1.0) * np.array(counts)
        self.inverted = 0
        self._element_counts = counts
        if model.elasticity is not None:
            self._domains, first_point = _integration_points(model.elasticity, [body.elements.shape for body in soft])
            self._inverted = kernels.InvertedElements(
                elements=model.elasticity.elements,
                first_point=first_point,
                body_start=np.cumsum([0, *counts]).astype(np.int32),
                count=np.zeros(len(soft), dtype=np.int32),
            )

    def check(self, before: State, after: State) -> None:
        """Compare the states of a step."""
        step = before.step
        self._refuse_not_finite(after.rigid_rotation, step, len(self._bodies))
        self._of_step.begin(before)
        self._of_step.end(after.position, after.rigid_position)
        self._refuse_not_finite(self._points.after, step)
        self._check_leaps(step)
        self._check_turns(after.rigid_angular_velocity, step)
        if self._bodies:
            self._check_inverted(before, step)
        self._check_actuators(after.actuator_value, step)
        if not np.isfinite(after.air_mass.sum() + after.network_air_mass.sum()):
            raise SimulationDiverged(
                self._names[0], step, "has air without a pressure", "lower pressures of its supply"
            )

    def is_torn(self, position: np.ndarray) -> bool:
        """Whether `check` would find too many elements inverted, with nodes at positions [mm], (node_count, 3)."""
        if not self._bodies or not np.isfinite(position).all():
            return bool(self._bodies)
        self._of_step.end(position)
        kernels.count_inverted(self._inverted, self._domains, self._points.after)
        return bool((self._inverted.count > self._largest_inverted).any())

    def _refuse_not_finite(self, values: np.ndarray, step: int, first_body: int = 0) -> None:
        """Raise SimulationDiverged for the first body with a value that is not finite; a row belongs to each point."""
        if np.isfinite(np.add.reduce(values, axis=None)):  # not finite if any value is not
            return
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            point = self._points.body_start[first_body] + np.argmin(finite)
            body = int(np.searchsorted(self._points.body_start, point, side="right")) - 1
            raise SimulationDiverged(self._names[body], step, "has a position that is not finite", self._advice[body])

    def _check_leaps(self, step: int) -> None:
        points = self._points
        kernels.largest_leaps(self._time_step, points)
        leaps = points.largest > self._furthest
        if np.count_nonzero(leaps):
            body = int(np.argmax(leaps))
            some = slice(points.body_start[body], points.body_start[body + 1])
            move = np.abs(points.after[some] - points.before[some]).max()
            cause = f"exploded: it would move {move:.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
            raise SimulationDiverged(self._names[body], step, cause, self._advice[body])

    def _check_turns(self, angular_velocity: np.ndarray, step: int) -> None:
        turn = self._time_step * np.abs(angular_velocity).max(axis=1, initial=0.0)
        if np.count_nonzero(turn > LARGEST_TURN):
            number = int(turn.argmax())
            cause = f"exploded: it would turn by {turn[number]:.3g} rad in one step, over {LARGEST_TURN:g}"
            raise SimulationDiverged(self._names[len(self._bodies) + number], step, cause, "a smaller torque")

    def _check_actuators(self, value: np.ndarray, step: int) -> None:
        failure = self._actuators.failure(value)
        if failure is not None:
            name, cause, advice = failure
            raise SimulationDiverged(name.partition(".")[0], step, cause, advice)

    def _check_inverted(self, before: State, step: int) -> None:
        kernels.count_inverted(self._inverted, self._domains, self._points.after)
        self.inverted = int(np.add.reduce(self._inverted.count))
        bad = self._inverted.count > self._largest_inverted
        if np.count_nonzero(bad):
            body = int(np.argmax(bad))
            count = f"{self._inverted.count[body]} of {self._element_counts[body]}"
            cause = f"has {count} elements turned inside out{self._beyond_its_law(body, before)}"
            raise SimulationDiverged(self._names[body], step, cause, self._advice[body])

    def _beyond_its_law(self, number: int, state: State) -> str:
        """Note for the message, if the body was stretched beyond the range of its law before the step."""
        body = self._bodies[number]
        found = Stretches(body.rest_position, body.elements).largest(state.position[body.nodes]).max()
        limit, law = valid_stretch(body.settings)
        return f" after being stretched {found:.2f}-fold, where {law} holds up to {limit:g}" if found > limit else ""


def _integration_points(elasticity: Elasticity, shapes: Sequence[tuple[int, ...]]) -> tuple[Domains, np.ndarray]:
    """Integration domains, and first domain of each quadratic element (-1 for others), for bodies of these shapes."""
    quadratic = np.repeat([nodes == 10 for _, nodes in shapes], [count for count, _ in shapes])
    first_point = np.full(len(quadratic), -1, dtype=np.int32)
    if elasticity.domains is None:
        return NO_DOMAINS, first_point
    element = elasticity.domains.domains.element
    some = np.flatnonzero(quadratic[element])[:: kernels.POINTS]
    first_point[element[some]] = some
    return elasticity.domains.data, first_point
