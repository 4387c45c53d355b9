"""The proximal point method with Newton steps, for problems that sweeps do not solve.

The matrix of closed contacts is singular if they can share a load in many ways, and nearly singular if soft bodies hold
light rigid bodies: a Newton step may then diverge. With a proximal term, a pull towards a center, a few steps nearly
always converge; the center then moves to the result, and the pull is weakened (Rockafellar 1976, Monotone operators and
the proximal point algorithm; for friction Acary, Bremond and Huber 2018, On solving contact problems with Coulomb
friction). Once the center no longer moves, the pull is zero and does not change the solution.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.interruption import stop_if_asked
from taichisoft.solver.kernels import step_and_sweep as kernels
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem
from taichisoft.solver.kernels.elimination import make_linear_system
from taichisoft.solver.kernels.newton_step import ProximalTerm
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS

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
        self._outcome = np.zeros(3)

    def begin(self, answer: Iterate, share: float) -> None:
        """Start at `answer`, with a pull towards it by `share` of each row's own compliance."""
        rows, weight = self._row_count(), self.proximal.weight
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
        rows = self._row_count()
        self.proximal.center[:rows] = self.point.impulse[:rows]

    def set_solution(self, answer: Iterate) -> None:
        """Copy the result of the last sweep to `answer`."""
        copy(self.swept, answer, self._row_count())

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
        rows, proximal = self._row_count(), self.proximal
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
        proximal.center[: self._row_count()] = 0.0
        proximal.weight[contact_rows : contact_rows + int(size[ACTUATORS])] = 0.0
        proximal.weight[:contact_rows] = largest
        velocity = self.point.velocity[:contact_rows]
        left = np.abs(velocity) < tolerance
        proximal.center[:contact_rows][left] = velocity[left] / (proximal.share[0] * largest)

    def _row_count(self) -> int:
        size = self._problem.size
        return int(3 * size[CONTACTS] + size[ACTUATORS] + 3 * size[MOMENTS])


def copy(source: Iterate, target: Iterate, rows: int) -> None:
    """Copy impulses and velocities of the first `rows` rows."""
    target.impulse[:rows] = source.impulse[:rows]
    target.velocity[:rows] = source.velocity[:rows]
