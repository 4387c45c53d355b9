"""The proximal point method with Newton steps, for what sweeps leave.

The matrix of closed contacts is singular where they share a load in many ways, and nearly so where light rigid bodies
are held by soft ones: a Newton step from there may lead anywhere. With a proximal term, a pull towards a center, the
impulses are nearly always found in a few steps; the center then moves there, and the pull becomes weaker (Rockafellar
1976, Monotone operators and the proximal point algorithm; for friction Acary, Bremond and Huber 2018, On solving
contact problems with Coulomb friction). Where the center no longer moves the pull is nothing: it does not change the
answer.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.interruption import stop_if_asked
from taichisoft.solver.kernels import step_and_sweep as kernels
from taichisoft.solver.kernels.constraint_problem import Iterate, Problem
from taichisoft.solver.kernels.elimination import make_linear_system
from taichisoft.solver.kernels.newton_step import Pull
from taichisoft.solver.kernels.row_velocities import ACTUATORS, CONTACTS, MOMENTS

# Newton steps with one center, and how many of them let the next pull be weaker.
LONGEST = 12
QUICK = 5
WEAKER, STRONGER, WEAKEST = 0.1, 10.0, 1e-9
# Each center's problem is solved to this share of the residual there, or of the tolerance.
SHARE_OF_RESIDUAL = 0.01
SHARE_OF_TOLERANCE = 0.1
# Steps towards no impulses end where they move these by no more than this share of the largest: with a pull of 1e-8 the
# rounding moves what is undetermined by 2e-8 to 5e-8 of it in every step.
STILL = 2e-7


class Outcome(NamedTuple):
    """What a Newton step did.

    Attributes:
        miss: velocity by which a block misses its law at its end, pull included [mm/s, of a volume mm^3/s].
        found: what a sweep from there finds to change, in the same units.
        moved: largest change of an impulse by the step [mN s, of a volume kPa s].
        largest: largest impulse at its end.
    """

    miss: float
    found: float
    moved: float
    largest: float


class ProximalNewton:
    """Newton steps on a constraint problem, with its work space.

    Attributes:
        point: where the last step ended; it may leave the friction cones.
        swept: where a sweep led from there.
        pull: the proximal term.
        system: room for the linear equations of a step.
    """

    def __init__(self, problem: Problem):
        """Make room for as many rows as the arrays of `problem` have."""
        rows = len(problem.free)
        self._problem = problem
        self.point, self.swept = (Iterate(np.empty(rows), np.empty(rows)) for _ in range(2))
        self.pull = Pull(np.empty(rows), np.empty(rows), np.empty(1))
        self.system = make_linear_system(rows)
        self._outcome = np.zeros(4)

    def begin(self, answer: Iterate, share: float) -> None:
        """Start at these impulses, with a pull towards them by this share of each row's own compliance."""
        rows, weight = self._row_count(), self.pull.weight
        copy(answer, self.point, rows)
        self.pull.center[:rows] = answer.impulse[:rows]
        weight[:rows] = self._problem.compliance[: rows * rows : rows + 1]
        self.pull.share[0] = share

    def step(self, moves: bool = True) -> Outcome:
        """A Newton step and a sweep from its end; or, if it does not move, the sweep from where the last one ended."""
        kernels.step_and_sweep(
            self._problem, self.point, self.swept, self.pull, self.system, self._outcome, int(moves), 1
        )
        return Outcome(*self._outcome.tolist())

    def move_center(self) -> None:
        """Pull towards where the last step ended."""
        rows = self._row_count()
        self.pull.center[:rows] = self.point.impulse[:rows]

    def take(self, answer: Iterate) -> None:
        """Let `answer` become what the last sweep led to."""
        copy(self.swept, answer, self._row_count())

    def improve(
        self, answer: Iterate, residual: float, tolerance: float, first_share: float, most_steps: int
    ) -> tuple[float, int]:
        """Take steps until a sweep from their end finds less than the tolerance to change.

        Args:
            answer: where to start; it ends with the best impulses and velocities that a sweep left.
            residual: what the last sweep found to change, which led to it [mm/s, of a volume mm^3/s].
            tolerance: of the residual.
            first_share: strength of the first pull.
            most_steps: after which it gives up.

        Returns:
            The residual of what `answer` has become, and the number of steps.
        """
        self.begin(answer, first_share)
        rows, pull = self._row_count(), self.pull
        best, at_center, steps = residual, residual, 0
        while steps < most_steps and best >= tolerance:
            stop_if_asked()
            bound = max(SHARE_OF_TOLERANCE * tolerance, SHARE_OF_RESIDUAL * at_center)
            outcome, taken = self.step(moves=False), 0
            while taken < LONGEST and outcome.miss >= bound:
                outcome = self.step()
                taken += 1
            if outcome.miss < bound:
                at_center = outcome.found
                self.move_center()
                if taken <= QUICK:
                    pull.share[0] = max(WEAKER * pull.share[0], WEAKEST)
            else:
                if outcome.found < at_center:
                    at_center = outcome.found
                    pull.center[:rows] = self.swept.impulse[:rows]
                pull.share[0] *= STRONGER
            if outcome.found < best:
                best = outcome.found
                self.take(answer)
            steps += max(taken, 1)
            self.point.impulse[:rows] = pull.center[:rows]
        return best, steps

    def find_small(self, answer: Iterate, residual: float, tolerance: float, share: float) -> float:
        """Of many answers take the one with small impulses of contacts, if a sweep confirms it.

        There is one center, no impulses, and the pull stays. It is weak and decides alone, so the steps go on until
        they move nothing.

        Args:
            answer: one answer; it ends as the small one, or as it was.
            residual: what the last sweep found to change, which led to it [mm/s, of a volume mm^3/s].
            tolerance: of the residual.
            share: strength of the pull, beside the largest compliance of a contact.

        Returns:
            The residual of what `answer` has become.
        """
        self.begin(answer, share)
        self.step(moves=False)
        self._aim_at_zero(tolerance)
        bound = max(SHARE_OF_TOLERANCE * tolerance, SHARE_OF_RESIDUAL * residual)
        for _ in range(LONGEST):
            outcome = self.step()
            if outcome.miss < bound and outcome.moved <= STILL * outcome.largest:
                break
        if outcome.miss < bound and outcome.found < tolerance:
            self.take(answer)
            return outcome.found
        return residual

    def _aim_at_zero(self, tolerance: float) -> None:
        """Pull contacts towards no impulses, all with the largest weight, so that the pull measures lengths.

        Moments are pulled with their own weights, since they may be as undetermined as what presses; actuators are not.

        Velocities below the tolerance are what the sweeps left, and what tilts a body by less than 1e-6 mm. They would
        decide more than the weak pull does, so the center makes up for them.
        """
        size, pull = self._problem.size, self.pull
        contact_rows = 3 * int(size[CONTACTS])
        largest = pull.weight[:contact_rows].max()
        pull.center[: self._row_count()] = 0.0
        pull.weight[contact_rows : contact_rows + int(size[ACTUATORS])] = 0.0
        pull.weight[:contact_rows] = largest
        velocity = self.point.velocity[:contact_rows]
        left = np.abs(velocity) < tolerance
        pull.center[:contact_rows][left] = velocity[left] / (pull.share[0] * largest)

    def _row_count(self) -> int:
        size = self._problem.size
        return int(3 * size[CONTACTS] + size[ACTUATORS] + 3 * size[MOMENTS])


def copy(source: Iterate, target: Iterate, rows: int) -> None:
    """Impulses and velocities of that many rows."""
    target.impulse[:rows] = source.impulse[:rows]
    target.velocity[:rows] = source.velocity[:rows]
