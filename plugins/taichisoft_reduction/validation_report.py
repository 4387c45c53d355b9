"""What the validation found, for people and programs: a table, JSON, and a picture."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft_reduction.comparison import UNITS, Comparison, worst
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult

WITHIN, ABOVE = "within the tolerance", "above the tolerance"
JSON, TABLE, PICTURE = "validation.json", "validation.md", "validation.png"
HEADER = ["run", *(f"{name} [{unit}]" for name, unit in UNITS.items()), "steps/s full", "reduced", "ratio"]


def verdict(comparisons: Sequence[Comparison], tolerance: float) -> str:
    """Whether the largest error of a position is within the tolerance, in words."""
    return WITHIN if worst(comparisons) <= tolerance else ABOVE


def table_rows(comparisons: Sequence[Comparison]) -> list[list[str]]:
    """A row for each run: largest and mean error of each quantity, and the largest in percent of its change."""
    rows = []
    for one in comparisons:
        cells = []
        for quantity in UNITS:
            found = one.deviations.get(quantity)
            cells.append(
                "-" if found is None else f"{found.largest:.3g} / {found.mean:.2g} ({100.0 * found.share:.2g} %)"
            )
        ratio = one.reduced_speed / one.full_speed if one.full_speed else math.nan
        rows.append([one.name, *cells, f"{one.full_speed:.0f}", f"{one.reduced_speed:.0f}", f"{ratio:.1f}"])
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
                "name": one.name,
                "problem": one.problem,
                **{
                    quantity: {"largest": found.largest, "mean": found.mean, "scale": found.scale}
                    for quantity, found in one.deviations.items()
                },
                "steps_per_second": {"full": one.full_speed, "reduced": one.reduced_speed},
            }
            for one in comparisons
        ],
    }


def write_report(folder: Path, comparisons: Sequence[Comparison], tables: dict[str, Any]) -> None:
    """Write `validation.json` and `validation.md`.

    Raises:
        ReductionError: a file cannot be written.
    """
    lines = [
        f"The reduced model is **{tables['verdict']}** of {100.0 * tables['tolerance']:g} %.",
        "",
        *(
            f"- {name}: {found['modes']} modes, {found['domains']} of {found['all_domains']} integration domains"
            for name, found in tables["bodies"].items()
        ),
        "",
        "Largest and mean error in runs that the model was not trained on, and in brackets the largest in percent",
        "of the largest change of the quantity; steps per second of processor time on one thread.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|---" * len(HEADER) + "|",
        *("| " + " | ".join(row) + " |" for row in table_rows(comparisons)),
        *("" if not one.problem else f"\n{one.name}: {one.problem}" for one in comparisons),
    ]
    for name, text in ((JSON, json.dumps(tables, indent=2)), (TABLE, "\n".join(lines).rstrip())):
        with atomic_file(folder / name, ReductionError) as partial:
            partial.write_text(text + "\n", encoding="utf-8")


def draw_report(folder: Path, full: Sequence[RunResult], reduced: Sequence[RunResult]) -> None:
    """Draw `validation.png`: a row for each run, with the motion of the node that moves most, and the largest force.

    Raises:
        ReductionError: it cannot be written.
    """
    from matplotlib.figure import Figure

    from taichisoft_outputs.plots.figure import figure_bytes

    pairs = [pair for pair in zip(full, reduced, strict=True) if len(pair[0].time) and len(pair[1].time)]
    if not pairs:
        return
    figure = Figure(figsize=(11.0, 2.4 * len(pairs)), layout="constrained")
    for row, (one, other) in zip(figure.subplots(len(pairs), 2, squeeze=False), pairs, strict=True):
        body = max(one.displacement, key=lambda name: np.abs(one.displacement[name]).max())
        node = int(np.linalg.norm(one.displacement[body], axis=2).max(axis=0).argmax())
        ways = [np.linalg.norm(run.displacement[body][:, node], axis=1) for run in (one, other)]
        _panel(row[0], one.time, other.time, ways, f"{one.name}: {body} [mm]")
        changing = [name for name in one.figures if np.ptp(one.figures[name]) > 0.0]
        if changing:
            name = max(changing, key=lambda name: (name.startswith("force"), np.ptp(one.figures[name])))
            _panel(row[1], one.time, other.time, [run.figures[name] for run in (one, other)], name)
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
