"""Fills the tables of docs/performance.md from results: `python -m taichisoft_benchmarks.page RESULT.json PAGE.md`.

Only what stands between `<!-- bench:SECTION -->` and `<!-- end -->` is replaced; the text around it is written by
hand. The plots are drawn beside the page.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path

from taichisoft.errors import TaichisoftError, nearest
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.page_tables import (
    factorisation_table,
    growth_table,
    machine_lines,
    other_table,
    peers_table,
    phases_table,
    start_table,
    targets_table,
    threads_table,
    time_step_table,
    tolerance_table,
)
from taichisoft_benchmarks.plots import draw_plots
from taichisoft_benchmarks.results import Results, read_results

SECTIONS: dict[str, Callable[[Results], str]] = {
    "machine": machine_lines,
    "targets": targets_table,
    "factorisation": factorisation_table,
    "threads": threads_table,
    "nodes": lambda results: growth_table(results, "growth_nodes"),
    "contacts": lambda results: growth_table(results, "growth_contacts"),
    "fingers": lambda results: growth_table(results, "growth_fingers"),
    "tolerance": tolerance_table,
    "time_step": time_step_table,
    "start": start_table,
    "other": other_table,
    "peers": peers_table,
    "phases": phases_table,
}

MARKED = re.compile(r"<!-- bench:(\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


def fill_page(page: str, results: Results) -> str:
    """The page with every marked section made anew.

    Raises:
        BenchmarkError: a marker names no section.
    """

    def section(match: re.Match[str]) -> str:
        name = match[1]
        if name not in SECTIONS:
            raise BenchmarkError(f"bench:{name}: no such section; {nearest(name, list(SECTIONS), 'there are')}")
        return f"<!-- bench:{name} -->\n{SECTIONS[name](results)}\n<!-- end -->"

    return MARKED.sub(section, page)


def main() -> None:
    """Fill the page in place and draw the plots beside it."""
    if len(sys.argv) != 3:
        sys.exit("usage: python -m taichisoft_benchmarks.page RESULT.json PAGE.md")
    path = Path(sys.argv[2])
    try:
        results = read_results(Path(sys.argv[1]))
        path.write_text(fill_page(path.read_text(encoding="utf-8"), results), encoding="utf-8")
        draw_plots(results, path.parent)
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
