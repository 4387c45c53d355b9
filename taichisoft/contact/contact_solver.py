"""The solver of contacts and actuators: sweeps, proximal Newton steps, impacts."""

import functools
from typing import NamedTuple

import numpy as np

from taichisoft.base.processes import stop_if_asked
from taichisoft.contact.kernels import interior_point, smallest_impulses
from taichisoft.contact.kernels import newton_step as kernels
from taichisoft.contact.kernels.constraint_problem import BOUND_COLUMNS, Iterate, Problem
from taichisoft.contact.kernels.newton_step import ProximalTerm, make_linear_system
from taichisoft.contact.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS
from taichisoft.contact.kernels.sweep import RESIDUAL, SWEEPS, sweep_repeatedly
from taichisoft.runtime.launch import forget

# The proximal point method with Newton steps, for problems that sweeps do not solve.
#
# The matrix of closed contacts is singular if they can share a load in many ways, and nearly singular if soft bodies
# hold light rigid bodies: a Newton step may then diverge. With a proximal term, a pull towards a center, a few steps
# nearly always converge; the center then moves to the result, and the pull is weakened (Rockafellar 1976, Monotone
# operators and the proximal point algorithm; for friction Acary, Bremond and Huber 2018, On solving contact problems
# with Coulomb friction). Once the center no longer moves, the pull is zero and does not change the solution.

# Largest number of Newton steps with one center, and largest number after which the next pull is weaker.
LONGEST = 12
QUICK = 5
WEAKER, STRONGER, WEAKEST = 0.1, 10.0, 1e-9
# The problem of each center is solved to this fraction of the residual at the center, or of the tolerance.
SHARE_OF_RESIDUAL = 0.01
SHARE_OF_TOLERANCE = 0.1
# Steps towards zero impulses end when they change impulses by at most this fraction of the largest: with a pull of 1e-8
# round-off changes undetermined impulses by 2e-8 to 5e-8 of the largest in every step.
STILL = 2e-7


class Outcome(NamedTuple):
    """Result of Newton steps with one center.

    Attributes:
        miss: largest violation of a block's law at their end, pull included [mm/s, of a volume mm^3/s].
        found: residual of a sweep from there, in the same units.
        taken: number of steps.
    """

    miss: float
    found: float
    taken: int


class ProximalNewton:
    """Newton steps on a constraint problem, with its work space.

    Attributes:
        point: iterate after the last step; it may be outside the friction cones.
        swept: iterate after a sweep from `point`.
        pull: the proximal term.
        system: linear equations of a step.
    """

    def __init__(self, problem: Problem):
        """Allocate the work space for the capacity of `problem`."""
        rows = len(problem.free)
        self._problem = problem
        self.point, self.swept = (Iterate(np.empty(rows), np.empty(rows)) for _ in range(2))
        self.proximal = ProximalTerm(np.empty(rows), np.empty(rows), np.empty(1))
        self.system = make_linear_system(rows)
        self._outcome, self._rows = np.zeros(3), 0

    def begin(self, answer: Iterate, share: float) -> None:
        """Start at `answer`, with a pull towards it by `share` of each row's own compliance."""
        size = self._problem.size
        self._rows = rows = int(3 * size[CONTACTS] + size[ACTUATORS] + 3 * size[MOMENTS])
        weight = self.proximal.weight
        copy(answer, self.point, rows)
        self.proximal.center[:rows] = answer.impulse[:rows]
        weight[:rows] = self._problem.compliance[: rows * rows : rows + 1]
        self.proximal.share[0] = share

    def steps(self, bound: float, most: int, least: int = 0, still: float = 0.0) -> Outcome:
        """Take Newton steps with the present center, and a sweep from their end; see `step_and_sweep`."""
        parts = (self._problem, self.point, self.swept, self.proximal, self.system, self._outcome)
        kernels.step_and_sweep(*parts, bound, still, least, most, 1)
        miss, found, taken = self._outcome.tolist()
        return Outcome(miss, found, int(taken))

    def move_center(self) -> None:
        """Move the center of the pull to the end of the last step."""
        rows = self._rows
        self.proximal.center[:rows] = self.point.impulse[:rows]

    def set_solution(self, answer: Iterate) -> None:
        """Copy the result of the last sweep to `answer`."""
        copy(self.swept, answer, self._rows)

    def improve(
        self, answer: Iterate, residual: float, tolerance: float, first_share: float, most_steps: int
    ) -> tuple[float, int]:
        """Take steps until the residual of a sweep from their end is below the tolerance.

        Args:
            answer: initial guess; replaced by the best impulses and velocities after a sweep.
            residual: residual of `answer` [mm/s, of a volume mm^3/s].
            tolerance: tolerance of the residual.
            first_share: strength of the first pull.
            most_steps: largest number of steps.

        Returns:
            The residual of the new `answer`, and the number of steps.
        """
        self.begin(answer, first_share)
        rows, proximal = self._rows, self.proximal
        best, at_center, steps = residual, residual, 0
        while steps < most_steps and best >= tolerance:
            stop_if_asked()
            bound = max(SHARE_OF_TOLERANCE * tolerance, SHARE_OF_RESIDUAL * at_center)
            outcome = self.steps(bound, LONGEST)
            if outcome.miss < bound:
                at_center = outcome.found
                self.move_center()
                if outcome.taken <= QUICK:
                    proximal.share[0] = max(WEAKER * proximal.share[0], WEAKEST)
            else:
                if outcome.found < at_center:
                    at_center = outcome.found
                    proximal.center[:rows] = self.swept.impulse[:rows]
                proximal.share[0] *= STRONGER
            if outcome.found < best:
                best = outcome.found
                self.set_solution(answer)
            steps += max(outcome.taken, 1)
            self.point.impulse[:rows] = proximal.center[:rows]
        return best, steps

    def find_small(self, answer: Iterate, residual: float, tolerance: float, share: float) -> float:
        """Choose the solution with small impulses of contacts, if a sweep confirms it.

        The center stays at zero impulses, and the pull stays constant. Only this weak pull selects the solution, so the
        steps continue until nothing moves.

        Args:
            answer: a solution; replaced by the small one, or unchanged.
            residual: residual of `answer` [mm/s, of a volume mm^3/s].
            tolerance: tolerance of the residual.
            share: strength of the pull, relative to the largest compliance of a contact.

        Returns:
            The residual of the new `answer`.
        """
        self.begin(answer, share)
        self.steps(np.inf, 0)  # for the velocities
        self._aim_at_zero(tolerance)
        bound = max(SHARE_OF_TOLERANCE * tolerance, SHARE_OF_RESIDUAL * residual)
        outcome = self.steps(bound, LONGEST, least=1, still=STILL)
        if outcome.miss < bound and outcome.found < tolerance:
            self.set_solution(answer)
            return outcome.found
        return residual

    def _aim_at_zero(self, tolerance: float) -> None:
        """Pull contacts towards zero impulses, all with the largest weight, so that the pull measures lengths.

        Moments, which may be undetermined like normal impulses, are pulled with their own weights; actuators are not
        pulled. Velocities below the tolerance are left by the sweeps and tilt a body by less than 1e-6 mm. They would
        outweigh the weak pull, so the center compensates for them.
        """
        size, proximal = self._problem.size, self.proximal
        contact_rows = 3 * int(size[CONTACTS])
        largest = proximal.weight[:contact_rows].max()
        proximal.center[: self._rows] = 0.0
        proximal.weight[contact_rows : contact_rows + int(size[ACTUATORS])] = 0.0
        proximal.weight[:contact_rows] = largest
        velocity = self.point.velocity[:contact_rows]
        left = np.abs(velocity) < tolerance
        proximal.center[:contact_rows][left] = velocity[left] / (proximal.share[0] * largest)


def copy(source: Iterate, target: Iterate, rows: int) -> None:
    """Copy impulses and velocities of the first `rows` rows."""
    target.impulse[:rows] = source.impulse[:rows]
    target.velocity[:rows] = source.velocity[:rows]


# The solver of contacts and actuators, with its work space.

# Sweeps that determine which contacts are open, stick or slip; after a warm start they often suffice.
FIRST_SWEEPS = 4
# Largest number of proximal Newton steps, and their first pull. If friction admits several solutions, they find the one
# near the impulses of the last step, which interior points ignore: with 16 steps a cube fell out of a firm grip. A box
# that rolls with rolling friction needs 225 steps once in some thousand time steps.
NEWTON_STEPS, FIRST_PULL = 300, 1e-6
# The second attempt, from no impulses: a weak pull may lead rolling bodies to a center where the steps end, although
# there is a solution.
NEW_STEPS, STRONG_PULL = 100, 1.0
# Last resort: interior points, then Newton steps. Each attempt has a fraction of the distance to the boundary that a
# step goes, and a first pull.
LAST_RESORTS = ((0.99, 1e-4), (0.9, 1e-4), (0.99, 1e-2), (0.7, 1e-3))
LAST_NEWTON_STEPS = 60
# Sweeps at a time after that, between which a step can be interrupted.
LAST_SWEEPS = 100
# Pull towards zero impulses: the change of velocity over the velocity by the impulses [-].
PULL_TO_ZERO = 1e-8


class ContactSolver:
    """Solves for impulses l with v = free + W l that obey Signorini's and Coulomb's laws and the actuators' bounds.

    Three stages, each only if the previous one has not reached the tolerance: a few sweeps of a projected Gauss-Seidel
    (kernels/sweep.py), proximal Newton steps (`ProximalNewton`) with a weak, then with a strong pull, and an
    interior-point method that needs no initial guess (kernels/interior_point.py), followed by proximal Newton steps.
    The remaining iterations are sweeps.

    Attributes:
        answer: impulses l, initialised by the caller, and velocities v, as below.
        impulse: impulses of the answer [mN s, of a volume kPa s], shape (row_capacity,).
        velocity: velocities of the answer [mm/s, of a volume mm^3/s], shape (row_capacity,).
        iterations: number of sweeps of the last call, including one after each Newton step.
        residual: largest change of a block's own velocity in the last sweep [mm/s, of a volume mm^3/s].
    """

    def __init__(self, problem: Problem):
        """Allocate the work space for the capacity of `problem`, whose arrays the caller fills."""
        rows = len(problem.free)
        self.iterations, self.residual = 0, 0.0
        self.impulse, self.velocity = np.zeros(rows), np.zeros(rows)
        self._problem, self.answer = problem, Iterate(self.impulse, self.velocity)
        self._outcome = np.zeros(2)
        self._newton = ProximalNewton(problem)
        self._interior = interior_point.InteriorPoint(*(np.empty(size) for size in (rows,) * 7 + (1,)))
        self._figure = np.zeros(1)
        self._last_shares: smallest_impulses.Shares | None = None

    def release(self) -> None:
        """Release the arrays from kernels before larger ones replace them."""
        forget(self._problem, self.answer)

    def solve(self, tolerance: float, max_iterations: int) -> None:
        """Improve `impulse` in place.

        Args:
            tolerance: residual below which the solution is accepted [mm/s].
            max_iterations: largest number of sweeps.
        """
        self.iterations = 0
        self._sweep(tolerance, min(FIRST_SWEEPS, max_iterations))
        if self._is_unfinished(tolerance, max_iterations):
            self._improve(tolerance, FIRST_PULL, min(NEWTON_STEPS, max_iterations - self.iterations))
            if self._is_unfinished(tolerance, max_iterations):
                self._improve_anew(tolerance, min(NEW_STEPS, max_iterations - self.iterations))
        for share, pull in LAST_RESORTS:
            if self._is_unfinished(tolerance, max_iterations):
                steps = min(LAST_NEWTON_STEPS, max_iterations - self.iterations)
                self._follow_interior_points(tolerance, share, pull, steps)
        before, residual = self.impulse.copy(), self.residual
        while self._is_unfinished(tolerance, max_iterations):
            self._sweep(tolerance, min(LAST_SWEEPS, max_iterations - self.iterations))
        if self.residual > residual:
            self.impulse[:], self.residual = before, residual

    def _is_unfinished(self, tolerance: float, max_iterations: int) -> bool:
        return not self.residual < tolerance and self.iterations < max_iterations

    def choose_smallest(self, contacts: np.ndarray, tolerance: float) -> None:
        """Of all solutions with the same velocities, choose the one with the smallest impulses of `contacts`.

        Args:
            contacts: indices of contacts whose impulses W may leave undetermined (between rigid bodies), shape (n,).
            tolerance: tolerance of the residual [mm/s]; without convergence nothing is changed.
        """
        if len(contacts) < 2 or not self.residual < tolerance:
            return
        newton, impulse = self._newton, self.impulse.copy()
        self._figure[0] = newton.find_small(self.answer, self.residual, tolerance, PULL_TO_ZERO)
        smallest_impulses.choose_smallest(
            self._problem,
            self.answer,
            newton.point,
            newton.swept,
            newton.system,
            self._shares(contacts),
            self._figure,
            tolerance,
            1,
        )
        self._keep_if_finite(impulse, float(self._figure[0]))

    def _shares(self, contacts: np.ndarray) -> smallest_impulses.Shares:
        """Unknowns of these contacts, in the arrays of the last call if their sizes agree."""
        count = len(contacts)
        if self._last_shares is None or len(self._last_shares.contact) != count:
            self._last_shares = smallest_impulses.Shares(
                contact=np.empty(count, dtype=np.int32),
                state=np.empty(count, dtype=np.int32),
                unknown=np.empty(3 * count, dtype=np.int32),
                direction=np.empty((3 * count, 3)),
                aim=np.empty(3 * count),
            )
        self._last_shares.contact[:] = contacts
        return self._last_shares

    def _sweep(self, tolerance: float, sweeps: int) -> None:
        stop_if_asked()
        sweep_repeatedly(self._problem, self.answer, self._outcome, tolerance, sweeps)
        self.residual = float(self._outcome[RESIDUAL])
        self.iterations += int(self._outcome[SWEEPS])

    def _improve(self, tolerance: float, first_pull: float, steps: int) -> None:
        """Take proximal Newton steps; the answer stays if they do not improve it."""
        impulse = self.impulse.copy()
        residual, taken = self._newton.improve(self.answer, self.residual, tolerance, first_pull, steps)
        self.iterations += taken
        self._keep_if_finite(impulse, residual)

    def _improve_anew(self, tolerance: float, steps: int) -> None:
        """Take proximal Newton steps from no impulses, with a strong pull; a better old answer is restored."""
        before, residual = self.impulse.copy(), self.residual
        self.impulse[:] = 0.0
        self._sweep(tolerance, 1)
        self._improve(tolerance, STRONG_PULL, steps)
        if not self.residual < residual:
            self.impulse[:], self.residual = before, residual

    def _keep_if_finite(self, impulse: np.ndarray, residual: float) -> None:
        """Accept the new residual, or restore the old impulses if the new ones are not finite."""
        if np.isfinite(self.impulse).all():
            self.residual = residual
        else:
            self.impulse[:] = impulse

    def _follow_interior_points(self, tolerance: float, share: float, first_pull: float, newton_steps: int) -> None:
        """Solve by interior points and Newton steps; the old answer is restored if it was better.

        Interior points leave moments unchanged and may then end at values that are not finite: the Newton steps, with a
        stronger pull, then start from the old answer.
        """
        stop_if_asked()
        newton, before, residual = self._newton, self.impulse.copy(), self.residual
        interior_point.follow_path(
            self._problem, self.answer, newton.swept, newton.system, self._interior, self._figure, tolerance, share, 1
        )
        self.residual = float(self._figure[0])
        if not np.isfinite(self.impulse).all():
            self.impulse[:], self.residual = before, residual
        if not self.residual < tolerance:
            self._improve(tolerance, first_pull, newton_steps)
        if not self.residual < residual:
            self.impulse[:], self.residual = before, residual


@functools.cache
def load_stages() -> None:
    """Launch all stages once on two contacts, so that no kernel is compiled or loaded in the middle of a run."""
    row_count, contacts = 6, 2
    size, friction = np.array([contacts, 0, 0], dtype=np.int32), np.full(contacts, 0.5)
    bounds = np.zeros((0, BOUND_COLUMNS))
    free = np.tile([-1.0, 0.1, 0.0], contacts)
    solver = ContactSolver(Problem.without_moments(size, np.eye(row_count).reshape(-1), free, friction, bounds))
    solver.solve(tolerance=0.0, max_iterations=1000)
    solver.residual = 0.0
    solver.choose_smallest(np.arange(contacts), 1.0)
    solver.release()


# Impulses of impacts with restitution, found before the contacts are solved.


class Impacts:
    """Finds the impulses of impacts; holds the work space of one simulation.

    Pairs of bodies strike each other in the order of their speed of approach, so that an impact passes through a row of
    bodies (Guendelman, Bridson, Fedkiw 2003, Nonconvex rigid bodies with stacking). A pair gets 1 + e times the
    impulses p of the perfectly inelastic impact with friction. This is Newton's law, v_n+ = -e v_n-, at every pressing
    contact, and dissipates at least (1 - e^2) / 2 p W p. The tangential impulses are then replaced by the ones that,
    with these normal impulses, leave the least energy: friction brakes and returns no energy.
    """

    def __init__(self, tolerance: float, max_iterations: int):
        """Solve every impact to `tolerance` [mm/s] in at most `max_iterations` sweeps."""
        self._tolerance, self._max_iterations = tolerance, max_iterations
        self._make_room(4)

    def _make_room(self, contact_capacity: int) -> None:
        rows = 3 * contact_capacity
        self._problem = Problem.without_moments(
            np.zeros(3, dtype=np.int32),
            np.empty(rows**2),
            np.empty(rows),
            np.empty(contact_capacity),
            np.zeros((0, BOUND_COLUMNS)),
        )
        self._solver = ContactSolver(self._problem)

    def find(
        self,
        compliance: np.ndarray,
        before: np.ndarray,
        free: np.ndarray,
        touching: np.ndarray,
        pair: np.ndarray,
        restitution: np.ndarray,
        friction: np.ndarray,
        slowest: float,
    ) -> np.ndarray:
        """Impulses of the impacts [mN s], shape (3 contact_count,).

        Args:
            compliance: W, shape (3 contact_count, 3 contact_count).
            before: velocities of the rows at the start of the step [mm/s], shape (3 contact_count,).
            free: velocities after the step without impulses, plus the gap rate [mm/s], shape (3 contact_count,).
            touching: velocity at the end of the step below which each contact counts as closed [mm/s], shape
                (contact_count,), so that an impact of faces includes all their corners.
            pair: number of each contact's pair of bodies, shape (contact_count,).
            restitution: coefficient of each contact [-], shape (contact_count,).
            friction: coefficient of each contact [-], shape (contact_count,).
            slowest: approach below which restitution is zero [mm/s].
        """
        impulse, change = np.zeros_like(before), np.zeros_like(before)
        while True:
            speed = (before + change)[::3]
            closes = (free + change)[::3] < touching
            strikes = (speed < -slowest) & closes & (restitution > 0.0)
            if not strikes.any():
                return impulse
            fastest = int(np.where(strikes, speed, np.inf).argmin())
            chosen = np.flatnonzero((pair == pair[fastest]) & closes)
            rows = (3 * chosen[:, None] + np.arange(3)).reshape(-1)
            own = compliance[np.ix_(rows, rows)]
            velocity = (before + change)[rows]
            inelastic = self._inelastic(own, velocity, friction[chosen])
            strike = (1.0 + restitution[fastest]) * inelastic
            self._rub(own, velocity, friction[chosen], strike)
            impulse[rows] += strike
            change += compliance[:, rows] @ strike

    def _inelastic(self, own: np.ndarray, velocity: np.ndarray, friction: np.ndarray) -> np.ndarray:
        count = len(friction)
        if count > len(self._problem.friction):
            self._solver.release()
            self._make_room(2 * count)
        problem = self._problem
        problem.size[0] = count
        problem.compliance[: own.size] = own.reshape(-1)
        problem.free[: 3 * count], problem.friction[:count] = velocity, friction
        self._solver.impulse[: 3 * count] = 0.0
        self._solver.solve(self._tolerance, self._max_iterations)
        return self._solver.impulse[: 3 * count].copy()

    def _rub(self, own: np.ndarray, velocity: np.ndarray, friction: np.ndarray, strike: np.ndarray) -> None:
        """Replace the tangential impulses in place by the ones within the friction cones that leave the least energy.

        Projected Gauss-Seidel on a convex problem: each sweep reduces the energy.
        """
        for _ in range(self._max_iterations):
            largest = 0.0
            for contact in np.flatnonzero(strike[::3] > 0.0).tolist():
                tangents = slice(3 * contact + 1, 3 * contact + 3)
                slip = velocity[tangents] + own[tangents] @ strike
                scale = float(np.linalg.eigvalsh(own[tangents, tangents])[-1])
                better = strike[tangents] - slip / scale
                size, limit = float(np.linalg.norm(better)), float(friction[contact] * strike[3 * contact])
                if size > limit:
                    better *= limit / size
                largest = max(largest, scale * float(np.abs(better - strike[tangents]).max()))
                strike[tangents] = better
            if largest < self._tolerance:
                return
