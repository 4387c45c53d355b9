"""A tension test from a CSV file: stretch, and force over the area at rest."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:
    import numpy as np

KPA = {"pa": 1e-3, "kpa": 1.0, "mpa": 1e3, "n/mm^2": 1e3, "n/mm2": 1e3, "n/mm²": 1e3}
RATIOS = {"": 1.0, "-": 1.0, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0}
STRAINS = {"%": 0.01, "percent": 0.01, "per cent": 0.01, **RATIOS}
KINDS = ("engineering", "nominal")
"""Words in the brackets of a column's name that are not units."""
HIGHEST_STRAIN = 20.0
"""No rubber is stretched so far: strains beyond it are in per cent."""
SEPARATORS = "\t;,"
FEWEST = 5
"""Points that a fit needs."""
STRAIN = ("engineering strain", "nominal strain", "strain")
STRETCH = ("stretch",)
STRESS = ("engineering stress", "nominal stress", "stress")


class MaterialError(TaichisoftError):
    """A test or a fit is not valid; says what would be."""


@dataclass(frozen=True)
class TensionTest:
    """A specimen pulled along one axis.

    Attributes:
        source: name of the file.
        stretch: length over length at rest [-], shape (count,).
        stress: force over area at rest [kPa], shape (count,).
    """

    source: str
    stretch: "np.ndarray"
    stress: "np.ndarray"

    def within(self, lowest_strain: float, highest_stretch: float) -> "TensionTest":
        """The points of these strains.

        Raises:
            MaterialError: fewer than five are left.
        """
        chosen = (self.stretch >= 1.0 + lowest_strain) & (self.stretch <= highest_stretch)
        if chosen.sum() < FEWEST:
            raise MaterialError(
                f"{self.source}: {int(chosen.sum())} points lie between the strain {lowest_strain:g} and the stretch "
                f"{highest_stretch:g}; at least {FEWEST} are needed; the test reaches {self.stretch.max():.3g}"
            )
        return TensionTest(self.source, self.stretch[chosen], self.stress[chosen])


def read_tension_test(path: Path) -> TensionTest:
    """Read a table with a column of engineering strain or stretch, and one of engineering stress with its unit.

    The first line that names both is the header; what stands above it is ignored. Columns are separated by semicolons,
    commas or tabs; names and numbers may stand in quotes, and numbers have decimal points or commas. A strain is in per
    cent where its name says so ("Strain (%)"). Engineering columns win over true ones.

    Raises:
        MaterialError: the file cannot be read, has no such columns, their units are unknown or missing, or a value in
            them is not a number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise MaterialError(f"{path}: cannot be read: {error.strerror}") from error
    for number, line in enumerate(lines):
        for separator in SEPARATORS:
            names = [name.strip().lower() for name in next(csv.reader([line], delimiter=separator), [])]
            stretch, stress = _column(names, STRETCH), _column(names, STRESS)
            strain = _column(names, STRAIN) if stretch is None else None
            along = stretch if stretch is not None else strain
            if along is None or stress is None:
                continue
            where = f"{path}, line {number + 1}"
            scale = _scale(names[stress], KPA, where)
            share = _scale(names[along], STRAINS if stretch is None else RATIOS, where)
            rows = _rows(path, lines, number + 1, separator, (along, stress))
            along_values = share * rows[:, 0]
            if stretch is None and not _units(names[along]) and along_values.max() > HIGHEST_STRAIN:
                raise MaterialError(
                    f"{where}: '{names[along]}' reaches {along_values.max():g}: is it in per cent? say 'strain (%)', "
                    "or 'strain (-)'"
                )
            return TensionTest(path.name, along_values + (0.0 if stretch is not None else 1.0), scale * rows[:, 1])
    raise MaterialError(
        f"{path}: no line names a column 'strain' or 'stretch' and one 'stress (MPa)' or 'stress (kPa)'"
    )


def _column(names: list[str], kinds: tuple[str, ...]) -> int | None:
    """Place of the first column whose name begins with one of these, in their order; a rate is another quantity."""
    found = [
        place for kind in kinds for place, name in enumerate(names) if name.startswith(kind) and "rate" not in name
    ]
    return found[0] if found else None


def _units(name: str) -> list[str]:
    """What a column's name has in brackets, and per cent wherever it stands."""
    inside = [unit.strip() for unit in re.findall(r"[(\[](.*?)[)\]]", name)]
    bare = re.sub(r"[(\[].*?[)\]]", "", name)
    return [unit for unit in inside if unit not in KINDS] + ["%"] * ("%" in bare or "percent" in bare)


def _scale(name: str, units: Mapping[str, float], where: str) -> float:
    """What a column's numbers are multiplied by, for the unit that its name has.

    Raises:
        MaterialError: it has none where one is needed, two, or another one.
    """
    found = _units(name) or ([""] if "" in units else [])
    if len(found) != 1 or found[0] not in units:
        raise MaterialError(f"{where}: '{name}' needs a unit: {', '.join(unit or 'none' for unit in units)}")
    return units[found[0]]


def _rows(path: Path, lines: list[str], first: int, separator: str, columns: tuple[int, int]) -> "np.ndarray":
    import numpy as np  # which `taichisoft materials` need not wait for

    read = list(enumerate(csv.reader(lines[first:], delimiter=separator), start=first + 1))
    cells = [row[column] for _, row in read for column in columns if column < len(row)]
    comma = _has_decimal_commas(cells)
    rows = []
    for number, row in read:
        if not any(cell.strip() for cell in row):
            continue
        try:
            values = [_number(row[column], comma) for column in columns]
        except (ValueError, IndexError) as error:
            raise MaterialError(f"{path}, line {number}: {separator.join(row)[:60]!r} lacks a number") from error
        if not all(math.isfinite(value) for value in values):
            raise MaterialError(f"{path}, line {number}: a value is not finite")
        rows.append(values)
    if not rows:
        raise MaterialError(f"{path}: no numbers follow the names of the columns")
    return np.array(rows)


def _has_decimal_commas(cells: Sequence[str]) -> bool:
    """Whether commas are decimal signs: they stand last in numbers that also have points, or no number has a point."""
    both = [cell for cell in cells if "," in cell and "." in cell]
    if both:
        return all(cell.rindex(",") > cell.rindex(".") for cell in both)
    return not any("." in cell for cell in cells)


def _number(cell: str, comma: bool) -> float:
    """The number in a cell; the sign that is not the decimal one separates thousands."""
    thousands, sign = (".", ",") if comma else (",", ".")
    whole, point, decimals = cell.strip().partition(sign)
    parts = whole.split(thousands)
    if len(parts) > 1 and not (all(len(part) == 3 for part in parts[1:]) and 1 <= len(parts[0].lstrip("+-")) <= 3):
        raise ValueError(f"{cell!r} is not a number")
    return float("".join(parts) + point.replace(",", ".") + decimals)
