"""Tension tests: read, fitted by laws of rubber, plotted."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.base import require
from taichisoft.runtime import RUBBER_LAWS, RubberLaw
from taichisoft.scene import Law, Material, initial_shear_modulus
from taichisoft_outputs.material_files import MaterialError

# Nominal stress of incompressible rubber pulled along one axis, by each law; Hooke's is E (l - 1).


def nominal_stress(law: Law, coefficients: Mapping[str, float], stretch: np.ndarray) -> np.ndarray:
    """Force over the area at rest [kPa], shape (count,), at stretches of that shape."""
    if law == "hooke":
        return coefficients["young_modulus"] * (stretch - 1.0)
    return RUBBER_LAWS[law].tension(coefficients, stretch)


# A tension test from a CSV file: stretch, and force over the area at rest.

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
        """The points of these strains."""
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
    def cautions(self) -> list[str]:
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

    def _highest(self) -> np.ndarray:
        """The largest stretch before each point; 0 before the first."""
        return np.concatenate([[0.0], np.maximum.accumulate(self.stretch)[:-1]])

    def _strain_without_stress(self) -> float:
        """Where a parabola through the first part of the first loading has no stress [-]; 0 where points scatter."""
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
    found = _units(name) or ([""] if "" in units else [])
    if len(found) != 1 or found[0] not in units:
        raise MaterialError(f"{where}: '{name}' needs a unit: {', '.join(unit or 'none' for unit in units)}")
    return units[found[0]]


def _rows(path: Path, lines: list[str], first: int, separator: str, columns: tuple[int, int]) -> np.ndarray:
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


# Stress over stretch: what was measured, and what laws make of it.

FORMATS = (".png", ".svg")


def draw_materials(
    materials: Mapping[str, Material], tests: Mapping[str, TensionTest], path: Path, columns: int = 4
) -> None:
    """A panel for each material: points of its test where there is one, its law up to its highest stretch."""
    if path.suffix.lower() not in FORMATS:
        raise MaterialError(f"{path}: a picture must end in {' or '.join(FORMATS)}")
    require("a plot of materials", "matplotlib")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    columns = min(columns, len(materials))
    rows = -(-len(materials) // columns)
    figure = Figure(figsize=(3.2 * columns, 2.4 * rows), layout="constrained")
    panels: Sequence[Any] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, (name, material) in zip(panels, materials.items(), strict=False):
        _draw(panel, material, tests.get(name))
        panel.set_title(material.name, fontsize=9)
    for panel in panels[len(materials) :]:
        panel.set_axis_off()
    figure.supxlabel("stretch [-]", fontsize=9)
    figure.supylabel("force over area at rest [kPa]", fontsize=9)
    with matplotlib.rc_context({"svg.hashsalt": "taichisoft"}):  # the same file every time
        figure.savefig(path, dpi=120, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _draw(panel: Any, material: Material, test: TensionTest | None) -> None:
    if test is not None:
        shown = test.stretch <= 1.15 * material.highest_stretch
        panel.plot(test.stretch[shown], test.stress[shown], ".", color="0.6", markersize=3, label="measured")
    stretch = np.linspace(1.0, material.highest_stretch, 100)
    stress = nominal_stress(material.law, material.coefficients, stretch)
    panel.plot(stretch, stress, color="C0", linewidth=1.2, label=material.law)
    panel.legend(fontsize=7, frameon=False)
    panel.tick_params(labelsize=7)


# Fitting the coefficients of a law to a tension test, by least squares of the nominal stress.

HOOKE_STRAIN = 0.2
"""Strain up to which Hooke's law is fitted: at 0.2 the neo-Hookean stress lies 15 % below E e."""
POINTS_PER_COEFFICIENT = 5
"""Points that a coefficient needs, so that their errors of measurement cancel out."""


@dataclass(frozen=True)
class LawFit:
    """A law with coefficients.

    Attributes:
        law, coefficients: as in a material's file.
        highest_stretch: up to which it was fitted [-].
        error: root mean square of the misfit over the largest stress [-].
        worst: largest misfit over the largest stress [-].
        points: number of points that it was fitted to.
    """

    law: Law
    coefficients: dict[str, float]
    highest_stretch: float
    error: float
    worst: float
    points: int

    @property
    def caution(self) -> str:
        """A line where the points are too few for the coefficients; empty otherwise."""
        count = len(self.coefficients)
        if self.points >= POINTS_PER_COEFFICIENT * count:
            return ""
        return (
            f"{self.points} points for {count} coefficients: with less than {POINTS_PER_COEFFICIENT * count} the curve "
            "follows the errors of the points, and its error says little; measure more, or take a law of fewer"
        )

    @property
    def young_modulus(self) -> float:
        """At rest, of incompressible rubber [kPa]."""
        return 3.0 * initial_shear_modulus(self.law, self.coefficients)


def fit_law(test: TensionTest, law: Law, terms: int = 1) -> LawFit:
    """Fit a law to all points of a test; Hooke's law to the points of small strain.

    Args:
        test: points, see `TensionTest.within`.
        law: its name.
        terms: number of terms, of a law that has several.
    """
    if law == "hooke":
        test = test.within(0.0, 1.0 + HOOKE_STRAIN)
        coefficients = _fit_linear(test, law, ["young_modulus"])
    else:
        coefficients = _fit_rubber(test, law, RUBBER_LAWS[law], terms)
    _refuse_no_rubber(test, law, coefficients)
    misfit = nominal_stress(law, coefficients, test.stretch) - test.stress
    scale = np.abs(test.stress).max()
    error, worst = np.sqrt((misfit**2).mean()) / scale, np.abs(misfit).max() / scale
    return LawFit(law, coefficients, float(test.stretch.max()), float(error), float(worst), len(test.stretch))


def _fit_rubber(test: TensionTest, law: Law, rubber: RubberLaw, terms: int) -> dict[str, float]:
    if rubber.terms == 1:
        terms = 1
    elif not 1 <= terms <= rubber.terms:
        raise MaterialError(f"law '{law}' has 1 to {rubber.terms} terms, not {terms}")
    units = {
        name: one.unit
        for term in range(terms)
        for name, one in zip(rubber.term_names(term), rubber.coefficients, strict=True)
    }
    moduli = [name for name, unit in units.items() if unit == "kPa"]
    if len(moduli) < len(units):
        return _fit_search(test, law, rubber, terms, moduli)
    for count in range(len(moduli), 0, -1):
        coefficients = _fit_linear(test, law, moduli[:count])
        if not rubber.last_not_negative or coefficients[moduli[count - 1]] >= 0.0:
            break
    return coefficients


def _fit_linear(
    test: TensionTest, law: Law, moduli: list[str], pure_numbers: Mapping[str, float] = MappingProxyType({})
) -> dict[str, float]:
    """Linear least squares: for given pure numbers the stress is in proportion to each modulus."""
    each = [nominal_stress(law, {**pure_numbers, modulus: 1.0}, test.stretch) for modulus in moduli]
    found = np.linalg.lstsq(np.column_stack(each), test.stress, rcond=None)[0]
    return dict(zip(moduli, found.tolist(), strict=True))


def _fit_search(test: TensionTest, law: Law, rubber: RubberLaw, terms: int, moduli: list[str]) -> dict[str, float]:
    """The pure numbers by a search from many starts, in all combinations; for each try the moduli follow."""
    from scipy.optimize import least_squares

    searched = [one for one in rubber.coefficients if one.unit == "-"]
    first = len(rubber.coefficients) - len(searched)
    names = [name for term in range(terms) for name in rubber.term_names(term)[first:]]

    def coefficients(values: np.ndarray) -> dict[str, float]:
        pure_numbers = dict(zip(names, values.tolist(), strict=True))
        return pure_numbers | _fit_linear(test, law, moduli, pure_numbers)

    def misfit(values: np.ndarray) -> np.ndarray:
        stress = nominal_stress(law, coefficients(values), test.stretch)
        return (stress - test.stress) / np.abs(test.stress).max()

    bounds = np.tile([one.searched for one in searched], (terms, 1)).T
    tries = [
        least_squares(misfit, np.ravel(start), bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        for start in combinations(product(*(one.starts for one in searched)), terms)
    ]
    best = min(tries, key=lambda one: one.cost).x.reshape(terms, -1)
    found = coefficients(np.array(sorted(best.tolist())).ravel())
    return {name: found[name] for name in rubber.names if name in found}


def _refuse_no_rubber(test: TensionTest, law: Law, coefficients: dict[str, float]) -> None:
    """Refuse what is not stiff at rest, or gives way in tension within the range of the fit."""
    stretch = np.linspace(1.0, test.stretch.max(), 200)
    stress = nominal_stress(law, coefficients, stretch)
    if initial_shear_modulus(law, coefficients) <= 0.0:
        raise MaterialError(f"{test.source}: the best fit of law '{law}' has no stiffness at rest; take another law")
    if (np.diff(stress) <= 0.0).any():
        at = stretch[int(np.argmax(np.diff(stress) <= 0.0))]
        raise MaterialError(
            f"{test.source}: the best fit of law '{law}' gives way at a stretch of {at:.3g}; take another law, or less"
        )
