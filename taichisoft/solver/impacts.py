"""Impulses of impacts with restitution, found before the contacts are solved."""

import numpy as np

from taichisoft.solver.contact_solver import ContactSolver
from taichisoft.solver.kernels.actuator_bounds import BOUND_COLUMNS
from taichisoft.solver.kernels.constraint_problem import Problem


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
