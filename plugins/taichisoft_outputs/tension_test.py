"""Tension tests: read, fitted by laws of rubber, plotted."""

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
from taichisoft_outputs.measured_table import UNIT, MeasuredTable, read_measured_table

# Nominal stress of incompressible rubber pulled along one axis, by each law; Hooke's is E (l - 1).


def nominal_stress(law: Law, coefficients: Mapping[str, float], stretch: np.ndarray) -> np.ndarray:
    """Force over the area at rest [kPa], shape (count,), at stretches of that shape."""
    if law == "hooke":
        return coefficients["young_modulus"] * (stretch - 1.0)
    return RUBBER_LAWS[law].tension(coefficients, stretch)


def shear_stress(law: Law, coefficients: Mapping[str, float], shear: np.ndarray) -> np.ndarray:
    """Stress of incompressible rubber in simple shear [kPa], shape (count,), the derivative of the energy by `shear`.

    The principal stretches are s, 1 / s and 1, with s - 1 / s = `shear`; `shear` [-] has that shape.
    """
    if law == "hooke":
        return coefficients["young_modulus"] / 3.0 * shear
    stretch = 0.5 * shear + np.sqrt(1.0 + 0.25 * shear**2)
    principal = np.column_stack([stretch, 1.0 / stretch, np.ones_like(stretch)])
    stress = RUBBER_LAWS[law].principal_stress(coefficients, principal)
    change: np.ndarray = (stress[:, 0] - stress[:, 1]) / (stretch + 1.0 / stretch)
    return change


# A tension test from a CSV file: stretch, and force over the area at rest.

SQUARES = ("mm^2", "mm2", "mm²")
KPA = {
    **{"pa": 1e-3, "hpa": 0.1, "kpa": 1.0, "mpa": 1e3, "bar": 100.0, "psi": 6.894757},
    **{f"n/{square}": 1e3 for square in SQUARES},
    **{f"kgf/{square.replace('m', 'c', 1)}": 98.0665 for square in SQUARES},
}
RATIOS = {"": 1.0, "-": 1.0, "1": 1.0, "mm/mm": 1.0, "m/m": 1.0}
STRAINS = {"%": 0.01, "percent": 0.01, "per cent": 0.01, **RATIOS}
MM = {"mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4}
MN = {"n": 1e3, "mn": 1.0, "kn": 1e6, "gf": 9.80665, "kgf": 9806.65, "lbf": 4448.222}
KINDS = ("engineering", "nominal")
"""Words in the brackets of a column's name that are not units."""
HIGHEST_STRAIN = 20.0
"""No rubber is stretched so far: strains beyond it are in per cent."""
FEWEST = 5
"""Points that a fit needs."""
QUANTITIES: dict[str, tuple[tuple[str, ...], Mapping[str, float]]] = {
    "stretch": (("stretch",), RATIOS),
    "strain": (
        ("engineering strain", "nominal strain", "tensile strain", "strain", "dehnung", "déformation", "deformation"),
        STRAINS,
    ),
    "stress": (("engineering stress", "nominal stress", "tensile stress", "stress", "spannung", "contrainte"), KPA),
    "extension": (
        (
            *("extension", "displacement", "elongation", "crosshead", "weg", "standardweg", "traverse", "verlängerung"),
            *("allongement", "déplacement", "deplacement"),
        ),
        MM,
    ),
    "force": (("load", "force", "kraft", "standardkraft", "effort"), MN),
}
"""What a column may hold: the beginnings of its name, and its units with their size in [-], kPa, mm or mN."""
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


def joined(tests: Sequence[TensionTest]) -> TensionTest:
    """The points of several specimens."""
    stretch, stress = (np.concatenate([getattr(test, name) for test in tests]) for name in ("stretch", "stress"))
    return TensionTest(", ".join(dict.fromkeys(test.source for test in tests)), stretch, stress)


def read_tension_test(path: Path) -> TensionTest:
    """All specimens of a table, see `read_specimens`."""
    return joined(read_specimens(path))


def read_specimens(
    path: Path,
    columns: Mapping[str, str] = MappingProxyType({}),
    area: float | None = None,
    length: float | None = None,
) -> list[TensionTest]:
    """Read a table with columns of strain or stretch, and of stress over the area at rest, for each specimen.

    A strain is in per cent where its name says so ("Strain (%)"). Engineering columns win over true ones.

    Args:
        path: see `read_measured_table`.
        columns: name or number of the column by its quantity ("strain", "stretch", "stress", "extension", "force"),
            with a unit in brackets where its name has none.
        area: of the specimen at rest [mm^2], which a column of the force is divided by.
        length: of the specimen at rest [mm], likewise of the extension.

    Raises:
        MaterialError: a column is missing, has no unit or no numbers.
    """
    for name, value in (("area", area), ("length", length)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise MaterialError(f"{name} {value:g}: must be above 0")
    if unknown := next((quantity for quantity in columns if quantity not in QUANTITIES), None):
        raise MaterialError(f"columns {unknown}: must be one of {', '.join(QUANTITIES)}")
    table = read_measured_table(path, MaterialError)
    pulled = "force" if area is not None or "force" in columns else "stress"
    kinds = ["extension"] if length is not None or "extension" in columns else ["stretch", "strain"]
    kinds = [kind for kind in kinds if kind in columns] or kinds
    along = next((places for kind in kinds if (places := _columns(table, kind, columns))), [])
    across = _columns(table, pulled, columns)
    if not along or not across:
        raise MaterialError(_missing(table, "extension" if length is not None else "", pulled))
    for given, key, kind in ((area, "area", pulled), (length, "length", along[0][0])):
        if given is None and kind in ("force", "extension"):
            raise MaterialError(f"columns {kind}: needs {key}, that of the specimen at rest")
    count = len(along) if len(along) == len(across) else 1
    return [
        _specimen(table, *pair, area or 1.0, length or 1.0) for pair in zip(along[:count], across[:count], strict=True)
    ]


Column = tuple[str, int, str]
"""Quantity, index and name with the unit of a column."""


def _specimen(table: MeasuredTable, along: Column, across: Column, area: float, length: float) -> TensionTest:
    columns = [along, across]
    rows = [row for row in range(len(table.rows)) if not all(table.is_blank(row, place) for _, place, _ in columns)]
    (kind, place, name), (_, other, _) = columns
    where = f"{table.path}, line {table.header}"
    scales = [_scale(column[2], QUANTITIES[column[0]][1], where) for column in columns]
    values, stress = (np.array([table.number(row, at) for row in rows]) for at in (place, other))
    values, stress = scales[0] / length * values, scales[1] / area * stress
    if kind == "strain" and not _units(name) and values.max() > HIGHEST_STRAIN:
        raise MaterialError(
            f"{where}: '{name}' reaches {values.max():g}: is it in per cent? say 'strain (%)', or 'strain (-)'"
        )
    if kind == "stretch" and values.min() <= 0.0:
        raise MaterialError(
            f"{where}: '{name}' falls to {values.min():g}: a stretch is length over length at rest, above 0; is it a "
            "strain?"
        )
    return TensionTest(table.path.name, values + (kind != "stretch"), stress)


def _columns(table: MeasuredTable, kind: str, given: Mapping[str, str]) -> list[Column]:
    """The columns of a quantity: as given, or those that its first word in their names shows; a rate is another one."""
    if kind in given:
        bare, unit = UNIT.sub("", given[kind]), UNIT.search(given[kind])
        place = table.place(given[kind])
        place = table.place(bare) if place is None else place
        if place is None:
            known = ", ".join(f"{number} '{name}'" for number, name in enumerate(table.names, 1))
            raise MaterialError(f"columns {kind}={given[kind]}: {table.path} has no such column; there are: {known}")
        return [(kind, place, UNIT.sub("", table.names[place]) + f" ({unit[1]})" if unit else table.names[place])]
    names = [name.lower() for name in table.names]
    for word in QUANTITIES[kind][0]:
        places = [
            (kind, place, table.names[place])
            for place, name in enumerate(names)
            if name.startswith(word) and not re.search("rate|vrai", name)
        ]
        if places:
            return places
    words = QUANTITIES["extension"][0] if kind == "strain" else ()  # "Allongement (%)" is over the length
    return [
        (kind, place, table.names[place])
        for place, name in enumerate(names)
        if name.startswith(words) and "%" in _units(name)
    ]


def _missing(table: MeasuredTable, along: str, across: str) -> str:
    """What the table lacks, what it has instead, and what makes the one of the other."""
    wanted = f"a column '{along}'" if along else "a column 'strain' or 'stretch'"
    message = f"{table.path}: no line names {wanted} and one '{across} ({'N' if across == 'force' else 'MPa'})'"
    if not any(table.names):
        return f"{message}; its columns have no names; name them by their numbers, columns 'strain=1 (%)'"
    message += f"; line {table.header} has {', '.join(f'{name!r}' for name in table.names)}"
    lower = [name.lower() for name in table.names]
    machine = (*QUANTITIES["extension"][0], *QUANTITIES["force"][0])
    if any(name.startswith(machine) for name in lower):
        message += ": length and area of the specimen at rest divide the extension and the force"
    if any(re.search(r"(true|cauchy|wahre).*(stress|spannung)", name) for name in lower):
        message += ": true stress is over the area of the moment; divide it by the stretch"
    if any(re.search(r"(true|logarithmic|wahre).*(strain|dehnung)", name) for name in lower):
        message += ": a true strain is the logarithm of the stretch; give exp of it"
    return f"{message}; columns strain=NAME names others"


def _units(name: str) -> list[str]:
    """What a column's name has in brackets, and per cent wherever it stands."""
    inside = [unit.strip() for unit in re.findall(r"[(\[](.*?)[)\]]", name.lower())]
    bare = re.sub(r"[(\[].*?[)\]]", "", name.lower())
    return [unit for unit in inside if unit not in KINDS] + ["%"] * ("%" in bare or "percent" in bare)


def _scale(name: str, units: Mapping[str, float], where: str) -> float:
    given = _units(name) or ([""] if "" in units else [])
    if len(given) != 1 or given[0] not in units:
        raise MaterialError(f"{where}: '{name}' needs a unit: {', '.join(unit or 'none' for unit in units)}")
    return units[given[0]]


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
        intervals: of confidence (95 %), lowest and highest coefficient by name, see `half_widths`.
    """

    law: Law
    coefficients: dict[str, float]
    highest_stretch: float
    error: float
    worst: float
    points: int
    intervals: dict[str, tuple[float, float]]

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
    names = list(coefficients)
    steps = [1e-6 * max(abs(value), 1e-3) for value in coefficients.values()]

    def changed(name: str, step: float) -> np.ndarray:
        return nominal_stress(law, coefficients | {name: coefficients[name] + step}, test.stretch)

    each = [(changed(n, h) - changed(n, -h)) / (2.0 * h) for n, h in zip(names, steps, strict=True)]
    half = half_widths(np.column_stack(each), misfit, residual_correlation([misfit]))
    intervals = {
        name: (value - one, value + one) for (name, value), one in zip(coefficients.items(), half.tolist(), strict=True)
    }
    highest = float(test.stretch.max())
    return LawFit(law, coefficients, highest, float(error), float(worst), len(test.stretch), intervals)


CONFIDENCE = 0.95


def residual_correlation(curves: Sequence[np.ndarray]) -> float:
    """Correlation of residuals that follow each other in a curve; 0 where it would be negative."""
    square = sum(float(curve @ curve) for curve in curves)
    product = sum(float(curve[1:] @ curve[:-1]) for curve in curves)
    return max(0.0, product / square) if square > 0.0 else 0.0


def half_widths(slopes: np.ndarray, residuals: np.ndarray, correlation: float) -> np.ndarray:
    """Half the widths of the intervals of confidence (95 %) of fitted values, shape (value_count,).

    They are those of the linearised problem: Student's t times the root of s^2 (J^T J)^-1, where s^2 counts correlated
    residuals as fewer (an autoregressive process of first order); vast where the data say nothing of a value.

    Args:
        slopes: J, derivatives of the residuals by the values, shape (residual_count, value_count).
        residuals: shape (residual_count,).
        correlation: of consecutive residuals [-], see `residual_correlation`.
    """
    from scipy.stats import t

    count, values = slopes.shape
    freedom = max(1, count - values)
    variance = residuals @ residuals / freedom * (1.0 + correlation) / max(1.0 - correlation, 1.0 / count)
    sizes = np.maximum(np.linalg.norm(slopes, axis=0), 1e-100)
    _, singular, turned = np.linalg.svd(slopes / sizes, full_matrices=False)
    spread = np.linalg.norm(turned.T / np.maximum(singular, 1e-10), axis=1) / sizes
    half: np.ndarray = t.ppf(0.5 + 0.5 * CONFIDENCE, freedom) * np.sqrt(variance) * spread
    return half


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
