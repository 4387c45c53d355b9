"""The rows of the table: name, number of tries, and a function that makes tries and gives a line for each failure."""

from collections.abc import Callable

from taichisoft_benchmarks.faults import (
    damaged_files,
    driving,
    interrupted_sweep,
    mechanics,
    ports,
    soak,
    sofa_scenes,
    tries,
    web_page_requests,
)

Attempt = Callable[[int], list[str]]
MODULES = (damaged_files, tries, web_page_requests, soak, ports, driving, mechanics, sofa_scenes, interrupted_sweep)
ROWS: dict[str, tuple[int, Attempt]] = {name: row for module in MODULES for name, row in module.ROWS.items()}
