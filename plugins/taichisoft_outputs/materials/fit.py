"""Fitting the coefficients of a law to a tension test, by least squares of the nominal stress."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, product
from types import MappingProxyType

import numpy as np

from taichisoft.rubber_laws import RUBBER_LAWS, RubberLaw
from taichisoft.scenes import Law, initial_shear_modulus
from taichisoft_outputs.materials.nominal_stress import nominal_stress
from taichisoft_outputs.materials.tension_test import MaterialError, TensionTest

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

    Raises:
        MaterialError: the law has fewer terms, or the best coefficients do not describe a rubber.
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
