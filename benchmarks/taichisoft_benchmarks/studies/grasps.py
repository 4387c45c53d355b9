"""Grasps with the shipped gripper, as a table.

    python -m taichisoft_benchmarks.studies.grasps --output docs/validation.md

tries every grasp and fills what stands between `<!-- grasps -->` and `<!-- end -->` in the page; it takes some ten
minutes. `--element smoothed` does so with fingers of other elements, at lower pressures, and fills what stands after
`<!-- grasps smoothed -->`. `--only NAME` tries those whose name has NAME in it. What was measured is kept in
`--results`, a file of JSON for each grasp, and the table shows all that is there: `--only none` draws it again.
"""

import argparse
import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies.grasp_cases import PRESSURE_SHARES, Grasp, all_grasps
from taichisoft_benchmarks.studies.grasp_measure import LIFT, measure_in_process

YIELD = 10.0
"""Largest difference between the lifts of object and base of what counts as held [mm]: the fingers give way."""
CREEP = 0.01
"""Largest motion in the last second of what counts as held [mm]."""
HEADINGS = (
    "object", "mass, g", "kPa", "friction", "friction over weight", "held", f"lifted, mm of {LIFT:g}", "creep, mm",
    "steps not converged", "sweeps, median, most", "deepest, mm", "ms a step",
)  # fmt: skip


def measure_all(grasps: Sequence[Grasp], folder: Path) -> None:
    """Try grasps one after the other, and keep what was measured."""
    folder.mkdir(parents=True, exist_ok=True)
    for grasp in grasps:
        figures = measure_in_process(grasp)
        (folder / f"{grasp.name}.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        print(f"{grasp.name}: {figures.get('problem') or row(grasp, figures)}", flush=True)


def read_all(grasps: Sequence[Grasp], folder: Path) -> dict[Grasp, dict[str, Any]]:
    """The figures that were kept of these grasps."""
    files = {grasp: folder / f"{grasp.name}.json" for grasp in grasps}
    return {grasp: json.loads(file.read_text(encoding="utf-8")) for grasp, file in files.items() if file.is_file()}


def table(measured: Mapping[Grasp, Mapping[str, Any]]) -> str:
    """A table in Markdown, one row a grasp."""
    lines = [f"| {' | '.join(HEADINGS)} |", "|" + len(HEADINGS) * "---|"]
    return "\n".join([*lines, *(row(grasp, figures) for grasp, figures in measured.items())])


def row(grasp: Grasp, figures: Mapping[str, Any]) -> str:
    """What was measured of a grasp; what went wrong stands in place of figures."""
    setting = [f"{grasp.object}{', exact' if grasp.exact else ''}"]
    setting += [f"{value:g}" for value in (grasp.mass, grasp.pressure, grasp.friction)]
    if "problem" in figures:
        return f"| {' | '.join([*setting, '', figures['problem'], *6 * ['']])} |"
    held = abs(figures["lift"] - LIFT) <= YIELD and figures["creep"] <= CREEP
    shown = [
        f"{figures['margin']:.1f}",
        "yes" if held else "no",
        f"{figures['lift']:z.1f}",
        f"{figures['creep']:.2g}",
        f"{figures['unconverged']} of {figures['steps']}",
        f"{figures['sweeps_median']:.0f}, {figures['sweeps_most']}",
        f"{figures['penetration']:.2g}",
        f"{figures['step_ms']:.1f}",
    ]
    return f"| {' | '.join([*setting, *shown])} |"


def main() -> None:
    """Try grasps, and fill the page in place."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.studies.grasps")
    parser.add_argument("-o", "--output", type=Path, metavar="PAGE.md", help="page to fill; print the table without it")
    parser.add_argument("--only", default="", metavar="NAME", help="try those whose name has NAME in it")
    parser.add_argument(
        "--results", type=Path, default=Path("out/grasps"), metavar="DIR", help="where figures are kept"
    )
    parser.add_argument("--element", choices=PRESSURE_SHARES, default="linear", help="of the fingers")
    arguments = parser.parse_args()
    grasps = all_grasps(arguments.element)
    mark = "<!-- grasps -->" if arguments.element == "linear" else f"<!-- grasps {arguments.element} -->"
    marked = re.compile(rf"({mark}\n).*?(<!-- end -->)", re.DOTALL)
    try:
        if arguments.output and not marked.search(arguments.output.read_text(encoding="utf-8")):
            raise BenchmarkError(f"{arguments.output}: has no line {mark}")
        measure_all([grasp for grasp in grasps if arguments.only in grasp.name], arguments.results)
        drawn = table(read_all(grasps, arguments.results))
        if arguments.output:
            page = arguments.output.read_text(encoding="utf-8")  # it may have changed in the meantime
            filled = marked.sub(lambda match: f"{match[1]}{drawn}\n{match[2]}", page)
            arguments.output.write_text(filled, encoding="utf-8")
        else:
            print(drawn)
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
