"""Stress by the laws of elasticity in numpy, since a recording is drawn without kernels."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from taichisoft.rubber_laws import RUBBER_LAWS
from taichisoft.scenes import Law, lame_parameters


class DomainLaw(NamedTuple):
    """The law of some elements.

    Attributes:
        elements: indices of the elements, shape (count,).
        law: name of the law.
        coefficients: coefficients of a law of rubber; None for a law given by Young's modulus alone.
    """

    elements: np.ndarray
    law: Law
    coefficients: Mapping[str, float] | None


def polar_rotations(deformation: np.ndarray) -> np.ndarray:
    """The rotation nearest to each deformation gradient, never a reflection: an inverted element keeps a rotation."""
    left, _, right = np.linalg.svd(deformation)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return left @ right


def hooke_stress_parts(
    deformation: np.ndarray, rotation: np.ndarray, young_modulus: np.ndarray, poisson_ratio: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corotational stress of Hooke's law.

    Args:
        deformation: deformation gradients, shape (count, 3, 3).
        rotation: rotations in whose axes the strain is small, shape (count, 3, 3).
        young_modulus: Young's modulus [kPa], shape (count,).
        poisson_ratio: Poisson's ratio, shape (count,).

    Returns:
        As `rubber_stress_parts`: 2 mu e in the axes of the world, and lambda tr(e).
    """
    back = np.swapaxes(rotation, 1, 2)
    stretch = back @ deformation
    strain = 0.5 * (stretch + np.swapaxes(stretch, 1, 2)) - np.eye(3)
    first, second = lame_parameters(young_modulus, poisson_ratio).T
    return 2.0 * second[:, None, None] * (rotation @ strain @ back), first * np.trace(strain, axis1=1, axis2=2)


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
        law: a law of rubber.
        coefficients: coefficients of the law, which are scaled to `young_modulus` at rest.
        young_modulus: present Young's modulus at rest [kPa], shape (count,).
        poisson_ratio: Poisson's ratio at rest, shape (count,).

    Returns:
        Stress [kPa] of the energy of shape, positive in tension, in the axes of the world, shape (count, 3, 3), and
        of the energy of volume, lambda (J - 1) in all directions, shape (count,).
    """
    rubber = RUBBER_LAWS[law]
    given = coefficients or rubber.of_shear_modulus(1.0)
    left, stretches, _ = np.linalg.svd(deformation)
    volume = np.linalg.det(deformation)
    stretches[:, 2] *= np.sign(volume)
    first, second = lame_parameters(young_modulus, poisson_ratio).T
    stress = (second / rubber.shear_modulus(given))[:, None] * rubber.principal_stress(given, stretches)
    return np.einsum("eik,ek,ejk->eij", left, stress, left), first * (volume - 1.0)


def add_pressure(shape: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Stress [kPa], shape (count, 3, 3), of its parts by shape and by volume, (count, 3, 3) and (count,)."""
    return shape + volume[:, None, None] * np.eye(3)
