"""Whether an equilibrium is stable: its least stiffness, with contacts and actuators as they act."""

from dataclasses import dataclass

import numpy as np

from taichisoft.model import Model
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.nonlinear_step import NonlinearStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.row_conditions import find_conditions, find_jacobians
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import StepProblem, StepSolution

NEUTRAL = 1e-3
"""Stiffness over that of the linearisation below which it counts as 0 [-]: what differences of forces can tell."""
CERTAIN = 0.1
"""Change of the least stiffness by another direction, over it, at which the search ends [-]."""
FEWEST, MOST_DIRECTIONS = 3, 40
"""Directions of a search: fewest, for the first ones hardly tell, and most."""
SMALL_MOVE = 1e-4
"""Largest move of a node in a difference of forces [mm]."""
FIRST_WAY = 1e-2
"""Shortest way by which an unstable equilibrium is left [mm]."""


@dataclass(frozen=True)
class Softest:
    """The small move of the bodies that least resist it.

    Attributes:
        stiffness: of the move, over that of the linearisation, which is positive definite [-]: 1 at rest without loads,
            0 where an equilibrium becomes unstable, negative beyond.
        rates: of the unknowns and the rigid bodies, where the fastest node or centre of mass has 1 mm/s.
        node_velocity, rigid_velocity: the same of all nodes, shape (node_count, 3), and of bodies, (rigid_count, 6).
        impulse: that the linearisation makes of it on the unknowns, shape (node_count, 3).
    """

    stiffness: float
    rates: np.ndarray
    node_velocity: np.ndarray
    rigid_velocity: np.ndarray
    impulse: np.ndarray


@dataclass(frozen=True)
class _Move:
    """Rates of unknowns and rigid bodies in one array, impulses that the matrix makes of it, with and without rows."""

    rates: np.ndarray
    impulse: np.ndarray
    cause: np.ndarray

    def less(self, other: "_Move", share: float) -> "_Move":
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return _Move(*(one - share * two for one, two in pairs))

    def over(self, size: float) -> "_Move":
        return _Move(*(one / size for one in vars(self).values()))


class StabilityCheck:
    """Finds the least stiffness of the end of a static step.

    The slope T of all forces and the linearisation's matrix A, which is positive definite, have a least ratio
    x^T T x / x^T A x over the moves x that contacts and actuators allow: contacts that press stay closed, those that
    stick do not slide, those at the limit of friction do, against the friction that they have, and open ones stay open;
    efforts stay, or coordinates where these are imposed. It is negative just where a small move lets the forces grow
    that drive it. A^-1 (A - T) has the outermost eigenvalue 1 less that ratio. It is found by Arnoldi's method
    (Saad 1992, Numerical methods for large eigenvalue problems, ch. 6), with products T x as differences of forces.
    """

    def __init__(
        self,
        model: Model,
        soft: SoftMotion,
        rigid: RigidMotion,
        constraint_solver: ConstraintSolver,
        nonlinear: NonlinearStep,
        problem: StepProblem,
        solution: StepSolution,
    ):
        """Check the step whose `problem` the solvers have just solved."""
        self._model, self._soft, self._rigid, self._nonlinear = model, soft, rigid, nonlinear
        self._problem, self._solution = problem, solution
        self._node_count, self._rigid_count = model.node_count, len(model.rigid_bodies)
        self._rest = self._forces(np.zeros(3 * self._node_count + 6 * self._rigid_count), 0.0)
        rows = constraint_solver.rows
        contacts, count = rows.rows.contact[: rows.contact_count], 3 * rows.contact_count
        of_soft, of_rigid = find_jacobians(
            rows, model.actuators.coordinates, nonlinear.geometry.gradient, self._node_count, self._rigid_count
        )
        basis = rows.rows.basis[: rows.contact_count]
        local = np.einsum("cij,cj->ci", basis, solution.contact_impulse[contacts]).ravel()
        impulse = np.concatenate([local, solution.effort[problem.requests.coordinates] * model.scene.time.step])
        friction = rows.rows.friction[: rows.contact_count]
        conditions = find_conditions(friction, problem.requests.bounds, impulse, np.zeros_like(impulse))
        is_held = (np.diag(conditions.of_velocity) == 1.0) & ~conditions.of_impulse.any(axis=1)
        is_held[2:count:3] = is_held[1:count:3]  # one that slides has conditions of its friction, here a constant force
        held = np.flatnonzero(is_held)
        self._of_soft, self._of_rigid = of_soft[held], of_rigid[held]
        self._mass, self._mobility = rigid.weightless()
        compliance = rows.compliance[: rows.row_count**2].reshape(rows.row_count, rows.row_count)[np.ix_(held, held)]
        of_bodies, more = (
            self._of_rigid.reshape(len(held), self._rigid_count, 6),
            self._mobility - rigid.state.inverse_mass,
        )
        compliance = compliance + np.einsum("rbi,bij,sbj->rs", of_bodies, more, of_bodies)
        # Impulses between rigid bodies may be undetermined; their motion is not.
        self._inverse = np.linalg.pinv(compliance, rcond=1e-13, hermitian=True)

    def softest(self, before: np.ndarray | None = None) -> Softest:
        """The move with the least stiffness; of several that are alike the one that leads to where nodes came from.

        Args:
            before: from here to there [mm], shape (node_count, 3).
        """
        size = 3 * self._node_count + 6 * self._rigid_count
        # Bodies and loads are often symmetric, and what they do not push at must be seen as well.
        cause = np.random.default_rng(0).standard_normal(size)
        if before is not None:
            cause = np.append(before.ravel(), np.zeros(6 * self._rigid_count))
        soft = self._soft.on_unknowns(cause[: 3 * self._node_count].reshape(-1, 3)).ravel()
        move = self._solve(np.concatenate([soft, cause[3 * self._node_count :]]))
        move = self._solve(move.rates)
        ratios = np.zeros((MOST_DIRECTIONS + 1, MOST_DIRECTIONS))
        basis, last = [move.over(_size(move))], np.inf
        while True:
            cause = self._excess(basis[-1])
            column = np.array([one.rates @ cause for one in basis])
            move = self._solve(cause)
            for one, share in zip(basis, column, strict=True):
                move = move.less(one, share)
            count, beyond = len(basis), _size(move)
            ratios[:count, count - 1] = column
            values, vectors = np.linalg.eig(ratios[:count, :count])
            top = int(values.real.argmax())
            shares, stiffness = vectors[:, top].real, 1.0 - float(values[top].real)
            settled = abs(stiffness - last) <= CERTAIN * max(abs(stiffness), NEUTRAL)
            if (count >= FEWEST and settled) or count == MOST_DIRECTIONS or beyond <= 1e-12:
                break
            last, ratios[count, count - 1] = stiffness, beyond
            basis.append(move.over(beyond))
        rates = np.array([one.rates for one in basis]).T @ shares
        impulse = np.array([one.impulse for one in basis]).T @ shares
        nodes, bodies = self._velocities(rates)
        fastest = max(float(np.linalg.norm(part, axis=1).max(initial=0.0)) for part in (nodes, bodies[:, :3]))
        rates, impulse, nodes, bodies = (part / fastest for part in (rates, impulse, nodes, bodies))
        return Softest(stiffness, rates, nodes, bodies, impulse[: nodes.size].reshape(-1, 3))

    def way_off(self, softest: Softest, before: np.ndarray, longest: float) -> float:
        """How far along an unstable move forces drive the bodies [mm], to a factor of 2; negative on its other side.

        Args:
            softest: the move.
            before: from the equilibrium to where the nodes came from [mm], (node_count, 3); the way leads to that side.
            longest: most of the way [mm].
        """
        rates, time_step = softest.rates, self._model.scene.time.step
        towards = self._soft.rates(before).ravel()
        side = float(towards @ softest.impulse.ravel()) / float(rates[: towards.size] @ softest.impulse.ravel())
        if abs(side) < self._nonlinear.tolerance:  # nothing tells it
            side = softest.node_velocity.flat[np.abs(softest.node_velocity).argmax()]
        way = float(np.copysign(min(FIRST_WAY, longest), side))
        while (
            abs(2.0 * way) <= longest
            and way * ((self._forces(rates, 2.0 * way / time_step) - self._rest) @ rates) > 0.0
        ):
            way *= 2.0
        return way

    def _solve(self, cause: np.ndarray) -> _Move:
        """The move by impulses on unknowns and rigid bodies, with the rows held."""
        impulse = cause
        if len(self._inverse):
            nodes, bodies = self._velocities(self._response(cause))
            multiplier = -self._inverse @ (self._of_soft @ nodes.ravel() + self._of_rigid @ bodies.ravel())
            on_nodes = self._soft.on_unknowns((self._of_soft.T @ multiplier).reshape(-1, 3)).ravel()
            impulse = cause + np.concatenate([on_nodes, self._of_rigid.T @ multiplier])
        return _Move(self._response(impulse), impulse, cause)

    def _response(self, impulse: np.ndarray) -> np.ndarray:
        soft, rigid = np.split(impulse, [3 * self._node_count])
        moved = self._soft.system.solver.solve(soft.reshape(-1, 3)).ravel()
        return np.concatenate([moved, np.einsum("bij,bj->bi", self._mobility, rigid.reshape(-1, 6)).ravel()])

    def _velocities(self, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        soft, rigid = np.split(rates, [3 * self._node_count])
        return self._soft.expanded(soft.reshape(-1, 3)), rigid.reshape(-1, 6)

    def _excess(self, move: _Move) -> np.ndarray:
        """(A - T) x."""
        nodes, bodies = self._velocities(move.rates)
        fastest = max(np.abs(nodes).max(initial=0.0), np.abs(bodies).max(initial=0.0))
        share = SMALL_MOVE / (fastest * self._model.scene.time.step)
        slope = (self._forces(move.rates, share) - self._rest) / share
        if self._soft.system.reduced is None:
            slope[: nodes.size] -= self._nonlinear.equations.anchored_product(nodes).ravel()
        slope[: nodes.size] += move.impulse[: nodes.size]
        slope[nodes.size :] += np.einsum("bij,bj->bi", self._mass, bodies).ravel()
        return slope

    def _forces(self, rates: np.ndarray, share: float) -> np.ndarray:
        """Impulses by all forces but contacts where a share of a move leads; the anchors' springs are left out,
        whose round-off would be all that is seen."""
        nodes, bodies = self._velocities(share * rates)
        solution, coordinates = self._solution, self._model.actuators.coordinates
        poses = self._rigid.end_poses(solution.rigid_velocity + bodies)
        equations = self._nonlinear.equations
        equations.move(solution.node_velocity + nodes, *poses)
        on_rigid = np.zeros((self._rigid_count, 6))
        pulls = np.repeat(solution.effort, np.diff(coordinates.rigid_start))[:, None]
        gradient = self._nonlinear.geometry.gradient.rigid
        np.add.at(on_rigid, coordinates.rigid_body, self._model.scene.time.step * pulls * gradient)
        on_soft = equations.residual(solution.effort, with_anchors=self._soft.system.reduced is not None)
        return np.concatenate([on_soft.ravel(), on_rigid.ravel()])


def _size(move: _Move) -> float:
    return float(np.sqrt(max(move.rates @ move.cause, 1e-300)))
