"""The table of a study: a row for each run, in the order of the plan."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.base import atomic_file, extra, is_file, require
from taichisoft_studies.errors import StudyError

CSV, PARQUET = "results.csv", "results.parquet"
WALL_CLOCK = ("step_time_median_ms", "real_time_factor")
"""Metrics of the machine's speed, left out so that equal sweeps give equal tables."""
FIXED = ("run", "status", "message", "seed", "folder")
WRITTEN_AGAIN = "the study's command, started again, writes it from the runs"
LONGEST_PROBLEM = 300
"""Characters of what pyarrow says that are shown."""


def flat(values: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    """Tables and lists within a table as one table with dotted keys."""
    columns: dict[str, Any] = {}
    for key, value in values.items():
        inner = dict(enumerate(value)) if isinstance(value, list) else value
        columns |= flat(inner, f"{prefix}{key}.") if isinstance(inner, Mapping) else {f"{prefix}{key}": value}
    return columns


def result_row(record: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """The row of a run: its values, status, metrics ("metrics.NAME") and folder."""
    metrics = {key: value for key, value in flat(record["metrics"]).items() if key.split(".")[-1] not in WALL_CLOCK}
    return {
        "run": record["run"],
        **{key: _cell(value) for key, value in record["parameters"].items()},
        "seed": record["seed"],
        "status": record["status"],
        "message": record["message"],
        **{f"metrics.{key}": value for key, value in metrics.items()},
        "folder": folder,
    }


def write_table(rows: Sequence[Mapping[str, Any]], folder: Path) -> Path:
    """Write results.csv and results.parquet; returns the path of the first."""
    require("the table of results", "pandas", "pyarrow", install=extra("studies"))
    import pandas

    columns = list(dict.fromkeys(column for row in rows for column in row))
    table = pandas.DataFrame([dict(row) for row in rows], columns=columns)
    for column in table.columns:  # parquet has no place for a column with values of several types
        if len({type(value) for value in table[column].dropna()}) > 1:
            table[column] = table[column].map(lambda value: None if value is None else str(value))
    with atomic_file(folder / CSV, StudyError) as partial:
        table.to_csv(partial, index=False)
    with atomic_file(folder / PARQUET, StudyError) as partial:
        table.to_parquet(partial, index=False, write_page_checksum=True)
    return folder / CSV


def read_table(folder: Path) -> Any:
    """The table of a study, a pandas.DataFrame."""
    require("the table of results", "pandas", "pyarrow", install=extra("studies"))
    import pandas

    path = folder / PARQUET
    if not is_file(path):
        raise StudyError(f"{folder}: has no {PARQUET}; a study's folder is needed (taichisoft study sweep -o FOLDER)")
    try:
        table = pandas.read_parquet(path, page_checksum_verification=True)
    except Exception as error:  # whatever pyarrow and pandas come upon in a damaged file
        problem = " ".join(str(error).split())[:LONGEST_PROBLEM]
        raise StudyError(f"{path}: damaged ({type(error).__name__}: {problem}); {WRITTEN_AGAIN}") from error
    missing = [column for column in FIXED if column not in table]
    if missing:
        raise StudyError(f"{path}: no table of a study, or damaged: no column '{missing[0]}'; {WRITTEN_AGAIN}")
    return table


def _cell(value: Any) -> Any:
    return str(value) if isinstance(value, list | tuple | dict) else value
