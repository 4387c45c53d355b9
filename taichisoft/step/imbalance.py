"""How far the full equations of motion of reduced bodies are from being solved, at a sample of their nodes.

Modes and chosen integration domains solve Phi^T r = 0 for the residual r of the full equations. What else r has are
forces that the modes cannot give way to, or that the chosen domains do not know of. Divided by the stiffness of its
node alone r is a length, which grows with the error of the motion; how much error goes with it, the validation of a
reduced model measures (residuals as indicators of error: Drohmann and Carlberg 2015).
"""

from typing import TYPE_CHECKING

import numpy as np

from taichisoft.bodies.domain_elasticity import domain_data, undamped_data
from taichisoft.bodies.domains import IntegrationDomains
from taichisoft.bodies.elastic_laws import ElasticLaws
from taichisoft.bodies.kernels.domain_deformation import DILATION, SHAPE, Domains, Movement
from taichisoft.bodies.kernels.sampled_forces import DomainsOfNodes, sample_forces
from taichisoft.step.solution import StepSolution

if TYPE_CHECKING:
    from taichisoft.bodies.soft_body_arrays import SoftBody
    from taichisoft.model import Model
    from taichisoft.state import State

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
        """By body, the largest way [mm] by which one of the nodes would give if all others were held.

        Args:
            start: state at the start of the step.
            end_position: positions of the nodes at its end [mm], shape (node_count, 3).
            solution: the solution of the step.
            gradient: of the actuators' coordinates where the step took them, shape (entry_count, 3).
        """
        stiffening = (start.young_modulus / self._model.young_modulus)[self._model.element_material]
        np.multiply(self._modulus, stiffening[self._element, None], out=self._data.modulus)
        movement = Movement(start.position, solution.node_velocity)
        at_rest = Movement(end_position, np.zeros_like(end_position))
        loads, found = self._loads(start, solution, gradient), {}
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
    """All domains of a body, with nodes and elements numbered as in the whole model."""
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
