"""Fitting the coefficients of a law to a tension test, by least squares of the nominal stress."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from taichisoft.scenes.elastic_law import OGDEN_TERMS, Law, initial_shear_modulus
from taichisoft_plugins.materials.laws import LINEAR, nominal_stress, ogden_terms, terms
from taichisoft_plugins.materials.tension_test import MaterialError, TensionTest

HOOKE_STRAIN = 0.2
"""Strain up to which Hooke's law is fitted: at 0.2 the neo-Hookean stress lies 15 % below E e."""
STARTS = (-4.0, -2.0, 1.5, 2.5, 4.0, 6.0)
"""Exponents from which the search for Ogden's begins, in all combinations."""
LARGEST_EXPONENT = 20.0
POINTS_PER_COEFFICIENT = 5
"""Points that a coefficient needs, so that their errors of measurement cancel out."""


@dataclass(frozen=True)
class Fit:
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


def fit_law(test: TensionTest, law: Law, ogden_count: int = 1) -> Fit:
    """Fit a law to all points of a test; Hooke's to those of small strain.

    Args:
        test: points, see `TensionTest.within`.
        law: which.
        ogden_count: number of Ogden's terms, 1 to 3.

    Raises:
        MaterialError: the best coefficients are those of no rubber.
    """
    if law == "hooke":
        test = test.within(0.0, 1.0 + HOOKE_STRAIN)
    if law == "ogden":
        if not 1 <= ogden_count <= OGDEN_TERMS:
            raise MaterialError(f"Ogden's law has 1 to {OGDEN_TERMS} terms, not {ogden_count}")
        coefficients = _fit_ogden(test, ogden_count)
    else:
        coefficients = _fit_linear(test, law)
    _refuse_no_rubber(test, law, coefficients)
    misfit = nominal_stress(law, coefficients, test.stretch) - test.stress
    scale = np.abs(test.stress).max()
    error, worst = np.sqrt((misfit**2).mean()) / scale, np.abs(misfit).max() / scale
    return Fit(law, coefficients, float(test.stretch.max()), float(error), float(worst), len(test.stretch))


def _fit_linear(test: TensionTest, law: str) -> dict[str, float]:
    """Linear least squares. Yeoh's last term must not be negative: beyond the test the rubber would give way."""
    names, each = LINEAR[law], terms(law, test.stretch)
    for count in range(len(names), 0, -1):
        found = np.linalg.lstsq(each[:, :count], test.stress, rcond=None)[0]
        if law != "yeoh" or found[-1] >= 0.0:
            break
    return dict(zip(names, found.tolist(), strict=False))


def _fit_ogden(test: TensionTest, count: int) -> dict[str, float]:
    """The exponents by a search from many starts; for given exponents the moduli follow by linear least squares."""
    from scipy.optimize import least_squares

    def moduli(exponents: np.ndarray) -> np.ndarray:
        return np.linalg.lstsq(ogden_terms(exponents, test.stretch), test.stress, rcond=None)[0]

    def misfit(exponents: np.ndarray) -> np.ndarray:
        return (ogden_terms(exponents, test.stretch) @ moduli(exponents) - test.stress) / np.abs(test.stress).max()

    bounds = (-LARGEST_EXPONENT, LARGEST_EXPONENT)
    tries = [
        least_squares(misfit, start, bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        for start in combinations(STARTS, count)
    ]
    exponents = np.sort(min(tries, key=lambda one: one.cost).x)
    pairs = zip(moduli(exponents).tolist(), exponents.tolist(), strict=True)
    return {
        name: value
        for p, (modulus, exponent) in enumerate(pairs, start=1)
        for name, value in ((f"mu{p}", modulus), (f"alpha{p}", exponent))
    }


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
