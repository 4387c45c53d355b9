"""Tables of numbers as testing machines and spreadsheets write them."""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichisoft.errors import TaichisoftError

SEPARATORS = "\t;,"
NUMBER = re.compile(r"[-+]?[.,]?[0-9][-+0-9.,eE]*|[-+]?(nan|inf)", re.IGNORECASE)
"""What is meant as a number, well written or not."""
UNIT = re.compile(r"\s*[(\[]([^()\[\]]*)[)\]]\s*$")
"""A unit in brackets at the end of a column's name."""
BARE_UNIT = re.compile(r"|%|-|s|min|[mc]?m|[km]?n|[km]?pa|bar|deg|°|n/mm[²2]")
"""What may stand without brackets in a line of units, in small letters."""


@dataclass(frozen=True)
class MeasuredTable:
    """The cells of a table below the names of its columns.

    Attributes:
        path: the file.
        header: number of the line with the names of the columns, from 1; 0 where they have none.
        names: of the columns, with their units; "" of a column without a name.
        rows: cells of each row.
        lines: number of the line of each row, from 1.
        separator: between two cells.
        has_commas: whether decimals follow a comma.
        error: class of the errors about it.
    """

    path: Path
    header: int
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    separator: str
    has_commas: bool
    error: type[TaichisoftError]

    def place(self, column: str | int) -> int | None:
        """Index of a column by its name, with or without unit, or by its number from 1; None without such a one."""
        for names in (self.names, [UNIT.sub("", name) for name in self.names]):
            count = names.count(str(column)) if column else 0
            if count > 1:
                raise self.error(f"{self.path}: two columns are called '{column}'; give the number of one, from 1")
            if count:
                return names.index(str(column))
        number = int(column) if str(column).isdecimal() else 0
        return number - 1 if 1 <= number <= len(self.names) else None

    def number(self, row: int, place: int) -> float:
        """The number in a cell."""
        cells = self.rows[row]
        try:
            value = _number(cells[place], self.has_commas)
        except (ValueError, IndexError) as error:
            shown = self.separator.join(cells)[:60]
            where = f"{self.path}, line {self.lines[row]}: {shown!r} lacks a number"
            raise self.error(f"{where}, column {place + 1} {self.names[place]!r}") from error
        if not math.isfinite(value):
            raise self.error(f"{self.path}, line {self.lines[row]}: a value is not finite")
        return value

    def is_blank(self, row: int, place: int) -> bool:
        """Whether a cell is empty."""
        return not "".join(self.rows[row][place : place + 1])


class MeasuredRow(Mapping[str | int, float]):
    """The numbers of a row by the names and the numbers of the columns, each read when it is looked at."""

    def __init__(self, table: MeasuredTable, row: int):
        self._table, self._row = table, row

    def __getitem__(self, column: str | int) -> float:
        place = self._table.place(column)
        if place is None:
            raise KeyError(column)
        return self._table.number(self._row, place)

    def __contains__(self, column: object) -> bool:
        return self._table.place(str(column)) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(filter(None, self._table.names))

    def __len__(self) -> int:
        return len(self._table.names)


def read_measured_table(path: Path, error: type[TaichisoftError]) -> MeasuredTable:
    """Read a table whose columns are separated by semicolons, commas or tabs.

    Its header is the first line of several names that numbers follow; what stands above it is ignored, and units may
    stand in the line below. Cells may stand in quotes, and numbers have decimal points or commas.

    Raises:
        error: the file cannot be read, or holds no such table.
    """
    lines = _text(path, error).splitlines()
    best: tuple[float, str, int, list[list[str]]] = -1.0, ",", -1, []
    for separator in SEPARATORS:
        try:
            rows = [[cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])] for line in lines]
        except csv.Error as problem:
            raise error(f"{path}: cannot be read as a table: {problem}") from problem
        for line, cells in enumerate(rows):
            share = _share_of_numbers(next(filter(any, rows[line + 1 + _has_units(rows, line) :]), []))
            if sum(map(bool, cells)) > 1 and not _share_of_numbers(cells) and share > best[0]:
                best = share, separator, line, rows
    share, separator, line, rows = best
    if share <= 0.0:
        return _without_header(path, lines, error, None if line < 0 else line + 1)
    names, first = rows[line], line + 1
    if _has_units(rows, line):
        units = [unit if not unit or UNIT.fullmatch(unit) else f"({unit})" for unit in rows[first]]
        names = [f"{name} {unit}".strip() for name, unit in zip(names, units, strict=True)]
        first += 1
    return _table(path, line + 1, names, rows, first, separator, error)


def _without_header(path: Path, lines: list[str], error: type[TaichisoftError], header: int | None) -> MeasuredTable:
    """The table of a file of numbers alone."""
    if header is None:
        for separator in SEPARATORS:
            rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=separator)]
            first = next((line for line, row in enumerate(rows) if len(row) > 1 and _share_of_numbers(row) == 1.0), -1)
            if first >= 0:
                return _table(path, 0, [""] * len(rows[first]), rows, first, separator, error)
    where = f"{path}" if header is None else f"{path}, line {header}"
    raise error(f"{where}: no numbers follow the names of the columns")


def _table(
    path: Path,
    header: int,
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    first: int,
    separator: str,
    error: type[TaichisoftError],
) -> MeasuredTable:
    while names and not names[-1]:
        names = names[:-1]
    names = names or [""] * len(rows[first])
    numbered = [(number, tuple(row)) for number, row in enumerate(rows[first:], first + 1) if any(row)]
    for number, row in numbered:
        if any(row[len(names) :]):
            raise error(
                f"{path}, line {number}: has {len(row)} cells for {len(names)} columns; where commas are in the "
                "numbers, semicolons or tabs separate columns"
            )
    commas = _has_decimal_commas([cell for _, row in numbered for cell in row])
    kept, lines = tuple(row for _, row in numbered), tuple(number for number, _ in numbered)
    return MeasuredTable(path, header, tuple(names), kept, lines, separator, commas, error)


def _text(path: Path, error: type[TaichisoftError]) -> str:
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise error(f"{path}: cannot be read: {problem.strerror}") from problem
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def _share_of_numbers(cells: Sequence[str]) -> float:
    filled = [cell for cell in cells if cell]
    return sum(bool(NUMBER.fullmatch(cell)) for cell in filled) / max(1, len(filled))


def _has_units(rows: Sequence[Sequence[str]], line: int) -> bool:
    """Whether the line below the names has a unit, or nothing, for each."""
    units = rows[line + 1] if line + 1 < len(rows) else []
    known = all(BARE_UNIT.fullmatch(unit.lower()) or UNIT.fullmatch(unit) for unit in units)
    return len(units) == len(rows[line]) and any(units) and known


def _has_decimal_commas(cells: Sequence[str]) -> bool:
    """Whether commas are decimal signs: they stand last in numbers that also have points, or no number has a point."""
    numbers = [cell for cell in cells if any(_is_number(cell, comma) for comma in (True, False))]
    both = [cell for cell in numbers if "," in cell and "." in cell]
    if both:
        return all(cell.rindex(",") > cell.rindex(".") for cell in both)
    return not any("." in cell for cell in numbers)


def _is_number(cell: str, comma: bool) -> bool:
    try:
        _number(cell, comma)
    except ValueError:
        return False
    return True


def _number(cell: str, comma: bool) -> float:
    """The number in a cell; the sign that is not the decimal one separates thousands."""
    thousands, sign = (".", ",") if comma else (",", ".")
    whole, point, decimals = cell.partition(sign)
    parts = whole.split(thousands)
    if len(parts) > 1 and not (all(len(part) == 3 for part in parts[1:]) and 1 <= len(parts[0].lstrip("+-")) <= 3):
        raise ValueError(f"{cell!r} is not a number")
    return float("".join(parts) + point.replace(",", ".") + decimals)
