"""The variants of a sweep of meshes, and the table of their figures."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.table import Table

from taichisoft.base import atomic_file, plain
from taichisoft.errors import MeshError
from taichisoft_meshing.mesh_commands import overridden
from taichisoft_meshing.mesh_job import MeshJob
from taichisoft_studies.study_file import Values, combinations, toml_value

SUMMARY = "summary.csv"
NOT_PRINTED = ("tetrahedra", "folder", "problem")


@dataclass(frozen=True)
class Variant:
    """One mesh of a sweep.

    Attributes:
        values: the values that replace the file's values, as text, by key.
        job: the request for the mesh.
    """

    values: dict[str, str]
    job: MeshJob

    @property
    def name(self) -> str:
        """The name of its folder, for example "wall-1.5_body.width-20": without what a path or a shell would read."""
        return "_".join(
            f"{key}-{''.join(one if one.isalnum() or one in '.+-' else '_' for one in value).strip('_')}"
            for key, value in self.values.items()
        )


def plan(job: MeshJob, varied: Mapping[str, Values]) -> list[Variant]:
    """All combinations of the values of keys, the last key's values changing fastest.

    Raises:
        MeshError: a key leads nowhere, or two variants would have one name.
        StudyError: there are too many.
    """
    variants = []
    for chosen in combinations(varied, None, 0):
        texts = {key: value if isinstance(value, str) else toml_value(value) for key, value in chosen.items()}
        tables = overridden(job.tables, [f"{key}={toml_value(value)}" for key, value in chosen.items()])
        variants.append(Variant(texts, replace(job, tables=tables)))
    names = [variant.name for variant in variants]
    clash = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if clash is not None:
        raise MeshError(f"--vary: two variants would both be called '{clash}'")
    return variants


def summary_rows(variants: Sequence[Variant], outcomes: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """A row for each variant: the values that were varied, the figures, the folder, and the problem if it failed."""
    columns = dict.fromkeys(column for outcome in outcomes for column in outcome["figures"])
    rows = []
    for variant, outcome in zip(variants, outcomes, strict=True):
        found = [(column, outcome["figures"].get(column)) for column in columns]
        figures = {column: "" if value is None else f"{value:.10g}" for column, value in found}
        folder = "" if outcome["problem"] else variant.name
        rows.append({**variant.values, **figures, "folder": folder, "problem": outcome["problem"]})
    return rows


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
    """The rows as a table for the terminal; problems are printed in lines of their own."""
    columns = [column for column in rows[0] if column not in NOT_PRINTED]
    table = Table(title=plain(title))
    for column in columns:
        words = column.replace("_mm3", " [mm³]").replace("_", " ")
        table.add_column(plain(words), justify="right", min_width=max(len(plain(row[column])) for row in rows))
    table.add_column("", min_width=len("failed"))
    for row in rows:
        table.add_row(*(plain(row[column]) for column in columns), "failed" if row["problem"] else "")
    return table
