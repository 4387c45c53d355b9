"""Stress of rubber in numpy, since a recording is drawn without kernels.

The laws are those of `taichisoft/bodies/kernels/principal_stretches.py`.
"""

from collections.abc import Mapping

import numpy as np

from taichisoft.scenes.elastic_law import Law, ogden_terms


def rubber_stress(
    deformation: np.ndarray,
    law: Law,
    coefficients: Mapping[str, float] | None,
    young_modulus: np.ndarray,
    poisson_ratio: np.ndarray,
) -> np.ndarray:
    """Cauchy's stress [kPa], positive in tension, in the axes of the world, shape (count, 3, 3); see
    `rubber_stress_parts`, whose sum it is."""
    shape, volume = rubber_stress_parts(deformation, law, coefficients, young_modulus, poisson_ratio)
    return shape + volume[:, None, None] * np.eye(3)


def rubber_stress_parts(
    deformation: np.ndarray,
    law: Law,
    coefficients: Mapping[str, float] | None,
    young_modulus: np.ndarray,
    poisson_ratio: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Cauchy's stress, force over present area, of the energies of shape and of volume.

    Args:
        deformation: deformation gradients, shape (count, 3, 3).
        law: any but Hooke's.
        coefficients: of the law; scaled so that it has `young_modulus` at rest.
        young_modulus: present, at rest [kPa], shape (count,).
        poisson_ratio: at rest, shape (count,).

    Returns:
        Stress [kPa] of the energy of shape, positive in tension, in the axes of the world, shape (count, 3, 3), and
        that of the energy of volume, lambda (J - 1) in all directions, shape (count,).
    """
    left, s, _ = np.linalg.svd(deformation)
    volume = np.linalg.det(deformation)
    s[:, 2] *= np.sign(volume)
    j = volume[:, None]
    squares = s**2
    i1 = squares.sum(axis=1, keepdims=True)
    # Slopes of the energy of shape by the stretches, of a material with c10 or mu of the law, and its shear modulus.
    if law == "ogden":
        terms = ogden_terms(coefficients or {})
        total, shear = sum(mu for mu, _ in terms), sum(mu * alpha for mu, alpha in terms) / 2
        # A stretch of an inverted element has no power.
        slope = sum(mu * np.maximum(s, 0.05) ** (alpha - 1) for mu, alpha in terms)
        pressure = total * (j - 2)
    else:
        c10, c01, c20, c30 = ((coefficients or {"c10": 0.5}).get(name, 0.0) for name in ("c10", "c01", "c20", "c30"))
        shear = 2 * (c10 + c01)
        k = i1 - 3 - 2 * (j - 1) + (j - 1) ** 2
        first = c10 + 2 * c20 * k + 3 * c30 * k**2
        slope = 2 * first * s + 2 * c01 * s * (i1 - squares)
        pressure = 2 * first * (j - 2) - 4 * c01
    mu = young_modulus / (2 * (1 + poisson_ratio))
    first_lame = (2 * mu * poisson_ratio / (1 - 2 * poisson_ratio))[:, None]
    cofactor = s[:, [1, 2, 0]] * s[:, [2, 0, 1]]
    slope = (mu / shear)[:, None] * (slope + pressure * cofactor)
    return np.einsum("eik,ek,ejk->eij", left, slope * s / j, left), first_lame[:, 0] * (volume - 1)
