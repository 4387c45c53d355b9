"""The solver of contacts and actuators with its work space."""

import numpy as np

from taichisoft.interruption import stop_if_asked
from taichisoft.kernels import gauss_seidel, interior_point, smallest_impulses
from taichisoft.kernels.constraint_problem import Iterate, Problem
from taichisoft.kernels.gauss_seidel import (
    DUE,
    FIRST_NEWTON,
    NEWTON,
    NEWTON_STEPS,
    RESIDUAL,
    SINCE_NEWTON,
    SWEEPS,
    TAKEN,
    WAIT,
)
from taichisoft.kernels.launch import forget
from taichisoft.step.proximal_newton import ProximalNewton

# Sweeps of a launch, between which a run may be interrupted, and before something else is tried; a grasp's steps take 5
# at the median.
SWEEPS_AT_A_TIME = 64
# The matrix of closed contacts is singular where they share a load in many ways (a table has four legs). A pull by this
# share of the diagonal chooses among them what is nearest to the present impulses; it does not change the answer, at
# which the step is zero.
SLIGHT_PULL = 1e-9
# Sweeps to wait for the next Newton steps become more each time that these fail, up to so many.
LONGEST_WAIT = 32
# Then proximal Newton steps from there, with this first pull.
FIRST_NEWTON_STEPS, FIRST_PULL = 16, 1e-6
# Then interior points, and Newton steps from where they end; where those of one turn fail, sweeps and another turn. The
# share of the way to the boundary that a step goes, and the first pull.
TURNS = ((0.99, 1e-4), (0.9, 1e-4), (0.99, 1e-2), (0.7, 1e-3))
LAST_NEWTON_STEPS = 60
# A pull towards no impulses, which changes velocities by this share of those that the impulses give.
PULL_TO_ZERO = 1e-8


class GaussSeidel:
    """Finds impulses l with v = free + W l that obey Signorini's and Coulomb's laws and the bounds of actuators.

    Sweeps of a Gauss-Seidel (kernels/gauss_seidel.py) with Newton steps in between find most answers. Where they do
    not, proximal Newton steps (proximal_newton.py) go on, then an interior-point method that begins anew
    (kernels/interior_point.py) and proximal Newton steps from where it ends, and so on in turns.

    Attributes:
        answer: impulses l, which the caller fills with where to start, and velocities v, as below.
        impulse: those of the answer [mN s, of a volume kPa s], shape (row_capacity,).
        velocity: those of the answer [mm/s, of a volume mm^3/s], shape (row_capacity,).
        iterations: sweeps of the last call, those that check Newton steps included.
        residual: largest change of a block's own velocity in its last sweep [mm/s, of a volume mm^3/s].
    """

    def __init__(self, problem: Problem):
        """Make room for as many rows as the arrays of `problem` have; the caller fills these."""
        rows = len(problem.free)
        self.iterations, self.residual = 0, 0.0
        self.impulse, self.velocity = np.zeros(rows), np.zeros(rows)
        self._problem, self.answer = problem, Iterate(self.impulse, self.velocity)
        self._search = gauss_seidel.Search(*(np.empty(rows) for _ in range(4)))
        self._progress = gauss_seidel.Progress(np.zeros(6, dtype=np.int32), np.zeros(3))
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
            tolerance: of the residual, at which the sweeps end.
            max_iterations: sweeps after which they end in any case.
        """
        self.iterations = 0
        for share, pull in TURNS:
            self._sweep(tolerance, min(SWEEPS_AT_A_TIME, max_iterations - self.iterations))
            if self.residual < tolerance or self.iterations >= max_iterations:
                return
            self._improve(tolerance, FIRST_PULL, FIRST_NEWTON_STEPS)
            if self.residual < tolerance:
                return
            self._begin_anew(tolerance, share, pull)
            if self.residual < tolerance:
                return
        self._sweep(tolerance, max_iterations - self.iterations)

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
        count, figure = self._progress
        count[SWEEPS] = 0
        while True:
            stop_if_asked()
            before = int(count[SWEEPS])
            gauss_seidel.solve(
                self._problem, self.answer, self._search, self._progress, tolerance, sweeps, before + SWEEPS_AT_A_TIME
            )
            if count[NEWTON] == DUE:
                self._try_newton(sweeps)
            self.residual, done = float(figure[RESIDUAL]), int(count[SWEEPS])
            if done >= sweeps or done == before or self.residual < tolerance:
                break
        self.iterations += done

    def _try_newton(self, sweeps: int) -> None:
        """Newton steps, each checked by a sweep; taken where that finds less than half as much to change."""
        count, figure = self._progress
        count[SINCE_NEWTON] = 0
        count[WAIT] = max(FIRST_NEWTON, min(count[WAIT] + FIRST_NEWTON, LONGEST_WAIT))
        self._newton.begin(self.answer, SLIGHT_PULL)
        for _ in range(min(NEWTON_STEPS, sweeps - int(count[SWEEPS]))):
            found = self._newton.step().found
            count[SWEEPS] += 1
            if found < 0.5 * figure[RESIDUAL]:
                count[NEWTON], count[WAIT], figure[RESIDUAL] = TAKEN, 1, found
                self._newton.take(self.answer)
                break
            self._newton.move_center()

    def _improve(self, tolerance: float, first_pull: float, steps: int) -> None:
        """Proximal Newton steps; what they do not improve stays."""
        impulse = self.impulse.copy()
        residual = self._newton.improve(self.answer, self.residual, tolerance, first_pull, steps)
        self._keep_if_finite(impulse, residual)

    def _keep_if_finite(self, impulse: np.ndarray, residual: float) -> None:
        """The new impulses with their residual; or, if they are no numbers, those of before."""
        if np.isfinite(self.impulse).all():
            self.residual = residual
        else:
            self.impulse[:] = impulse

    def _begin_anew(self, tolerance: float, share: float, first_pull: float) -> None:
        """Interior points and Newton steps from where they end; back to what was before if that was better."""
        stop_if_asked()
        newton, before, residual = self._newton, self.impulse.copy(), self.residual
        interior_point.follow_path(
            self._problem, self.answer, newton.swept, newton.system, self._path, self._figure, tolerance, share, 1
        )
        self.residual = float(self._figure[0])
        if np.isfinite(self.impulse).all():
            self._improve(tolerance, first_pull, LAST_NEWTON_STEPS)
        if not (np.isfinite(self.impulse).all() and self.residual < residual):
            self.impulse[:], self.residual = before, residual
