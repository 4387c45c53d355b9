"""Few integration domains with weights that move a body as all of them do.

The energy-conserving sampling and weighting of Farhat, Avery, Chapman and Cortial (2014): weights that are not negative,
found by the non-negative least squares of Lawson and Hanson (1974), which take in one domain after the other and end
as soon as the error is small enough. What is made small is not the error of the forces but that of the motion: the
amplitudes by which a force error displaces the body at rest, K_r^-1 (G w - G 1), with K_r the stiffness at the state.
In modes that are orthonormal in the mass, their norm over the root of the body's mass is the root of the mean square
displacement [mm].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from taichisoft_reduction.domain_forces import DomainForces

BATCH = 8
"""Domains taken in at a time."""
NEGLIGIBLE = 1e-5
"""Share of the largest singular value below which rows of the criterion are left out."""


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
        rows: displacement by each domain alone, in each state and mode [mm], shape (state_count, mode_count, count).
    """

    def __init__(self, forces: DomainForces, states: np.ndarray, mass: float):
        """Take states by their amplitudes, shape (state_count, mode_count), of a body of `mass` [kg]."""
        self.rows = np.empty((len(states), states.shape[1], forces.count), np.float32)
        for number, state in enumerate(states):
            factor = scipy.linalg.cho_factor(forces.stiffness(state))
            self.rows[number] = scipy.linalg.cho_solve(factor, forces.forces(state).T) / np.sqrt(mass)
        self._whole = self.rows.sum(axis=2, dtype=np.float64)

    def error(self, domain: np.ndarray, weight: np.ndarray) -> float:
        """The largest error over all states [mm], of weighted domains."""
        missed = self.rows[:, :, domain] @ weight - self._whole
        return float(np.linalg.norm(missed, axis=1).max())

    def compressed(self, share: float) -> np.ndarray:
        """Rows that have the same sums of squares up to a share of the largest singular value, (row_count, count)."""
        flat = self.rows.reshape(-1, self.rows.shape[2])
        values, vectors = scipy.linalg.eigh(flat.astype(np.float64) @ flat.T.astype(np.float64))
        some = values > share**2 * values[-1]
        found: np.ndarray = vectors[:, some].T @ flat
        return found


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
    rows = criterion.compressed(NEGLIGIBLE)
    # Two more rows: the domains stand for the whole volume, so that states unlike all of these are not too soft.
    whole = np.sqrt((rows.sum(axis=1) ** 2).mean()) / np.maximum(volume.sum(axis=0), 1e-300)[:, None]
    rows = np.vstack([rows, (whole * volume.T)[volume.any(axis=0)]])
    target = rows.sum(axis=1)
    chosen = np.zeros(0, int)
    weight = np.zeros(0)
    residual = target
    while True:
        gain = rows.T @ residual
        gain[chosen] = -np.inf
        add = np.argsort(gain)[-BATCH:]
        add = add[gain[add] > 0.0]
        chosen, weight, residual = _non_negative(rows, target, np.concatenate([chosen, add]), np.concatenate([weight, np.zeros(len(add))]))
        error = criterion.error(chosen, weight)
        progress(len(chosen), error)
        if error <= allowed or not len(add):
            order = np.argsort(chosen)
            return Cubature(chosen[order], weight[order], error)


def _non_negative(
    rows: np.ndarray, target: np.ndarray, chosen: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least squares over some columns with weights above 0, from weights that are not negative; drops the others."""
    while True:
        solution = scipy.linalg.lstsq(rows[:, chosen], target, lapack_driver="gelsy")[0]
        if (solution > 0.0).all():
            return chosen, solution, target - rows[:, chosen] @ solution
        falling = solution <= 0.0
        fall = np.where(falling, weight - solution, 1.0)
        share = np.where(falling, weight / np.where(fall > 0.0, fall, 1.0), np.inf)
        step = float(share.min())
        weight = weight + step * (solution - weight)
        stays = share > step
        chosen, weight = chosen[stays], weight[stays]
