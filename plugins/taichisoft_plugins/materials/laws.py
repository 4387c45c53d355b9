"""Nominal stress of incompressible rubber pulled along one axis, by each law.

With W the energy per volume and l the stretch, the others being l^-1/2, the force over the area at rest is dW/dl:
    neo-Hookean   mu (l - l^-2)
    Mooney-Rivlin 2 (l - l^-2) (c10 + c01 / l)
    Yeoh          2 (l - l^-2) (c10 + 2 c20 (I - 3) + 3 c30 (I - 3)^2),  I = l^2 + 2 / l
    Ogden         sum_p mu_p (l^(a_p - 1) - l^(-a_p / 2 - 1))
(Marckmann and Verron 2006, Comparison of Hyperelastic Models for Rubber-Like Materials). Hooke's is E (l - 1).
"""

from collections.abc import Mapping

import numpy as np

from taichisoft.scenes.elastic_law import OGDEN_TERMS

LINEAR = {
    "hooke": ("young_modulus",),
    "neo-hookean": ("mu",),
    "mooney-rivlin": ("c10", "c01"),
    "yeoh": ("c10", "c20", "c30"),
}
"""Laws whose stress is a sum of terms, each in proportion to a coefficient, and the names of these."""
LAWS = (*LINEAR, "ogden")


def terms(law: str, stretch: np.ndarray) -> np.ndarray:
    """Nominal stress for each coefficient of 1, of a law in LINEAR; shape (count, coefficient_count)."""
    shear = stretch - stretch**-2
    more = stretch**2 + 2.0 / stretch - 3.0
    if law == "hooke":
        return (stretch - 1.0)[:, None]
    if law == "neo-hookean":
        return shear[:, None]
    if law == "mooney-rivlin":
        return 2.0 * shear[:, None] * np.column_stack([np.ones_like(stretch), 1.0 / stretch])
    return 2.0 * shear[:, None] * np.column_stack([np.ones_like(stretch), 2.0 * more, 3.0 * more**2])


def ogden_terms(exponents: np.ndarray, stretch: np.ndarray) -> np.ndarray:
    """The same of Ogden's terms with these exponents."""
    return np.column_stack([stretch ** (a - 1.0) - stretch ** (-0.5 * a - 1.0) for a in exponents])


def nominal_stress(law: str, coefficients: Mapping[str, float], stretch: np.ndarray) -> np.ndarray:
    """Force over the area at rest [kPa], shape (count,), at stretches of that shape."""
    if law == "ogden":
        pairs = [
            (coefficients[f"mu{p}"], coefficients[f"alpha{p}"])
            for p in range(1, OGDEN_TERMS + 1)
            if f"mu{p}" in coefficients
        ]
        moduli, exponents = np.array(pairs).T
        return ogden_terms(exponents, stretch) @ moduli
    return terms(law, stretch) @ np.array([coefficients.get(name, 0.0) for name in LINEAR[law]])
