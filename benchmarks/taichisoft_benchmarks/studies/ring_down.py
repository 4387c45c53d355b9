"""Frequency and decay of the measured beam of Dragon Skin 10, which rings down, beside the simulated beam.

The recorded markers (srl-ethz/diffPD_sim2real, MIT licence) are not part of the project; `measured_truth` compares.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.growth_plots import svg_axes
from taichisoft_benchmarks.studies.element_errors import BEAM, GRAVITY, beam
from taichisoft_benchmarks.studies.one_body import TO_REST

LOADS = ("gravity", "load52", "load101")
TAKES = ("a", "b")
TIP = slice(1, 10)
"""Columns of the markers at the tip: x, y and z of three [mm]."""

CELLS = (13, 4, 4)
"""Of the mesh of smoothed elements."""
STEP = 5e-4
"""Time step [s]. Implicit Euler damps an oscillation like Rayleigh's factor b = h, which is taken off the fitted b."""


@dataclass(frozen=True)
class Swing:
    """An oscillation about rest, from its first peak on.

    Attributes:
        time: since the peak [s], shape (count,).
        displacement: of the tip from the moulded shape, along the way to rest [mm], shape (count,).
        rest: displacement at rest [mm].
        frequency: [Hz].
        decay: g of the envelope exp(-g t) [1/s].
    """

    time: np.ndarray
    displacement: np.ndarray
    rest: float
    frequency: float
    decay: float

    @classmethod
    def of(cls, time: np.ndarray, displacement: np.ndarray, rest: float) -> "Swing":
        """Fit a damped oscillation to displacements [mm] that begin at a peak at time 0 [s]; frequency to 1e-3."""

        def oscillation(t: np.ndarray, size: float, decay: float, turning: float, phase: float, mean: float) -> Any:
            return mean + size * np.exp(-decay * t) * np.cos(turning * t + phase)

        around = displacement - rest
        crossings = np.flatnonzero((around[:-1] > 0) & (around[1:] <= 0))[:6]
        period = np.diff(time[crossings]).mean()
        first = (float(around[0]), 2.0, 2 * np.pi / period, 0.0, rest)
        found, _ = curve_fit(oscillation, time, displacement, first)
        return cls(time, displacement, rest, float(found[2] / (2 * np.pi)), float(found[1]))


def measured_swing(path: Path) -> Swing:
    """The mean of the tip's markers in a recorded take.

    Raises:
        BenchmarkError: the file cannot be read as such a table.
    """
    try:
        table = np.genfromtxt(path, delimiter=",", skip_header=1)
        tip = table[:, TIP].reshape(len(table), 3, 3).mean(axis=1)
    except (OSError, ValueError, IndexError) as error:
        raise BenchmarkError(f"{path}: cannot be read as a table of markers: {error}") from error
    way = tip - tip[0]
    at_rest = way[-50:].mean(axis=0)
    rest = float(np.linalg.norm(at_rest))
    displacement = way @ at_rest / rest
    peak = int(displacement.argmax())
    return Swing.of(table[peak:, 0] - table[peak, 0], displacement[peak:], rest)


def measured_swings(folder: Path) -> dict[str, list[Swing]]:
    """The takes by load.

    Raises:
        BenchmarkError: a file cannot be read as such a table.
    """
    name = "realbeam_experiments__beam_{}_V2_{}.csv"
    return {load: [measured_swing(folder / name.format(load, take)) for take in TAKES] for load in LOADS}


def rayleigh_damping(swings: dict[str, list[Swing]]) -> tuple[float, float]:
    """Rayleigh's factors a [1/s] and b [s] by least squares of g = a / 2 + b (2 pi f)^2 / 2 over all loads.

    With them the beam swings at frequencies between 3.4 and 7.8 Hz.
    """
    every = [one for takes in swings.values() for one in takes]
    turning = 2 * np.pi * np.array([one.frequency for one in every])
    table = 0.5 * np.column_stack([np.ones(len(every)), turning**2])
    (a, b), *_ = np.linalg.lstsq(table, [one.decay for one in every])
    return float(a), float(b)


def simulated_swing(
    peak: float,
    damping: tuple[float, float],
    duration: float,
    cells: tuple[int, int, int] = CELLS,
    step: float = STEP,
    **body: Any,
) -> Swing:
    """The beam released at rest from where more gravity had brought its tip to `peak` [mm].

    Args:
        peak: displacement of the tip at the start over that at rest [-].
        damping: Rayleigh's factors a [1/s] and b [s].
        duration: [s].
        cells: of the mesh of smoothed elements.
        step: time step [s], shorter than b.
        body: keys of the soft body instead of those of `BEAM_BODY`.
    """
    from taichisoft.control import Control

    a, b = damping
    keys: dict[str, Any] = {"element": "smoothed", "law": "neo-hookean", "rayleigh_mass": a, **body}
    still = beam(cells, TO_REST, **keys)
    swinging = beam(cells, {"step": step}, rayleigh_stiffness=b - step, **keys)
    nodes = swinging.model.rest_position
    tip = np.isclose(nodes[:, 0], BEAM[0])
    still.step()
    way = (still.state.position - nodes)[tip].mean(axis=0)
    rest = float(np.linalg.norm(way))
    still.step(Control(gravity=peak * np.array(GRAVITY)))
    swinging.restore(swinging.state.changed(position=still.state.position))
    moved = [still.state.position]
    for _ in range(round(duration / step)):
        swinging.step()
        moved.append(swinging.state.position)
    displacement = np.array([(position - nodes)[tip].mean(axis=0) @ way / rest for position in moved])
    return Swing.of(step * np.arange(len(moved)), displacement, rest)


def draw(measured: list[Swing], simulated: Swing, path: Path) -> None:
    """Draw the simulated swing over the takes, as SVG."""
    with svg_axes(path, (7.0, 3.2)) as axes:
        for take, one, marker in zip(TAKES, measured, "ox", strict=True):
            some = one.time < simulated.time[-1]
            style = {"ms": 3, "mfc": "none", "color": "0.45", "label": f"measured, take {take}"}
            axes.plot(one.time[some], one.displacement[some], marker, **style)
        axes.plot(simulated.time, simulated.displacement, color="C0", lw=1.2, label="simulated")
        axes.set_xlabel("time since the first peak [s]")
        axes.set_ylabel("tip [mm]")
        axes.set_xlim(0.0, simulated.time[-1])
        axes.legend(frameon=False)
