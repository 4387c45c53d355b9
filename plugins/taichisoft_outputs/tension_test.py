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
STRAIN = ("engineering strain", "nominal strain", "tensile strain", "strain", "dehnung")
STRETCH = ("stretch",)
STRESS = ("engineering stress", "nominal stress", "tensile stress", "stress", "spannung")
MACHINE = ("extension", "displacement", "elongation", "crosshead", "load", "force", "weg", "kraft", "standardkraft")
"""What testing machines write where they do not know the specimen."""
TURNED = 0.02
"""Share of a test's range of strains by which the strain falls back where the specimen is unloaded."""
BEGIN, SAME = (1.3, 1.4), 0.01
"""Stretches up to which the strain at no stress is looked for, and the most by which two such figures may differ."""
SLACK = 0.02
"""Strain at no stress from which it is told."""


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

    def first_loading(self) -> "TensionTest":
        """The points at which the specimen is stretched farther than ever before in the test."""
        highest = self._highest()
        chosen = self.stretch > highest
        return TensionTest(self.source, self.stretch[chosen], self.stress[chosen])

    def without_slack(self, slack: float) -> "TensionTest":
        """The same test with strains from where the specimen began to be pulled [-]."""
        return TensionTest(self.source, self.stretch - slack, self.stress)

    @property
    def cautions(self) -> "list[str]":
        """Lines on what a fit to all points would mistake: unloading among loading, and slack at the start."""
        lines, back = [], self.stretch < self._highest() - TURNED * (self.stretch.max() - self.stretch.min())
        if back.any() and (self.stretch[1:] > self.stretch[:-1]).any():  # not a table from the end to the start
            lines.append(
                f"{self.source}: the strain falls back from {self._highest()[back][0] - 1.0:.3g}, and {back.sum()} of "
                f"{len(back)} points lie below what was reached before: rubber is softer there, and the fit is between "
                "loading and unloading; --loading takes the first loading alone"
            )
        slack = self._strain_without_stress()
        if abs(slack) > SLACK:
            lines.append(
                f"{self.source}: by the slope of its first points the stress begins at a strain of {slack:.3g}: slack "
                f"or preload, which falsifies the modulus at rest; --slack {slack:.3g} takes it off all strains"
            )
        return lines

    def _highest(self) -> "np.ndarray":
        """The largest stretch before each point; 0 before the first."""
        import numpy as np

        return np.concatenate([[0.0], np.maximum.accumulate(self.stretch)[:-1]])

    def _strain_without_stress(self) -> float:
        """Where a parabola through the first part of the first loading has no stress [-]; 0 where points scatter."""
        import numpy as np

        test, found = self.first_loading(), []
        for end in BEGIN:
            begins = test.stretch <= end
            stretch, stress = test.stretch[begins], test.stress[begins]
            pulled = stress > 0.05 * stress.max(initial=0.0)
            if pulled.sum() < FEWEST:
                return 0.0
            found.append(float(np.polynomial.Polynomial.fit(stress[pulled], stretch[pulled], 2)(0.0)) - 1.0)
        return found[0] if abs(found[0] - found[1]) < SAME else 0.0


def read_tension_test(path: Path) -> TensionTest:
    """Read a table with a column of engineering strain or stretch, and one of engineering stress with its unit.

    The first line that names both is the header; what stands above it is ignored. Units may stand in brackets in the
    line below. Columns are separated by semicolons,
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
            names = [name.strip().lower() for name in _cells(line, separator)]
            units = [unit.strip().lower() for unit in _cells("".join(lines[number + 1 : number + 2]), separator)]
            has_units = len(units) == len(names) and all(re.fullmatch(r"([(\[].*[)\]])?", unit) for unit in units)
            if has_units:
                names = [f"{name} {unit}".strip() for name, unit in zip(names, units, strict=True)]
            stretch, stress = _column(names, STRETCH), _column(names, STRESS)
            strain = _column(names, STRAIN) if stretch is None else None
            along = stretch if stretch is not None else strain
            if along is None or stress is None:
                continue
            where = f"{path}, line {number + 1}"
            scale = _scale(names[stress], KPA, where)
            share = _scale(names[along], STRAINS if stretch is None else RATIOS, where)
            rows = _rows(path, lines, number + 1 + has_units, separator, (along, stress))
            along_values = share * rows[:, 0]
            if stretch is None and not _units(names[along]) and along_values.max() > HIGHEST_STRAIN:
                raise MaterialError(
                    f"{where}: '{names[along]}' reaches {along_values.max():g}: is it in per cent? say 'strain (%)', "
                    "or 'strain (-)'"
                )
            if stretch is not None and along_values.min() <= 0.0:
                raise MaterialError(
                    f"{where}: '{names[along]}' falls to {along_values.min():g}: a stretch is length over length at "
                    "rest, above 0; is it a strain?"
                )
            return TensionTest(path.name, along_values + (0.0 if stretch is not None else 1.0), scale * rows[:, 1])
    raise MaterialError(
        f"{path}: no line names a column 'strain' or 'stretch' and one 'stress (MPa)' or 'stress (kPa)'"
        f"{_named_instead(lines)}"
    )


def _cells(line: str, separator: str) -> list[str]:
    return next(csv.reader([line], delimiter=separator), [])


def _named_instead(lines: list[str]) -> str:
    """What the line above the first numbers names in place of strain and stress, and what makes these of it."""
    for separator in SEPARATORS:
        header, place = [], 0
        for number, line in enumerate(lines):
            cells = [cell.strip() for cell in _cells(line, separator)]
            if len(cells) > 1 and all(re.fullmatch(r"[-+]?[0-9][-+0-9.,eE]*", cell) for cell in cells if cell):
                break
            if len(cells) > 1 and any(re.match(r"\w", cell) for cell in cells):
                header, place = cells, number
        else:
            continue
        words = ", ".join(f"'{name}'" for name in header)
        said = f"; line {place + 1} has {words}" if header else "; its columns have no names"
        if any(name.lower().startswith(MACHINE) for name in header):
            said += ": divide the extension by the length at rest, and the load by the area at rest"
        if any(re.search(r"(true|cauchy|wahre).*(stress|spannung)", name.lower()) for name in header):
            said += ": true stress is over the area of the moment; divide it by the stretch"
        if any(re.search(r"(true|logarithmic|wahre).*(strain|dehnung)", name.lower()) for name in header):
            said += ": a true strain is the logarithm of the stretch; give exp of it"
        return said
    return ""


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
