"""A plot of a closed-loop run: force and set point, pressure, heights, slip and phases over time.

python -m taichisoft_controllers.closed_loop.plot out/gripper/run.csv docs/closed_loop.svg

`run.csv` is that of `taichisoft run ... --controller closed-loop --outputs csv`; pushes are taken from the scene.toml
beside it. Needs matplotlib.
"""

import csv
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_controllers.closed_loop.grasp_sequence import Phase

MOST_POINTS = 1500  # of a line; of the steps between two points the one with the fastest slip is shown
# Of the phases in which the object is off the ground.
SHADES = {Phase.LIFT: "#dce9f5", Phase.HOLD: "#c6dbef", Phase.HELD: "#c6dbef", Phase.LOWER: "#dce9f5"}


def draw(table: Path, picture: Path) -> None:
    """Draw the run of a table into an SVG file.

    Raises:
        TaichisoftError: the table is not that of a closed-loop run.
    """
    import matplotlib
    from matplotlib.figure import Figure

    columns = _thinned(_read(table))
    time, phase = columns["time [s]"], columns["signal phase"]
    lift = next(values for name, values in columns.items() if name.startswith("lift "))
    pressure = np.mean([values for name, values in columns.items() if name.startswith("pressure ")], axis=0)
    # Text as text and fixed identities: a small file that changes only with the figures.
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(9.0, 7.0), layout="constrained")
        force_axes, pressure_axes, height_axes, slip_axes = figure.subplots(4, 1, sharex=True)
        force_axes.plot(time, columns["signal set_point"], "k--", linewidth=1, label="set point")
        force_axes.plot(time, columns["signal force"], linewidth=1, label="force of the fingers")
        force_axes.set_ylabel("force [mN]")
        pressure_axes.plot(time, pressure, linewidth=1)
        pressure_axes.set_ylabel("pressure [kPa]")
        height_axes.plot(time, columns["signal height"], "k--", linewidth=1, label="base, as asked for")
        height_axes.plot(time, lift, linewidth=1, label="object")
        height_axes.set_ylabel("height [mm]")
        slip_axes.semilogy(time, np.maximum(columns["signal slip_speed"], 1e-3), linewidth=1)
        slip_axes.set_ylabel("slip [mm/s]")
        slip_axes.set_xlabel("time [s]")
        pushes = _pushes(table.with_name("scene.toml"))
        for axes in (force_axes, pressure_axes, height_axes, slip_axes):
            _shade(axes, time, phase)
            for index, (start, end) in enumerate(pushes):
                label = "push" if index == 0 and axes is force_axes else None
                axes.axvspan(start, end, color="tab:red", alpha=0.6, linewidth=0, label=label)
            axes.margins(x=0)
        for axes in (force_axes, height_axes):
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
        figure.savefig(picture, format="svg", metadata={"Date": None, "Creator": None})


def _read(table: Path) -> dict[str, np.ndarray]:
    try:
        with table.open(encoding="utf-8", newline="") as file:
            names, *rows = csv.reader(file)
    except (OSError, ValueError) as error:
        raise TaichisoftError(f"{table}: not readable as a table: {error}") from error
    for name in ("time [s]", "signal phase", "signal set_point", "signal force", "signal height", "signal slip_speed"):
        if name not in names:
            raise TaichisoftError(f"{table}: has no column '{name}'; it must be the run.csv of a closed-loop run")
    numbers = [name for name in names if name != "clipped"]
    return {name: np.array([float(row[names.index(name)]) for row in rows]) for name in numbers}


def _thinned(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    count = len(columns["time [s]"])
    width = -(-count // MOST_POINTS)
    slip = columns["signal slip_speed"]
    chosen = [start + int(np.argmax(slip[start : start + width])) for start in range(0, count, width)]
    return {name: values[chosen] for name, values in columns.items()}


def _shade(axes: Any, time: np.ndarray, phase: np.ndarray) -> None:
    """Colour the background."""
    changes = [0, *(np.flatnonzero(np.diff(phase)) + 1), len(time) - 1]
    for start, end in pairwise(changes):
        shade = SHADES.get(Phase(int(phase[start])))
        if shade is not None:
            axes.axvspan(time[start], time[end], color=shade, linewidth=0)


def _pushes(scene: Path) -> list[tuple[float, float]]:
    if not scene.is_file():
        return []
    pushes = tomllib.loads(scene.read_text(encoding="utf-8")).get("pushes", [])
    return [(push["start"], push["start"] + push["duration"]) for push in pushes]


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
