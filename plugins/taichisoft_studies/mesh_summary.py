"""One table and one CSV file of all variants of a sweep of meshes."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.terminal_text import plain
from taichisoft_studies.mesh_plan import Variant

SUMMARY = "summary.csv"
FAILED = "failed"
LEFT_OUT = ("tetrahedra", "folder", "problem")


def summary_rows(variants: Sequence[Variant], outcomes: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """A row for each variant: the values that were varied, the figures, the folder, and what went wrong."""
    columns = dict.fromkeys(column for outcome in outcomes for column in outcome["figures"])
    return [
        {
            **variant.values,
            **{column: _text(outcome["figures"], column) for column in columns},
            "folder": "" if outcome["problem"] else variant.name,
            "problem": outcome["problem"],
        }
        for variant, outcome in zip(variants, outcomes, strict=True)
    ]


def write_summary(rows: Sequence[Mapping[str, str]], folder: Path) -> Path:
    """Write the rows to a CSV file.

    Raises:
        MeshError: it cannot be written.
    """
    path = folder / SUMMARY
    with atomic_file(path, MeshError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def summary_table(rows: Sequence[Mapping[str, str]], title: str) -> Table:
    """The rows for people, as far as they fit on a screen; what went wrong is said in lines of its own."""
    columns = [column for column in rows[0] if column not in LEFT_OUT]
    table = Table(title=plain(title))
    for column in columns:
        words = column.replace("_mm3", " [mm³]").replace("_", " ")
        table.add_column(plain(words), justify="right", min_width=max(len(plain(row[column])) for row in rows))
    table.add_column("", min_width=len(FAILED))
    for row in rows:
        table.add_row(*(plain(row[column]) for column in columns), FAILED if row["problem"] else "")
    return table


def _text(figures: Mapping[str, float | int | None], column: str) -> str:
    value = figures.get(column)
    return "" if value is None else f"{value:.10g}"
