"""Rows of the table that are made by one function each: how many tries, and what makes them and gives the failures."""

from collections.abc import Callable

from taichisoft_benchmarks.faults import doors, driving, mechanics, sofa_scenes

EDGES: dict[str, tuple[int, Callable[[int], list[str]]]] = {
    row: (module.TRIES[row], attempt)
    for module in (doors, driving, mechanics, sofa_scenes)
    for row, attempt in module.ROWS.items()
}
