"""Search for an equilibrium, and whether it is stable."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.errors import EquilibriumNotFound, SimulationDiverged
from taichisoft.mechanics.state import State
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.nonlinear_step import NonlinearStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.row_conditions import find_conditions, find_jacobians
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import StepProblem, StepReport, StepSolution

# Whether an equilibrium is stable: its least stiffness, with contacts and actuators as they act.

NEUTRAL = 1e-3
"""Stiffness over that of the linearisation below which it counts as 0 [-]: what differences of forces can tell."""
CERTAIN = 0.1
"""Change of the least stiffness by another direction, over it, at which the search ends [-]."""
FEWEST, MOST_DIRECTIONS = 3, 40
"""Directions of a search: fewest, for the first ones hardly tell, and most."""
SMALL_MOVE = 1e-4
"""Largest move of a node in a difference of forces [mm]."""
FIRST_MOVE = 1e-2
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

        `before` leads from here to there [mm], shape (node_count, 3).
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

    def distance_off(self, softest: Softest, before: np.ndarray, longest: float) -> float:
        """How far along an unstable move forces drive the bodies [mm], to a factor of 2; negative on its other side.

        It leads to the side where the nodes came from, `before` [mm], shape (node_count, 3), and no farther than
        `longest`.
        """
        rates, time_step = softest.rates, self._model.scene.time.step
        towards = self._soft.rates(before).ravel()
        side = float(towards @ softest.impulse.ravel()) / float(rates[: towards.size] @ softest.impulse.ravel())
        if abs(side) < self._nonlinear.tolerance:  # nothing tells it
            side = softest.node_velocity.flat[np.abs(softest.node_velocity).argmax()]
        displacement = float(np.copysign(min(FIRST_MOVE, longest), side))
        while (
            abs(2.0 * displacement) <= longest
            and displacement * ((self._forces(rates, 2.0 * displacement / time_step) - self._rest) @ rates) > 0.0
        ):
            displacement *= 2.0
        return displacement

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


# Search for an equilibrium: static steps with growing loads, then moves until nothing moves any more.

SMALLEST_INCREMENT = 2.0**-8
"""Smallest part of the change of the loads that is tried at once [-]."""
MOST_UNSOLVED = 6
"""Most increments that stay unsolved: near loads that cannot be carried each takes hundreds of linearisations."""
MOST_SETTLING = 100
"""Most moves from a start at which the bodies do not rest."""
STILL, MOST_MOVES = 1e-6, 300
"""Way in a move below which rigid bodies count as at rest [mm], and most moves."""
MOST_SEARCHES = 40
"""Most searches for contacts at the end: each moves the bodies to where the last one would have them touch."""
SWINGS, SHORTEST = 0.5, 0.1
"""Length of a move over that of the last above which bodies make only a part of it, and the smallest part [-]."""
CONFIGURATION = (
    *("position", "rigid_position", "rigid_rotation", "frame_wrench"),
    *("actuator_effort", "actuator_value", "actuator_loss"),
    *("contact_body_pair", "contact_point", "contact_normal", "contact_impulse", "contact_slip"),
)
"""What of a state moves change; the rest are requests, and the air at the start."""

ROUGH = 1e-3
"""Newton's tolerance of moves that others follow [mm]."""
FINER = 0.03
"""Newton's tolerance of a move, over the length of the last (inexact Newton: Dembo, Eisenstat and Steihaug 1982)."""

UNMIXED = (10, 40, 400)
"""Linearisations without Anderson's mixing away from an unstable equilibrium, in one trial after the other."""

Move = Callable[[State, float, int], tuple[State, StepReport]]
"""Makes a static step from a state with its loads, to a tolerance of Newton's method [mm], with so many linearisations
before Anderson's mixing."""
Check = Callable[[State], StabilityCheck | None]
"""Prepares to check the equilibrium where the last move has ended; None of rigid bodies alone."""


@dataclass(frozen=True)
class FoundEquilibrium:
    """What a search found.

    Attributes:
        state: the state at rest, at the end of a time step.
        report: that of the last move, with the linearisations of all.
        increments: number of parts in which the loads were changed.
        residual: largest move of a node by another linearisation, or by another move [mm].
        stiffness: least stiffness of a small move, see `Softest`; negative: unstable; None of rigid bodies alone.
        left: that of the unstable equilibrium that the bodies have left, or None.
        unchecked: free rigid bodies that something presses: their stability is not known, see `Equilibrium.unchecked`.
        restless: by how much a last search for contacts has moved which body, if that is too much to be at rest.
    """

    state: State
    report: StepReport
    increments: int
    residual: float
    stiffness: float | None = None
    left: float | None = None
    restless: str = ""
    unchecked: tuple[str, ...] = ()

    @property
    def warning(self) -> str:
        """Line on its stability and its contacts, or nothing."""
        when = f"at {self.state.time:.6g} s the equilibrium"
        restless = f"{when} is not one: another search for contacts {self.restless}" if self.restless else ""
        return "; ".join(filter(None, (restless, self._instability(when))))

    def _instability(self, when: str) -> str:
        if self.stiffness is not None and self.stiffness <= -NEUTRAL:
            return f"{when} is unstable (stiffness {self.stiffness:.2g} of that without loads): no motion ends in it"
        if self.left is not None:
            least = f"stiffness {self.left:.2g} of that without loads"
            return f"{when} near the start is unstable ({least}): bodies have gone on to a stable one"
        return ""


class EquilibriumSearch:
    """Finds equilibria of a model of static dynamics; see `taichisoft.equilibrium`."""

    def __init__(self, model: Model, move: Move, check: Check):
        """Prepare for a model whose static steps `move` makes, and whose equilibria `check` checks."""
        self._move, self._check = move, check
        self._contact, self._time = model.scene.contact, model.scene.time
        self._soft = [(body.name, body.nodes) for body in model.soft_bodies]
        self._rigid = [body.name for body in model.rigid_bodies]
        self._radius = np.array([body.radius for body in model.rigid_bodies])
        self._is_free = model.rigid_frame < 0
        self._has_free = bool(self._is_free.any())
        self._may_touch = bool(model.surfaces.may_touch.any())
        self._model = model

    def find(self, start: State, requested: State, stable: bool = True) -> FoundEquilibrium:
        """The equilibrium of the bodies of a state with the requests of another; an unstable one is left if it must be
        `stable`.
        """
        loads = _Loads(self._model, start, requested)
        found, left = self._approach(loads, start), None
        for unmixed in (*UNMIXED, 0):
            check = self._check(found.state)
            if check is None:
                break
            softest = check.softest()
            found = replace(found, stiffness=softest.stiffness, left=left)
            if softest.stiffness > -NEUTRAL or not stable or not unmixed:
                break
            left = softest.stiffness if left is None else left
            pushed = self._pushed(found.state, check, softest, start)
            state, linearisations, problem = self._settled(loads, pushed, 1.0, unmixed)
            if problem:
                raise EquilibriumNotFound(
                    problem[0],
                    start.step,
                    f"has no stable equilibrium near at {start.time:.6g} s, only an unstable one: {problem[1]}",
                    "smaller loads, or a motion with inertia",
                )
            linearisations += found.report.linearisations
            found = self._at_rest(loads, replace(found, state=state), linearisations, self._time.newton_tolerance, 1)
        return replace(found, unchecked=self._unchecked(found.state))

    def _unchecked(self, state: State) -> tuple[str, ...]:
        """Free rigid bodies that something presses."""
        pressed = np.unique(state.contact_body_pair[state.contact_impulse.any(axis=1)]) - len(self._soft)
        return tuple(name for number, name in enumerate(self._rigid) if self._is_free[number] and number in pressed)

    def _pushed(self, state: State, check: StabilityCheck, softest: Softest, start: State) -> State:
        """Bodies a little way from an unstable equilibrium, on the side from which they came."""
        longest = 0.5 * self._contact.contact_distance if self._may_touch else np.inf
        before = start.position - state.position
        nearer = check.softest(before) if before.any() else softest
        softest = nearer if nearer.stiffness < -NEUTRAL else softest
        displacement = check.distance_off(softest, before, longest)
        return state.changed(
            position=state.position + displacement * softest.node_velocity,
            rigid_position=state.rigid_position + displacement * softest.rigid_velocity[:, :3],
        )

    def _approach(self, loads: "_Loads", start: State) -> FoundEquilibrium:
        """An equilibrium, stable or not."""
        state, share, increment, increments, linearisations, residual = start, 0.0, 1.0, 0, 0, 0.0
        finest = self._time.newton_tolerance
        unsolved = 0
        is_settled, tolerance = False, max(finest, ROUGH) if self._has_free else finest
        while share < 1.0:
            aim = min(1.0, share + increment)
            # Where nothing touches, intermediate states leave no trace.
            accuracy = tolerance if aim == 1.0 or self._may_touch else max(finest, ROUGH)
            body = problem = ""
            try:
                with np.errstate(over="ignore", invalid="ignore"):  # an end that is not finite is refused below
                    end, report = self._move(loads.at(state, aim), accuracy, 0)
                linearisations += report.linearisations
                residual = report.newton_residual or 0.0
                body, problem = self._problem(state, end, report, accuracy)
            except SimulationDiverged as error:
                body, problem = error.body, error.cause
            if not problem:
                state, share, increment, increments = end, aim, 2.0 * increment, increments + 1
                continue
            increment, unsolved = 0.5 * increment, unsolved + problem.startswith("not solved")
            is_last = increment < SMALLEST_INCREMENT or unsolved == MOST_UNSOLVED
            if is_last and share == 0.0 and not is_settled:
                state, more, _ = self._settled(loads, state, 0.0, 0)
                is_settled, increment, unsolved, linearisations = True, 1.0, 0, linearisations + more
            elif is_last:
                raise EquilibriumNotFound(
                    body,
                    start.step,
                    f"has no equilibrium at {start.time:.6g} s, beyond {share:.1%} of the change of loads: {problem}",
                    "smaller loads, or begin nearer to rest",
                )
        found = FoundEquilibrium(state, report, increments, residual)
        return self._at_rest(loads, found, linearisations, tolerance)

    def _at_rest(
        self, loads: "_Loads", found: FoundEquilibrium, linearisations: int, tolerance: float, fewest: int = 0
    ) -> FoundEquilibrium:
        """An equilibrium that moves do not leave, after so many linearisations to a tolerance."""
        state, report, residual = found.state, found.report, found.residual
        finest = self._time.newton_tolerance
        still = STILL if self._has_free else finest
        relaxation, displacement, restless = _Relaxation(0.5 * self._contact.alarm_distance), 0.0, ""
        for _ in range(MOST_MOVES if self._has_free else MOST_SEARCHES if len(state.contact_point) else fewest):
            before = state
            state, report = self._move(loads.at(before, 1.0), tolerance, 0)
            linearisations += report.linearisations
            displacement, body = self._displacement(before, state)
            residual = max(report.newton_residual or 0.0, displacement)
            if displacement <= still and tolerance <= finest:
                break
            if not self._has_free and self._may_touch:
                state = relaxation.next(before, state, displacement)
            tolerance = finest if displacement <= still else max(finest, min(tolerance, FINER * displacement))
        else:
            if self._has_free:
                raise EquilibriumNotFound(
                    body,
                    loads.start.step,
                    f"does not come to rest at {loads.start.time:.6g} s: after {MOST_MOVES} moves it still goes "
                    f"{displacement:.2g} mm "
                    "at a time; nothing holds it, or not enough",
                    "a support, a firmer grip, or less weight",
                )
            restless = f"moves '{body}' by {displacement:.2g} mm" if displacement > ROUGH else ""
        report = replace(report, linearisations=linearisations, converged=report.converged and not restless)
        return replace(found, state=state, report=report, residual=residual, restless=restless)

    def _settled(
        self, loads: "_Loads", state: State, share: float, unmixed: int
    ) -> tuple[State, int, tuple[str, str] | None]:
        """Where bodies that do not rest go under a share of the loads, in short moves.

        Returns:
            The last state, the number of linearisations, and a body and why it has not come to rest, or None.
        """
        finest, problem = self._time.newton_tolerance, ("", "")
        longest, linearisations, last = 0.5 * self._contact.alarm_distance, 0, np.inf
        for _ in range(MOST_SETTLING):
            try:
                end, report = self._move(loads.at(state, share), finest, unmixed)
            except SimulationDiverged as error:
                problem = error.body, error.cause
                break
            displacement, _ = self._displacement(state, end)
            linearisations += report.linearisations
            problem = self._problem(state, end, report, finest)
            if not problem[1]:
                return end, linearisations, None
            residual = report.newton_residual or 0.0
            if not displacement > longest:
                if not residual < 0.5 * last:
                    break
                state, last = end, residual
                continue
            state = _part_of_move(state, end, longest / displacement)
        return state, linearisations, problem

    def _displacement(self, before: State, after: State) -> tuple[float, str]:
        """Longest way of a node, or of a point of a rigid body [mm], and the body's name."""
        nodes = np.linalg.norm(after.position - before.position, axis=1)
        turn = 2.0 * np.linalg.norm(after.rigid_rotation - before.rigid_rotation, axis=1)
        rigid = np.linalg.norm(after.rigid_position - before.rigid_position, axis=1) + turn * self._radius
        displacements = [(float(nodes[place].max()), name) for name, place in self._soft]
        return max((*displacements, *zip(rigid.tolist(), self._rigid, strict=True)), default=(0.0, ""))

    def _problem(self, before: State, after: State, report: StepReport, tolerance: float) -> tuple[str, str]:
        """A body, and why its end of a static step is not to be trusted, or nothing.

        Contacts are searched before a step, within the alarm distance: bodies that go farther may pass each other.
        """
        displacement, body = self._displacement(before, after)
        if not (report.residual < self._contact.tolerance and (report.newton_residual or 0.0) <= tolerance):
            return body, f"not solved after {report.linearisations} linearisations and {report.iterations} sweeps"
        if self._may_touch and displacement > 0.5 * self._contact.alarm_distance:
            return body, f"it would move by {displacement:.3g} mm at once, more than half of contact.alarm_distance"
        return body, ""


def _part_of_move(before: State, end: State, share: float) -> State:
    moved = {name: getattr(before, name) for name in ("position", "rigid_position", "rigid_rotation")}
    moved = {name: first + share * (getattr(end, name) - first) for name, first in moved.items()}
    moved["rigid_rotation"] /= np.linalg.norm(moved["rigid_rotation"], axis=1, keepdims=True)
    return end.changed(**moved)


class _Relaxation:
    """Part of each move on which bodies go, where moves to and fro would grow: on thin tools surfaces turn so much with
    a small way to the side that contacts sought again lead beyond where they lead to rest (Aitken's relaxation: Irons
    and Tuck 1969)."""

    def __init__(self, longest: float):
        """Go no farther at once than the longest way [mm], within which contacts are found again."""
        self._longest, self._share = longest, 1.0
        self._last: np.ndarray | None = None
        self._last_displacement = np.inf

    def next(self, before: State, end: State, displacement: float) -> State:
        """Where to search next, after a move from a state to its end, with the longest way of a point [mm]."""
        move = (end.position - before.position).ravel()
        if self._last is not None and (self._share < 1.0 or displacement > SWINGS * self._last_displacement):
            change = move - self._last
            share = -self._share * float(self._last @ change) / max(float(change @ change), 1e-300)
            self._share = min(max(share, SHORTEST), 1.0)
        self._last, self._last_displacement = move, displacement
        share = min(self._share, self._longest / max(displacement, 1e-300))
        return end if share == 1.0 else _part_of_move(before, end, share)


class _Loads:
    """What acts on the bodies, from a state to that with the requests of a control."""

    def __init__(self, model: Model, start: State, requested: State):
        self.start = start
        still = ("velocity", "rigid_velocity", "rigid_angular_velocity")
        self._requested = requested.changed(**{name: np.zeros_like(getattr(start, name)) for name in still})
        acting = np.where(requested.actuator_imposed, model.actuators.own_coordinates(start), start.actuator_effort)
        self._ends = {"actuator_target": (acting, requested.actuator_target)}
        for name in ("frame_pose", "anchor_position", "gravity", "young_modulus", "pull_point"):
            self._ends[name] = (getattr(start, name), getattr(requested, name))
        # A force that begins or ends, or has moved to another point, grows from 0.
        before, after = start.external_force, requested.external_force
        goes_on = (start.external_force_steps != 0) & (before[:, 2] == after[:, 2]).all(axis=1)
        goes_on &= start.external_force_own_axes == requested.external_force_own_axes
        self._ends["external_force"] = np.where(goes_on[:, None, None], before, [[0.0], [0.0], [1.0]] * after), after

    def at(self, state: State, share: float) -> State:
        """The bodies of a state, at rest, with the loads after a share of the change."""
        bodies = {name: getattr(state, name) for name in CONFIGURATION}
        if share == 1.0:
            return self._requested.changed(**bodies)
        loads = {name: first + share * (last - first) for name, (first, last) in self._ends.items()}
        return self._requested.changed(**bodies, **loads)
