"""Grasps with the shipped gripper, as a table.

    python -m taichisoft_benchmarks.studies.grasps --element smoothed --output docs/notes/experiments.md

fills the section "grasps smoothed" of the page, in some ten minutes. Without `--element` fingers are of linear
elements, at higher pressures, for a section "grasps". `--only NAME` tries the grasps whose name has NAME in it. What
was measured is kept in `--results`, a file of JSON for each grasp, and the table shows all of it: `--only none` draws
it again.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from taichisoft_benchmarks.marked_page import PageOption, fill_section, heading, row
from taichisoft_benchmarks.program import run_program
from taichisoft_benchmarks.studies.grasp_measure import LIFT, MeasuredGrasp, measure_in_process
from taichisoft_benchmarks.studies.grasped_objects import OBJECTS, ROUND

YIELD = 10.0
"""Largest difference between the lifts of object and base of what counts as held [mm]: the fingers give way."""
CREEP = 0.01
"""Largest motion in the last second of what counts as held [mm]."""
HEADINGS = (
    "object", "mass, g", "kPa", "friction", "friction over weight", "held", f"lifted, mm of {LIFT:g}", "creep, mm",
    "steps not converged", "sweeps, median, most", "deepest, mm",
)  # fmt: skip


VARIED: tuple[dict[str, Any], ...] = (
    {"mass": 12.0, "pressure": 50.0},
    {"mass": 12.0, "friction": 0.2},
    {"mass": 60.0, "pressure": 100.0},
    {"friction": 1.5},
    {"mass": 100.0, "pressure": 100.0, "friction": 1.0},
    {"mass": 100.0, "pressure": 120.0, "friction": 1.5},
)
"""Variations with a cube and with a ball."""


PRESSURE_SHARES = {"linear": 1.0, "smoothed": 0.45, "quadratic": 0.45}
"""Pressures over the pressure of linear fingers [-]: on the shipped mesh the others bend 2.3 and 2.4 times as far."""


def all_grasps(element: str = "linear") -> list[MeasuredGrasp]:
    """Every object once, round ones also by their exact shape, and a cube and a ball at other settings.

    The masses stay where fingers of other elements have less pressure, so that these hold with less to spare.
    """
    grasps = []
    for name in OBJECTS:
        forms = (False, True) if name in ROUND else (False,)
        grasps += [MeasuredGrasp(name, exact) for exact in forms]
    grasps.append(MeasuredGrasp("cube", mass=12.0, pressure=30.0))  # a ball is out of reach of the fingers then
    for name, exact in (("cube", False), ("ball", False), ("ball", True)):
        grasps += [MeasuredGrasp(name, exact, **changes) for changes in VARIED]
    share = PRESSURE_SHARES[element]
    return [replace(grasp, element=element, pressure=share * grasp.pressure) for grasp in grasps]


def measure_all(grasps: Sequence[MeasuredGrasp], folder: Path) -> None:
    """Try grasps one after the other, and keep what was measured."""
    folder.mkdir(parents=True, exist_ok=True)
    for grasp in grasps:
        figures = measure_in_process(grasp)
        (folder / f"{grasp.name}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        print(f"{grasp.name}: {figures.get('problem') or grasp_row(grasp, figures)}", flush=True)


def read_all(grasps: Sequence[MeasuredGrasp], folder: Path) -> dict[MeasuredGrasp, dict[str, Any]]:
    """The figures that were kept of these grasps."""
    files = {grasp: folder / f"{grasp.name}.json" for grasp in grasps}
    return {grasp: json.loads(file.read_text(encoding="utf-8")) for grasp, file in files.items() if file.is_file()}


def table(measured: Mapping[MeasuredGrasp, Mapping[str, Any]]) -> str:
    """A table in Markdown, one row a grasp."""
    return "\n".join([heading(HEADINGS), *(grasp_row(grasp, figures) for grasp, figures in measured.items())])


def grasp_row(grasp: MeasuredGrasp, figures: Mapping[str, Any]) -> str:
    """The line of a grasp; a problem takes the place of the figures."""
    setting = [f"{grasp.object}{', exact' if grasp.exact else ''}"]
    setting += [f"{value:g}" for value in (grasp.mass, grasp.pressure, grasp.friction)]
    if "problem" in figures:
        return row([*setting, "", figures["problem"], *5 * [""]])
    held = abs(figures["lift"] - LIFT) <= YIELD and figures["creep"] <= CREEP
    shown = [
        f"{figures['margin']:.1f}",
        "yes" if held else "no",
        f"{figures['lift']:z.1f}",
        f"{figures['creep']:.2g}",
        f"{figures['unconverged']} of {figures['steps']}",
        f"{figures['sweeps_median']:.0f}, {figures['sweeps_most']}",
        f"{figures['penetration']:.2g}",
    ]
    return row([*setting, *shown])


def main(
    output: PageOption = None,
    only: Annotated[str, typer.Option(metavar="NAME", help="Try the grasps whose name has NAME in it.")] = "",
    results: Annotated[Path, typer.Option(metavar="DIR", help="Where figures are kept.")] = Path("out/grasps"),
    element: Annotated[Literal["linear", "smoothed", "quadratic"], typer.Option(help="Of the fingers.")] = "linear",
) -> None:
    """Grasps with the shipped gripper."""
    grasps = all_grasps(element)

    def lines() -> Iterator[str]:
        measure_all([grasp for grasp in grasps if only in grasp.name], results)
        yield table(read_all(grasps, results))

    fill_section(output, "grasps" if element == "linear" else f"grasps {element}", lines())


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.studies.grasps")
