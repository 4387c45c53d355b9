"""A soft ball on a plane and on another ball, against Hertz, on finer and finer meshes.

    python -m taichisoft_benchmarks.studies.hertz --output docs/validation.md

fills what stands between `<!-- hertz -->` and `<!-- end -->` in the page.
"""

import argparse
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.studies.hertz_balls import RADIUS, Pressed, make_half_ball, press

MARKED = re.compile(r"(<!-- hertz -->\n).*?(<!-- end -->)", re.DOTALL)
SIZES = (2.0, 1.2, 0.8, 0.6)
"""Elements at the contact [mm]."""
COARSEST_OF_TWO = 1.2
"""Balls on each other have more than twice as many contacts: they are pressed on meshes down to this one."""
SHARES = (0.02, 0.035, 0.05)
"""Approaches over the radius [-]."""
HEADINGS = (
    "on", "elements at the contact, mm", "nodes", "approach over radius", "contacts", "force, mN", "off Hertz",
    "off Hertz with the other side",
)  # fmt: skip


def rows(size: float, two: bool) -> list[str]:
    """Press a ball of elements of `size` [mm] on a plane, or on another one.

    Raises:
        TaichisoftError: meshing or the simulation failed.
    """
    mesh = make_half_ball(size)
    pressed = press(mesh, [share * RADIUS for share in SHARES], two)
    return [_row("a ball" if two else "a plane", size, len(mesh.nodes), one) for one in pressed]


def table(lines: Iterable[str]) -> str:
    """The rows with their heading, in Markdown."""
    return "\n".join([f"| {' | '.join(HEADINGS)} |", "|" + len(HEADINGS) * "---|", *lines])


def _row(against: str, size: float, nodes: int, one: Pressed) -> str:
    figures: tuple[Any, ...] = (
        against, f"{size:g}", nodes, f"{one.approach / RADIUS:.1%}", one.contacts, f"{one.force:.1f}",
        f"{one.error_of_half_space:+.1%}", f"{one.error:+.1%}",
    )  # fmt: skip
    return f"| {' | '.join(map(str, figures))} |"


def main() -> None:
    """Measure, and fill the page in place."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.studies.hertz")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE.md", help="page to fill")
    parser.add_argument("--sizes", nargs="+", type=float, default=SIZES, metavar="MM", help="elements at the contact")
    arguments = parser.parse_args()
    try:
        page = arguments.output.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.output}: has no line <!-- hertz -->")
        lines = []
        for two in (False, True):
            for size in arguments.sizes:
                if not two or size >= COARSEST_OF_TWO:
                    lines += rows(size, two)
                    print(*lines[-len(SHARES) :], sep="\n", flush=True)
        filled = MARKED.sub(lambda match: f"{match[1]}{table(lines)}\n{match[2]}", page)
        arguments.output.write_text(filled, encoding="utf-8")
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
