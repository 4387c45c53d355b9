"""How far the runs of a reduced model are from those of the full one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichisoft_reduction.run_request import RunResult

POSITION = "position"
UNITS = {"position": "mm", "bending": "deg", "volume": "mm^3", "force": "mN", "lift": "mm", "slip": "mm"}
"""Quantities that are compared, and their units."""


@dataclass(frozen=True)
class Deviation:
    """The error of a quantity in a run.

    Attributes:
        largest, mean: absolute errors, over all moments and all bodies, nodes or pairs.
        scale: by how much the quantity changes in the full run at most.
    """

    largest: float
    mean: float
    scale: float

    @property
    def share(self) -> float:
        """The largest error over the scale; 0 where nothing changes."""
        return self.largest / self.scale if self.scale > 0.0 else 0.0


@dataclass(frozen=True)
class Comparison:
    """A run of the full model beside that of the reduced one.

    Attributes:
        name: name of the run.
        problem: why one of the two did not reach its end; empty where both did.
        deviations: by quantity.
        full_speed, reduced_speed: steps per second of processor time on one thread.
    """

    name: str
    problem: str
    deviations: Mapping[str, Deviation]
    full_speed: float
    reduced_speed: float


def compare(full: RunResult, reduced: RunResult) -> Comparison:
    """Compare two runs at the moments that both have."""
    _, one, other = np.intersect1d(full.time, reduced.time, return_indices=True)
    found = {}
    if len(one):
        found[POSITION] = _positions(full, reduced, one, other)
        for quantity in UNITS:
            names = [name for name in full.figures if name.startswith(f"{quantity} of ")]
            if names:
                values = np.array([full.figures[name][one] for name in names])
                missed = np.abs(np.array([reduced.figures[name][other] for name in names]) - values)
                change = float(changes(quantity, values).max())
                if change > 0.0:
                    found[quantity] = Deviation(float(missed.max()), float(missed.mean()), change)
    problem = full.problem or (f"reduced: {reduced.problem}" if reduced.problem else "")
    return Comparison(full.name, problem, found, full.steps_per_second, reduced.steps_per_second)


def changes(quantity: str, values: np.ndarray) -> np.ndarray:
    """By how much values over time, shape (name_count, time_count), have changed: forces and ways are changes."""
    change: np.ndarray = np.abs(values if quantity in ("force", POSITION) else values - values[:, :1])
    return change


def _positions(full: RunResult, reduced: RunResult, one: np.ndarray, other: np.ndarray) -> Deviation:
    missed, moved = [], 0.0
    for name, displacement in full.displacement.items():
        values = displacement[one].astype(np.float64)
        missed.append(np.linalg.norm(reduced.displacement[name][other] - values, axis=2).ravel())
        moved = max(moved, float(np.linalg.norm(values, axis=2).max(initial=0.0)))
    errors = np.concatenate(missed)
    return Deviation(float(errors.max()), float(errors.mean()), moved)


def largest_imbalance(reduced: RunResult, bodies: Sequence[str]) -> float:
    """Largest imbalance of some bodies in a run with reduced ones [mm]."""
    values = [reduced.figures[key] for name in bodies if (key := f"imbalance of {name} [mm]") in reduced.figures]
    return max((float(one.max(initial=0.0)) for one in values), default=0.0)


def error_per_imbalance(pairs: Sequence[tuple[RunResult, RunResult]], bodies: Sequence[str]) -> float:
    """The largest error of a position over the largest imbalance of a run [-], the largest of some runs.

    Not their mean: how much error goes with an imbalance differs by the kind of motion, and what a run meets that was
    not trained on is of the kinds with more of it, modes that are missing altogether.

    Args:
        pairs: runs of the full model beside those of the reduced one.
        bodies: copies of a body.
    """
    found = []
    for full, reduced in pairs:
        own = {name: full.displacement[name] for name in bodies if name in full.displacement}
        imbalance = largest_imbalance(reduced, list(own))
        if imbalance > 0.0:
            compared = compare(replace(full, displacement=own, figures={}), reduced).deviations
            found += [compared[POSITION].largest / imbalance] if compared else []
    return max(found, default=0.0)


def worst(comparisons: Sequence[Comparison]) -> float:
    """Largest error of a position over the largest displacement of all runs [-]; infinite where a run failed."""
    if not comparisons or any(one.problem or POSITION not in one.deviations for one in comparisons):
        return float("inf")
    scale = max(one.deviations[POSITION].scale for one in comparisons)
    return max(one.deviations[POSITION].largest for one in comparisons) / scale if scale else 0.0
