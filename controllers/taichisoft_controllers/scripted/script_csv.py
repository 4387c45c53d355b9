"""Keyframes as comma-separated values: a row for each, with columns "time [s]", "pressure finger1 [kPa]" ..."""

import csv
import math
import re
from collections.abc import Sequence
from typing import Any

from taichisoft.errors import SceneError, nearest
from taichisoft_controllers.drives import DRIVES

EFFORTS = tuple(drive.name for drive in DRIVES)
UNITS = {
    "time": "s",
    **{drive.name: drive.unit for drive in DRIVES},
    **{f"base_translation {axis}": "mm" for axis in "xyz"},
    **{f"base_rotation {axis}": "degrees" for axis in "xyz"},
}
"""Columns and their units. Instead of "pressure" there may be several "pressure NAME" of fingers or cavities; so with
"pull" and "tension"."""

HEADING = re.compile(r"(?P<name>[^\[\]]*?)\s*(\[(?P<unit>[^\[\]]*)\])?")


def read_keyframes(text: str) -> dict[str, Any]:
    """Give the tables that the same script has in TOML. Empty lines and those that begin with # are comments.

    Raises:
        SceneError: a column is unknown, there twice or in another unit, or a cell is no finite number.
    """
    lines = enumerate(text.splitlines(), start=1)
    rows = [(number, line) for number, line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise SceneError("is empty; the first line has the names of the columns, as in: time,pressure")
    cells = [_cells(*row) for row in rows]
    columns = [_column(heading) for heading in cells[0]]
    for name in columns:
        if columns.count(name) > 1:
            raise SceneError(f"line {rows[0][0]}: there are {columns.count(name)} columns '{name}'; keep one")
    for effort in EFFORTS:
        by_name = [name for name in columns if name.startswith(f"{effort} ")]
        if effort in columns and by_name:
            raise SceneError(f"line {rows[0][0]}: the columns '{effort}' and '{by_name[0]}' exclude each other")
    efforts = "', '".join(EFFORTS[:-1]) + f"' or '{EFFORTS[-1]}"
    driven = any(_quantity(name) in EFFORTS for name in columns)
    for needed, found in (("time", "time" in columns), (efforts, driven)):
        if not found:
            raise SceneError(f"line {rows[0][0]}: there is no column '{needed}'; there are: {', '.join(columns)}")
    return {"keyframes": [_keyframe(row[0], columns, line) for row, line in zip(rows[1:], cells[1:], strict=True)]}


def _cells(number: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line], skipinitialspace=True))
    except csv.Error as error:
        raise SceneError(f"line {number}: {error}") from error


def _column(heading: str) -> str:
    """The name of a column, without its unit."""
    match = HEADING.fullmatch(heading.strip())
    name, unit = (match["name"], match["unit"]) if match else (heading, None)
    name = " ".join(name.split())
    known = _quantity(name)
    if known not in UNITS:
        raise SceneError(f"column '{heading}': unknown; {nearest(name, list(UNITS), 'valid columns')}")
    if unit is not None and unit.strip() != UNITS[known]:
        raise SceneError(f"column '{heading}': its unit is {UNITS[known]}, not {unit}")
    return name


def _quantity(column: str) -> str:
    """The key of `UNITS` for a column "pressure finger1"."""
    first = column.partition(" ")[0]
    return first if first in EFFORTS else column


def _keyframe(number: int, columns: Sequence[str], cells: Sequence[str]) -> dict[str, Any]:
    if len(cells) != len(columns):
        raise SceneError(f"line {number}: has {len(cells)} cells; {len(columns)} are needed, one for each column")
    values = {name: _value(number, name, cell) for name, cell in zip(columns, cells, strict=True)}
    keyframe: dict[str, Any] = {"time": values["time"]}
    for effort in EFFORTS:
        prefix = f"{effort} "
        by_name = {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
        keyframe[effort] = by_name or values.get(effort)
    for key in ("base_translation", "base_rotation"):
        keyframe[key] = [values.get(f"{key} {axis}", 0.0) for axis in "xyz"]
    return keyframe


def _value(number: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SceneError(f"line {number}, column '{column}': '{cell}' must be a finite number, as in 0.5")
    return value
