"""The solver of contacts and actuators with its work space."""

import functools

import numpy as np

from taichisoft.interruption import stop_if_asked
from taichisoft.runtime.launch import forget
from taichisoft.solver.kernels import interior_point, smallest_impulses
from taichisoft.solver.kernels.actuator_bounds import BOUND_COLUMNS
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem
from taichisoft.solver.kernels.sweep import RESIDUAL, SWEEPS, sweep_repeatedly
from taichisoft.solver.proximal_newton import ProximalNewton

# Sweeps that find out which contacts are open, stick or slip; a warm start often needs no more.
FIRST_SWEEPS = 4
# Proximal Newton steps from there, with this first pull. Where friction leaves several answers they find the one near
# the impulses of the last step, which interior points forget: with 16 steps a cube fell out of a firm grip.
NEWTON_STEPS, FIRST_PULL = 100, 1e-6
# The last resort: interior points, and Newton steps from where they end. Where it fails, it is tried again with other
# shares of the way to the boundary that a step goes, and other first pulls.
LAST_RESORTS = ((0.99, 1e-4), (0.9, 1e-4), (0.99, 1e-2), (0.7, 1e-3))
LAST_NEWTON_STEPS = 60
# A pull towards no impulses, which changes velocities by this share of those that the impulses give.
PULL_TO_ZERO = 1e-8


class ContactSolver:
    """Finds impulses l with v = free + W l that obey Signorini's and Coulomb's laws and the bounds of actuators.

    Three stages, each where the one before has not reached the tolerance: a few sweeps of a projected Gauss-Seidel
    (kernels/sweep.py), proximal Newton steps (proximal_newton.py), and an interior-point method that starts from the
    problem alone (kernels/interior_point.py), with proximal Newton steps from its end.

    Attributes:
        answer: impulses l, which the caller fills with where to start, and velocities v, as below.
        impulse: those of the answer [mN s, of a volume kPa s], shape (row_capacity,).
        velocity: those of the answer [mm/s, of a volume mm^3/s], shape (row_capacity,).
        iterations: sweeps of the last call, including the one after each Newton step.
        residual: largest change of a block's own velocity in its last sweep [mm/s, of a volume mm^3/s].
    """

    def __init__(self, problem: Problem):
        """Make room for as many rows as the arrays of `problem` have; the caller fills these."""
        rows = len(problem.free)
        self.iterations, self.residual = 0, 0.0
        self.impulse, self.velocity = np.zeros(rows), np.zeros(rows)
        self._problem, self.answer = problem, Iterate(self.impulse, self.velocity)
        self._outcome = np.zeros(2)
        self._newton = ProximalNewton(problem)
        self._path = interior_point.Path(*(np.empty(size) for size in (rows,) * 7 + (1,)))
        self._figure = np.zeros(1)
        self._last_shares: smallest_impulses.Shares | None = None

    def release(self) -> None:
        """Let no kernel keep these arrays alive, when larger ones take their place."""
        forget(self._problem, self.answer)

    def solve(self, tolerance: float, max_iterations: int) -> None:
        """Improve `impulse` in place.

        Args:
            tolerance: of the residual, at which the solution ends.
            max_iterations: sweeps after which it ends in any case.
        """
        self._sweep(tolerance, min(FIRST_SWEEPS, max_iterations))
        if self._goes_on(tolerance, max_iterations):
            self._improve(tolerance, FIRST_PULL, min(NEWTON_STEPS, max_iterations - self.iterations))
        for share, pull in LAST_RESORTS:
            if self._goes_on(tolerance, max_iterations):
                steps = min(LAST_NEWTON_STEPS, max_iterations - self.iterations)
                self._follow_interior_points(tolerance, share, pull, steps)

    def _goes_on(self, tolerance: float, max_iterations: int) -> bool:
        return not self.residual < tolerance and self.iterations < max_iterations

    def choose_smallest(self, contacts: np.ndarray, tolerance: float) -> None:
        """Of all answers that move everything alike, take the one with the smallest impulses of these contacts.

        Args:
            contacts: indices of contacts whose impulses W may leave undetermined: those of rigid bodies alone, (n,).
            tolerance: of the residual; nothing is changed where the solution has not reached it.
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
        """Room for these contacts' unknowns; that of the last call if they are as many."""
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
        self.residual, self.iterations = float(self._outcome[RESIDUAL]), int(self._outcome[SWEEPS])

    def _improve(self, tolerance: float, first_pull: float, steps: int) -> None:
        """Proximal Newton steps; what they do not improve stays."""
        impulse = self.impulse.copy()
        residual, taken = self._newton.improve(self.answer, self.residual, tolerance, first_pull, steps)
        self.iterations += taken
        self._keep_if_finite(impulse, residual)

    def _keep_if_finite(self, impulse: np.ndarray, residual: float) -> None:
        """The new impulses with their residual; or, if they are no numbers, those of before."""
        if np.isfinite(self.impulse).all():
            self.residual = residual
        else:
            self.impulse[:] = impulse

    def _follow_interior_points(self, tolerance: float, share: float, first_pull: float, newton_steps: int) -> None:
        """Interior points and Newton steps from their end; back to what was before if that was better.

        Interior points leave moments as they are, and may then end at no number: the Newton steps, whose pull is
        stronger now, start again from what was before.
        """
        stop_if_asked()
        newton, before, residual = self._newton, self.impulse.copy(), self.residual
        interior_point.follow_path(
            self._problem, self.answer, newton.swept, newton.system, self._path, self._figure, tolerance, share, 1
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
    """Launch all stages once, on two contacts: a kernel that is compiled or loaded in the middle of a run delays it."""
    room, contacts = 6, 2
    size, friction = np.array([contacts, 0, 0], dtype=np.int32), np.full(contacts, 0.5)
    bounds = np.zeros((0, BOUND_COLUMNS))
    free = np.tile([-1.0, 0.1, 0.0], contacts)
    solver = ContactSolver(Problem.without_moments(size, np.eye(room).reshape(-1), free, friction, bounds))
    solver.solve(tolerance=0.0, max_iterations=1000)
    solver.residual = 0.0
    solver.choose_smallest(np.arange(contacts), 1.0)
    solver.release()
