"""Settling of held objects: creep from second to second, by time step and damping, as a table.

    python -m taichisoft_benchmarks.studies.settling

prints the table, in some fifteen minutes; docs/notes/experiments.md quotes it. Creep by errors of the contacts would
not end, or would change in proportion to the step. Settling of viscous fingers falls exponentially, with a time
constant in proportion to their damping, and hardly depends on the step.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from taichisoft_benchmarks.marked_page import heading, row
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.studies.grasp_measure import SHAKEN_TO, MeasuredGrasp, control_at, scene_of

DAMPING = 0.1
"""Rayleigh's factor of the stiffness of the shipped fingers [s]."""
SHOWN = (2, 3, 5, 7)
"""The seconds of the hold whose creep is shown, the last one is also where time constant and slip are taken."""
ROUND_OFF = 1e-5
"""Motion in a second that says nothing any more [mm]: the solver stops at 1e-5 mm/s."""
HEADINGS = (
    "object", "mass, g", "kPa", "friction", "step, ms", "damping, s",
    *(f"creep in second {second}, mm" for second in SHOWN), "time constant, s", "slip, mm/s",
)  # fmt: skip


@dataclass(frozen=True)
class Hold:
    """A grasp that is held, the time step [s], and Rayleigh's factor of the stiffness of the fingers [s]."""

    grasp: MeasuredGrasp
    step: float = 0.01
    damping: float = DAMPING


def all_holds() -> list[Hold]:
    """Grasps that still move after three seconds at other steps and with less damping, then others' pressures."""
    moving = (
        MeasuredGrasp("cube turned by 45 degrees"),
        MeasuredGrasp("cube 10 mm off centre"),
        MeasuredGrasp("cube", mass=60.0, pressure=100.0),
        MeasuredGrasp("cube", mass=100.0, pressure=120.0, friction=1.5),
    )
    changes: tuple[dict[str, float], ...] = ({}, {"step": 0.005}, {"step": 0.0025}, {"damping": DAMPING / 5})
    pressures = (80.0, 90.0, 95.0, 100.0, 105.0, 110.0)
    holds = [Hold(grasp, **change) for grasp in moving for change in changes]
    return holds + [Hold(MeasuredGrasp("cube", mass=60.0, pressure=pressure, friction=1.5)) for pressure in pressures]


def measure(hold: Hold) -> tuple[list[float], float]:
    """Motion of the object in each second of the hold [mm], and the fastest slip of a contact in the last [mm/s].

    Raises:
        TaichisoftError: the simulation diverged.
    """
    from taichisoft.running import Simulation

    with TemporaryDirectory(prefix="taichisoft-settling-") as folder:
        simulation = Simulation(scene_of(hold.grasp, Path(folder), hold.step, hold.damping))
    places, slips = [], []
    for index in range(round((SHAKEN_TO + SHOWN[-1]) / hold.step)):
        simulation.step(control_at(simulation, hold.grasp.pressure, (index + 1) * hold.step))
        places.append(simulation.state.rigid_position[0])
        slips.append(float(np.linalg.norm(simulation.state.contact_slip, axis=1).max(initial=0.0)))
    second = round(1.0 / hold.step)
    held = np.array(places[-SHOWN[-1] * second - 1 :])
    return [float(np.linalg.norm(held[i + second] - held[i])) for i in range(0, len(held) - 1, second)], max(
        slips[-second:]
    )


def hold_row(hold: Hold, creep: Sequence[float], slip: float) -> str:
    """A line of the table."""
    grasp, before, last = hold.grasp, *creep[-2:]
    constant = "at rest" if last < ROUND_OFF else "none" if last >= before else f"{1 / math.log(before / last):.2f}"
    entries = [grasp.object, *(f"{value:g}" for value in (grasp.mass, grasp.pressure, grasp.friction))]
    entries += [f"{1e3 * hold.step:g}", f"{hold.damping:g}", *(f"{creep[second - 1]:.2g}" for second in SHOWN)]
    return row([*entries, constant, f"{slip:.1g}"])


def page_section() -> Iterator[str]:
    """The study as Markdown, line by line."""
    yield heading(HEADINGS)
    for hold in all_holds():
        yield hold_row(hold, *measure(hold))


def main() -> None:
    """Settling of held objects, by time step and damping."""
    for line in page_section():
        print(line, flush=True)


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.settling")
