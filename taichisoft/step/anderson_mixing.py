"""Acceleration of linearisations that converge linearly, since they leave out a part of the slope."""

import numpy as np

from taichisoft.step.solution import StepSolution

DEPTH = 5
"""Most changes between linearisations that are remembered."""

FARTHEST = 8.0
"""Longest way to a first combination over the last change [-]: farther off, changes are not linear; each combination
that is better than the last one lets the next go twice as far, since near a critical load hardly anything resists."""


class AndersonMixing:
    """Anderson's mixing of the solutions of the last linearisations (Walker and Ni 2011, Anderson acceleration for
    fixed-point iterations): of their affine combinations the one whose own change is least, if changes are linear.

    Contacts and actuators obey their laws in a combination where they do so in the same way in all solutions.
    """

    def __init__(self) -> None:
        """Remember nothing yet."""
        self.forget()

    def forget(self) -> None:
        """Begin again: the solutions have led nowhere."""
        self._solutions: list[StepSolution] = []
        self._changes: list[np.ndarray] = []
        self._farthest = FARTHEST

    def next(self, before: StepSolution, after: StepSolution) -> StepSolution | None:
        """The combination to go on from; None before there are two solutions.

        Args:
            before: where the equations were linearised.
            after: the solution of the linearised problem.
        """
        if self._solutions and len(self._solutions[-1].contact_impulse) != len(after.contact_impulse):
            self.forget()
        self._solutions.append(after)
        self._changes.append((after.node_velocity - before.node_velocity).ravel())
        del self._solutions[: -DEPTH - 1], self._changes[: -DEPTH - 1]
        if len(self._solutions) < 2:
            return None
        differences = np.diff(np.array(self._changes), axis=0)
        shares = np.linalg.lstsq(differences.T, self._changes[-1], rcond=1e-12)[0]
        mixed = after
        for share, (first, second) in zip(shares, zip(self._solutions, self._solutions[1:], strict=False), strict=True):
            mixed = mixed.plus(second, -share).plus(first, share)
        way = float(np.linalg.norm(mixed.node_velocity - before.node_velocity))
        share = min(1.0, self._farthest * float(np.linalg.norm(self._changes[-1])) / max(way, 1e-300))
        self._farthest *= 2.0
        return before.towards(mixed, share)
