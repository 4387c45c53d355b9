"""Keyframes as comma-separated values: a row for each, with columns "time [s]", "pressure finger1 [kPa]" ..."""

import csv
import re
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
"""Columns and their units. Instead of "pressure" there may be several "pressure NAME" of fingers or cavities; likewise
for "pull" and "tension"."""
HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(\[\s*(?P<unit>[^\[\]]*?)\s*\])?\s*")


def read_keyframes(text: str) -> dict[str, Any]:
    """Give the tables that the same script has in TOML. Empty lines and lines that begin with # are comments.

    Raises:
        SceneError: a column is unknown, there twice or in another unit, or a cell is not a number.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    try:
        headings, *rows = csv.reader(lines, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise SceneError(f"needs a first line with the names of the columns, as in: time,pressure ({error})") from error
    columns = [_column(heading) for heading in headings]
    twice = next((name for name in columns if columns.count(name) > 1), None)
    if twice is not None:
        raise SceneError(f"there are {columns.count(twice)} columns '{twice}'; keep one")
    for effort in EFFORTS:
        by_name = [name for name in columns if name.startswith(f"{effort} ")]
        if effort in columns and by_name:
            raise SceneError(f"the columns '{effort}' and '{by_name[0]}' exclude each other")
    if "time" not in columns:
        raise SceneError(f"the column 'time' is missing; columns are: {', '.join(columns)}")
    return {"keyframes": [_keyframe(columns, row) for row in rows]}


def _column(heading: str) -> str:
    """The name of a column, without its unit."""
    match = HEADING.fullmatch(heading)
    name, unit = (" ".join(match["name"].split()), match["unit"]) if match else (heading, None)
    first = name.partition(" ")[0]
    known = first if first in EFFORTS else name
    if known not in UNITS:
        raise SceneError(f"column '{heading}': unknown; {nearest(name, list(UNITS), 'valid columns')}")
    if unit not in (None, UNITS[known]):
        raise SceneError(f"column '{heading}': its unit is {UNITS[known]}, not {unit}")
    return name


def _keyframe(columns: list[str], cells: list[str]) -> dict[str, Any]:
    """The table of a keyframe, whose values the script's tables check."""
    if len(cells) != len(columns):
        raise SceneError(f"{','.join(cells)}: has {len(cells)} cells; {len(columns)} are needed, one for each column")
    try:
        values = {name: float(cell) for name, cell in zip(columns, cells, strict=True)}
    except ValueError as error:
        raise SceneError(f"{','.join(cells)}: each cell must be a number, as in 0.5: {error}") from error
    keyframe: dict[str, Any] = {"time": values["time"]}
    for effort in EFFORTS:
        by_name = {name.removeprefix(f"{effort} "): values[name] for name in columns if name.startswith(f"{effort} ")}
        keyframe[effort] = by_name or values.get(effort)
    for key in ("base_translation", "base_rotation"):
        keyframe[key] = [values.get(f"{key} {axis}", 0.0) for axis in "xyz"]
    return keyframe
