"""A tension test from a CSV file: stretch, and force over the area at rest."""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichisoft.errors import TaichisoftError

KPA = {"pa": 1e-3, "kpa": 1.0, "mpa": 1e3, "n/mm^2": 1e3, "n/mm2": 1e3}
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
    stretch: np.ndarray
    stress: np.ndarray

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
    commas or tabs. Engineering columns win over true ones.

    Raises:
        MaterialError: the file cannot be read, has no such columns, or something in them is no number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise MaterialError(f"{path}: cannot be read: {error.strerror}") from error
    for number, line in enumerate(lines):
        separator = max(";,\t", key=line.count)
        names = [name.strip().lower() for name in line.split(separator)]
        stretch, stress = _column(names, STRETCH), _column(names, STRESS)
        strain = _column(names, STRAIN) if stretch is None else None
        along = stretch if stretch is not None else strain
        if along is not None and stress is not None:
            unit = re.search(r"[(\[](.*?)[)\]]", names[stress])
            scale = KPA.get(unit.group(1)) if unit else None
            if scale is None:
                raise MaterialError(f"{path}, line {number + 1}: '{names[stress]}' needs a unit: {', '.join(KPA)}")
            rows = _rows(path, lines, number + 1, separator, (along, stress))
            return TensionTest(path.name, rows[:, 0] + (0.0 if stretch is not None else 1.0), scale * rows[:, 1])
    raise MaterialError(
        f"{path}: no line names a column 'strain' or 'stretch' and one 'stress (MPa)' or 'stress (kPa)'"
    )


def _column(names: list[str], kinds: tuple[str, ...]) -> int | None:
    """Place of the first column whose name begins with one of these, in their order."""
    found = [place for kind in kinds for place, name in enumerate(names) if name.startswith(kind)]
    return found[0] if found else None


def _rows(path: Path, lines: list[str], first: int, separator: str, columns: tuple[int, int]) -> np.ndarray:
    rows = []
    for number, row in enumerate(csv.reader(lines[first:], delimiter=separator), start=first + 1):
        if not any(cell.strip() for cell in row):
            continue
        try:
            values = [float(row[column]) for column in columns]
        except (ValueError, IndexError) as error:
            raise MaterialError(f"{path}, line {number}: {separator.join(row)[:60]!r} lacks a number") from error
        if not all(math.isfinite(value) for value in values):
            raise MaterialError(f"{path}, line {number}: a value is not finite")
        rows.append(values)
    if not rows:
        raise MaterialError(f"{path}: no numbers follow the names of the columns")
    return np.array(rows)
