"""The laws of elasticity that a scene may name, and whether its coefficients fit them."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from taichisoft.rubber_laws import RUBBER_LAWS

LAW_NAMES = ("hooke", *RUBBER_LAWS)
if TYPE_CHECKING:
    import numpy as np

    Law = str
else:
    Law = Literal[LAW_NAMES]


def takes_young_modulus(law: Law) -> bool:
    """Whether a scene gives Young's modulus of a law instead of coefficients."""
    return law == "hooke" or RUBBER_LAWS[law].takes_young_modulus


def check_coefficients(law: Law, coefficients: Mapping[str, float] | None) -> None:
    """Refuse coefficients that do not fit the law.

    Raises:
        ValueError: there are unknown ones, some are missing, or they make a material of no stiffness.
    """
    if takes_young_modulus(law):
        if coefficients is not None:
            raise ValueError(f'law = "{law}" takes young_modulus instead of coefficients')
        return
    rubber = RUBBER_LAWS[law]
    if coefficients is None:
        raise ValueError(
            f'law = "{law}" needs coefficients = {{ {", ".join(rubber.needed)} }} instead of young_modulus'
        )
    unknown = [name for name in coefficients if name not in rubber.names]
    if unknown:
        raise ValueError(f'coefficients.{unknown[0]}: law = "{law}" has {", ".join(rubber.names)}')
    missing = [name for name in rubber.needed if name not in coefficients]
    for term in range(1, rubber.terms):
        names = rubber.term_names(term)
        if any(name in coefficients for name in names):
            missing += [name for name in names if name not in coefficients]
    if missing:
        raise ValueError(f'coefficients: law = "{law}" needs {missing[0]}, too')
    shear_modulus = initial_shear_modulus(law, coefficients)
    if shear_modulus <= 0.0:
        raise ValueError(f"coefficients: the shear modulus at rest is {shear_modulus:g} kPa; must be positive")


def initial_shear_modulus(law: Law, coefficients: Mapping[str, float], poisson_ratio: float = 0.5) -> float:
    """The shear modulus at rest [kPa] of a law with coefficients.

    The coefficients belong to a material: young_modulus of Hooke's law, of which Poisson's ratio is needed, and mu
    of the neo-Hookean one.
    """
    if law == "hooke":
        return coefficients["young_modulus"] / (2.0 * (1.0 + poisson_ratio))
    return RUBBER_LAWS[law].shear_modulus(coefficients)


def lame_parameters(young_modulus: "np.ndarray", poisson_ratio: "np.ndarray") -> "np.ndarray":
    """Lame's lambda and mu [kPa], shape (count, 2), of isotropic materials given by arrays of shape (count,)."""
    import numpy as np  # which `taichisoft materials` need not wait for

    first = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    second = young_modulus / (2 * (1 + poisson_ratio))
    return np.column_stack([first, second])
