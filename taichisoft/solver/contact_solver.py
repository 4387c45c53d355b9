"""The solver of contacts and actuators, with its work space."""

import functools

import numpy as np

from taichisoft.interruption import stop_if_asked
from taichisoft.runtime.launch import forget
from taichisoft.solver.kernels import interior_point, smallest_impulses
from taichisoft.solver.kernels.actuator_bounds import BOUND_COLUMNS
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem
from taichisoft.solver.kernels.sweep import RESIDUAL, SWEEPS, sweep_repeatedly
from taichisoft.solver.proximal_newton import ProximalNewton

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
    (kernels/sweep.py), proximal Newton steps (proximal_newton.py) with a weak, then with a strong pull, and an
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
    room, contacts = 6, 2
    size, friction = np.array([contacts, 0, 0], dtype=np.int32), np.full(contacts, 0.5)
    bounds = np.zeros((0, BOUND_COLUMNS))
    free = np.tile([-1.0, 0.1, 0.0], contacts)
    solver = ContactSolver(Problem.without_moments(size, np.eye(room).reshape(-1), free, friction, bounds))
    solver.solve(tolerance=0.0, max_iterations=1000)
    solver.residual = 0.0
    solver.choose_smallest(np.arange(contacts), 1.0)
    solver.release()
