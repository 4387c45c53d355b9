"""What the validation found, for people and programs: a table, JSON, and a picture."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.base import atomic_file
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.training_run import RunResult

# How far the runs of a reduced model are from those of the full one.

POSITION = "position"
UNITS = {"position": "mm", "bending": "deg", "volume": "mm^3", "force": "mN", "lift": "mm", "slip": "mm"}
"""Quantities that are compared, and their units."""


def tolerance_share(option: str, text: str) -> float:
    """A tolerance as a share, from "0.5%" or "0.005"."""
    try:
        value = float(text.removesuffix("%").strip()) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1.0:
        raise ReductionError(f"{option} {text}: must be a share of the largest change above 0, such as 0.5%")
    return value


@dataclass(frozen=True)
class Deviation:
    """The error of a quantity in a run.

    Attributes:
        largest, mean: absolute errors, over all instants and all bodies, nodes or pairs.
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
    """Compare two runs at the instants that both have."""
    _, of_full, of_reduced = np.intersect1d(full.time, reduced.time, return_indices=True)
    deviations = {}
    if len(of_full):
        deviations[POSITION] = _positions(full, reduced, of_full, of_reduced)
        for quantity in UNITS:
            names = [name for name in full.figures if name.startswith(f"{quantity} of ")]
            if names:
                values = np.array([full.figures[name][of_full] for name in names])
                missed = np.abs(np.array([reduced.figures[name][of_reduced] for name in names]) - values)
                change = float(changes(quantity, values).max())
                if change > 0.0:
                    deviations[quantity] = Deviation(float(missed.max()), float(missed.mean()), change)
    problem = full.problem or (f"reduced: {reduced.problem}" if reduced.problem else "")
    return Comparison(full.name, problem, deviations, full.steps_per_second, reduced.steps_per_second)


def changes(quantity: str, values: np.ndarray) -> np.ndarray:
    """By how much values over time, shape (name_count, time_count), have changed: forces and ways are changes."""
    change: np.ndarray = np.abs(values if quantity in ("force", POSITION) else values - values[:, :1])
    return change


def _positions(full: RunResult, reduced: RunResult, of_full: np.ndarray, of_reduced: np.ndarray) -> Deviation:
    missed, moved = [], 0.0
    for name, displacement in full.displacement.items():
        values = displacement[of_full].astype(np.float64)
        missed.append(np.linalg.norm(reduced.displacement[name][of_reduced] - values, axis=2).ravel())
        moved = max(moved, float(np.linalg.norm(values, axis=2).max(initial=0.0)))
    errors = np.concatenate(missed)
    return Deviation(float(errors.max()), float(errors.mean()), moved)


def largest_imbalance(reduced: RunResult, bodies: Sequence[str]) -> float:
    """Largest imbalance of some bodies in a run with reduced ones [mm]."""
    values = [reduced.figures[key] for name in bodies if (key := f"imbalance of {name} [mm]") in reduced.figures]
    return max((float(values_of_body.max(initial=0.0)) for values_of_body in values), default=0.0)


def error_per_imbalance(pairs: Sequence[tuple[RunResult, RunResult]], bodies: Sequence[str]) -> float:
    """The largest error of a position over the largest imbalance of a run [-], the largest of some runs.

    Not their mean: how much error goes with an imbalance differs by the kind of motion, and what a run meets that was
    not trained on is of the kinds with more of it, modes that are missing altogether.

    Args:
        pairs: runs of the full model beside those of the reduced one.
        bodies: copies of a body.
    """
    ratios = []
    for full, reduced in pairs:
        own = {name: full.displacement[name] for name in bodies if name in full.displacement}
        imbalance = largest_imbalance(reduced, list(own))
        if imbalance > 0.0:
            compared = compare(replace(full, displacement=own, figures={}), reduced).deviations
            ratios += [compared[POSITION].largest / imbalance] if compared else []
    return max(ratios, default=0.0)


def worst(comparisons: Sequence[Comparison]) -> float:
    """Largest error of a position over the largest displacement of all runs [-]; infinite where a run failed."""
    if not comparisons or any(
        comparison.problem or POSITION not in comparison.deviations for comparison in comparisons
    ):
        return float("inf")
    scale = max(comparison.deviations[POSITION].scale for comparison in comparisons)
    return max(comparison.deviations[POSITION].largest for comparison in comparisons) / scale if scale else 0.0


WITHIN, ABOVE = "within the tolerance", "above the tolerance"
JSON, TABLE, PICTURE = "validation.json", "validation.md", "validation.png"
HEADER = ["run", *(f"{name} [{unit}]" for name, unit in UNITS.items()), "steps/s full", "reduced", "ratio"]


def verdict(comparisons: Sequence[Comparison], tolerance: float) -> str:
    """Whether the largest error of a position is within the tolerance, in words."""
    return WITHIN if worst(comparisons) <= tolerance else ABOVE


def table_rows(comparisons: Sequence[Comparison]) -> list[list[str]]:
    """A row for each run: largest and mean error of each quantity, and the largest in percent of its change."""
    rows = []
    for comparison in comparisons:
        cells = []
        for quantity in UNITS:
            deviation = comparison.deviations.get(quantity)
            cells.append(
                "-"
                if deviation is None
                else f"{deviation.largest:.3g} / {deviation.mean:.2g} ({100.0 * deviation.share:.2g} %)"
            )
        ratio = comparison.reduced_speed / comparison.full_speed if comparison.full_speed else math.nan
        rows.append(
            [comparison.name, *cells, f"{comparison.full_speed:.0f}", f"{comparison.reduced_speed:.0f}", f"{ratio:.1f}"]
        )
    return rows


def as_tables(comparisons: Sequence[Comparison], tolerance: float, about: dict[str, Any]) -> dict[str, Any]:
    """The validation as plain data."""
    error = worst(comparisons)
    return {
        **about,
        "verdict": verdict(comparisons, tolerance),
        "tolerance": tolerance,
        "error": error if math.isfinite(error) else None,
        "runs": [
            {
                "name": comparison.name,
                "problem": comparison.problem,
                **{
                    quantity: {"largest": deviation.largest, "mean": deviation.mean, "scale": deviation.scale}
                    for quantity, deviation in comparison.deviations.items()
                },
                "steps_per_second": {"full": comparison.full_speed, "reduced": comparison.reduced_speed},
            }
            for comparison in comparisons
        ],
    }


def write_report(folder: Path, comparisons: Sequence[Comparison], tables: dict[str, Any]) -> None:
    """Write `validation.json` and `validation.md`."""
    lines = [
        f"The reduced model is **{tables['verdict']}** of {100.0 * tables['tolerance']:g} %.",
        "",
        *(
            f"- {name}: {about['modes']} modes, {about['domains']} of {about['all_domains']} integration domains"
            for name, about in tables["bodies"].items()
        ),
        "",
        "Largest and mean error in runs that the model was not trained on, and in brackets the largest in percent",
        "of the largest change of the quantity; steps per second of processor time on one thread.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|---" * len(HEADER) + "|",
        *("| " + " | ".join(row) + " |" for row in table_rows(comparisons)),
        *("" if not comparison.problem else f"\n{comparison.name}: {comparison.problem}" for comparison in comparisons),
    ]
    for name, text in ((JSON, json.dumps(tables, indent=2)), (TABLE, "\n".join(lines).rstrip())):
        with atomic_file(folder / name, ReductionError) as partial:
            partial.write_text(text + "\n", encoding="utf-8")


def draw_report(folder: Path, full: Sequence[RunResult], reduced: Sequence[RunResult]) -> None:
    """Draw `validation.png`: a row for each run, with the motion of the node that moves most, and the largest force."""
    from matplotlib.figure import Figure

    from taichisoft_outputs.plots import figure_bytes

    pairs = [pair for pair in zip(full, reduced, strict=True) if len(pair[0].time) and len(pair[1].time)]
    if not pairs:
        return
    figure = Figure(figsize=(11.0, 2.4 * len(pairs)), layout="constrained")
    for row, (full_run, reduced_run) in zip(figure.subplots(len(pairs), 2, squeeze=False), pairs, strict=True):
        body = max(full_run.displacement, key=lambda name: np.abs(full_run.displacement[name]).max())
        node = int(np.linalg.norm(full_run.displacement[body], axis=2).max(axis=0).argmax())
        distances = [np.linalg.norm(run.displacement[body][:, node], axis=1) for run in (full_run, reduced_run)]
        _panel(row[0], full_run.time, reduced_run.time, distances, f"{full_run.name}: {body} [mm]")
        changing = [name for name in full_run.figures if np.ptp(full_run.figures[name]) > 0.0]
        if changing:
            name = max(changing, key=lambda name: (name.startswith("force"), np.ptp(full_run.figures[name])))
            _panel(
                row[1], full_run.time, reduced_run.time, [run.figures[name] for run in (full_run, reduced_run)], name
            )
        else:
            row[1].set_axis_off()
    with atomic_file(folder / PICTURE, ReductionError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))


def _panel(axes: Any, time: np.ndarray, reduced_time: np.ndarray, values: Sequence[np.ndarray], title: str) -> None:
    axes.plot(time, values[0], color="#999999", linewidth=3.0, label="full")
    axes.plot(reduced_time, values[1], color="#d55e00", linewidth=1.0, label="reduced")
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
