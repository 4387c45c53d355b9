"""Few integration domains with weights that move a body as all of them do.

The energy-conserving sampling and weighting of Farhat, Avery, Chapman and Cortial (2014): weights that are not
negative, found by the non-negative least squares of Lawson and Hanson (1974), which take in one domain after the other
and end as soon as the error is small enough. What is made small is not the error of the forces but that of the motion:
the amplitudes by which a force error displaces a body at rest, K_r^-1 (G w - G 1), with K_r the stiffness at the state.
The least squares make their norm small, which in modes that are orthonormal in the mass is that of the displacements
weighted with the masses; the search ends when no node is displaced by more than is allowed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.linalg

from taichisoft_reduction.domain_forces import DomainForces

BATCH = 8
"""Domains taken in at a time."""
PROGRESS = 1.0 - 1e-6
"""Share to which the residual has to fall as columns come in."""
SINGULAR = 1e-7
"""Share of the largest pivot below which columns depend on each other."""
SPIN = 3.0
"""Angular velocity of the base [rad/s] that damping forces are taken at."""


@dataclass(frozen=True)
class Cubature:
    """The chosen domains.

    Attributes:
        domain: their numbers, rising, shape (count,).
        weight: factors on their volumes, above 0, shape (count,).
        error: largest error of the displacement by them in the states that they were chosen by [mm].
    """

    domain: np.ndarray
    weight: np.ndarray
    error: float


class MotionCriterion:
    """By how much weighted domains miss the displacements of some states.

    Attributes:
        rows: amplitude by each domain alone, in each state and mode [mm sqrt(kg)], shape (state_count, mode_count,
            count).
        whole: their sums over all domains, shape (state_count, mode_count).
    """

    def __init__(self, forces: DomainForces, states: np.ndarray, spun: np.ndarray, lag: float):
        """Take states of a body.

        Args:
            forces: the body's domains.
            states: amplitudes, shape (state_count, mode_count).
            spun: amplitudes of states that are also taken spinning about each axis, shape (spun_count, mode_count).
            lag: factor of the damping forces [s].
        """
        axes = SPIN * np.eye(3)
        works = chain(
            ((state, forces.forces(state)) for state in states),
            ((state, lag * forces.spin_forces(state, axis)) for state in spun for axis in axes),
        )
        self.rows = np.empty((len(states) + 3 * len(spun), states.shape[1], forces.count), np.float32)
        for number, (state, work) in enumerate(works):
            factor = scipy.linalg.cho_factor(forces.stiffness(state))
            self.rows[number] = scipy.linalg.cho_solve(factor, work.T)
        self.whole = self.rows.sum(axis=2, dtype=np.float64)
        self._modes = forces.modes.reshape(-1, states.shape[1]).T

    def error(self, domain: np.ndarray, weight: np.ndarray) -> float:
        """The largest displacement of a node in any state by what weighted domains miss [mm]."""
        missed = self.rows[:, :, domain] @ weight - self.whole
        moved = (missed @ self._modes).reshape(len(missed), -1, 3)
        return float(np.linalg.norm(moved, axis=2).max())


def choose_domains(
    criterion: MotionCriterion, volume: np.ndarray, allowed: float, progress: Callable[[int, float], None]
) -> Cubature:
    """The fewest domains that greedy search finds whose largest error is at most `allowed` [mm].

    Args:
        criterion: what is made small.
        volume: volumes of all domains for the energies of shape and of volume [mm^3], shape (count, 2).
        allowed: largest error [mm].
        progress: called with the number of domains and their error.
    """
    flat = criterion.rows.reshape(-1, criterion.rows.shape[2])
    # Two more rows: the domains stand for the whole volume, so that states unlike all of these are not too soft.
    whole = float(np.sqrt((criterion.whole**2).mean())) / np.maximum(volume.sum(axis=0), 1e-300)[:, None]
    rows = np.vstack([flat, (whole * volume.T)[volume.any(axis=0)]]).astype(np.float32)
    search = NonNegativeSearch(rows)
    batch, residual = BATCH, float("inf")
    while True:
        grows = search.grow(batch)
        error = criterion.error(search.chosen, search.weight)
        progress(len(search.chosen), error)
        # Of several columns that come in together each may push the others out again; a single one cannot.
        stalled = search.residual > PROGRESS * residual
        if error <= allowed or not grows or (stalled and batch == 1):
            order = np.argsort(search.chosen)
            return Cubature(search.chosen[order], search.weight[order], error)
        batch, residual = 1 if stalled else BATCH, search.residual


class NonNegativeSearch:
    """The least squares of weights that are not negative, over columns that come in one after the other.

    Attributes:
        chosen: numbers of the columns, shape (count,).
        weight: their weights, above 0, shape (count,).
    """

    def __init__(self, rows: np.ndarray):
        """Seek weights by which columns of `rows`, shape (row_count, column_count), add up to the sum of all."""
        self._rows = rows
        self._target = rows.sum(axis=1, dtype=np.float64)
        self._right = self._target.astype(np.float32) @ rows
        self._products = np.zeros((0, 0))
        self.chosen, self.weight = np.zeros(0, int), np.zeros(0)

    @property
    def residual(self) -> float:
        """Root of the sum of squares that is left."""
        return float(np.linalg.norm(self._target - self._rows[:, self.chosen] @ self.weight))

    def grow(self, count: int) -> bool:
        """Take in the columns that reduce the residual most, at most `count`; False where none does."""
        missed = self._target - self._rows[:, self.chosen] @ self.weight
        gain = missed.astype(np.float32) @ self._rows
        gain[self.chosen] = -np.inf
        add = np.argsort(gain)[-count:]
        add = add[gain[add] > 0.0]
        new = self._rows[:, add].astype(np.float64)
        cross = self._rows[:, self.chosen].T.astype(np.float64) @ new
        self._products = np.block([[self._products, cross], [cross.T, new.T @ new]])
        self.chosen = np.concatenate([self.chosen, add])
        self._solve(np.concatenate([self.weight, np.zeros(len(add))]))
        return bool(len(add))

    def _solve(self, weight: np.ndarray) -> None:
        """The least squares over the chosen columns, from weights that are not negative; drops the others."""
        kept = np.arange(len(self.chosen))
        while True:
            solution = _solve_positive(self._products[np.ix_(kept, kept)], self._right[self.chosen[kept]])
            if (solution > 0.0).all():
                self.chosen, self.weight = self.chosen[kept], solution
                self._products = self._products[np.ix_(kept, kept)]
                return
            falling = solution <= 0.0
            fall = np.where(falling, weight - solution, 1.0)
            share = np.where(falling, weight / np.where(fall > 0.0, fall, 1.0), np.inf)
            step = float(share.min())
            stays = share > step
            weight, kept = (weight + step * (solution - weight))[stays], kept[stays]


def _solve_positive(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        factor = scipy.linalg.cho_factor(matrix)
        pivots = np.abs(np.diag(factor[0]))
        independent = bool(pivots.min() > SINGULAR * pivots.max())
    except np.linalg.LinAlgError:
        independent = False
    found: np.ndarray = scipy.linalg.cho_solve(factor, right) if independent else scipy.linalg.lstsq(matrix, right)[0]
    return found
