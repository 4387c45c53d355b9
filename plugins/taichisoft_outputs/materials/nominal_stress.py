"""Nominal stress of incompressible rubber pulled along one axis, by each law; Hooke's is E (l - 1)."""

from collections.abc import Mapping

import numpy as np

from taichisoft.rubber_laws import RUBBER_LAWS
from taichisoft.scenes import Law


def nominal_stress(law: Law, coefficients: Mapping[str, float], stretch: np.ndarray) -> np.ndarray:
    """Force over the area at rest [kPa], shape (count,), at stretches of that shape."""
    if law == "hooke":
        return coefficients["young_modulus"] * (stretch - 1.0)
    return RUBBER_LAWS[law].tension(coefficients, stretch)
