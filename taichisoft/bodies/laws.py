"""The laws of elasticity of a body's elements, as the kernels read them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.elements import lame_parameters
from taichisoft.bodies.kernels.principal_stretches import (
    C01,
    C10,
    C20,
    C30,
    HOOKE,
    LAMBDA,
    MODULI,
    MU,
    OGDEN,
    OGDEN_TERMS,
    POLYNOMIAL,
)
from taichisoft.scenes.elastic_law import Law, initial_shear_modulus, ogden_terms


@dataclass(frozen=True)
class ElasticLaws:
    """Laws of some elements or materials.

    Attributes:
        kind: HOOKE, POLYNOMIAL or OGDEN, shape (count,).
        modulus: in the columns of `bodies/kernels/principal_stretches.py` [kPa], shape (count, MODULI).
        exponent: Ogden's [-], shape (count, OGDEN_TERMS).
        lame: Lame's lambda and mu at rest [kPa], shape (count, 2).
    """

    kind: np.ndarray
    modulus: np.ndarray
    exponent: np.ndarray
    lame: np.ndarray

    @classmethod
    def joined(cls, parts: "list[ElasticLaws]") -> "ElasticLaws":
        """Several, one after the other."""
        return cls(
            kind=np.concatenate([part.kind for part in parts]),
            modulus=np.vstack([part.modulus for part in parts]),
            exponent=np.vstack([part.exponent for part in parts]),
            lame=np.vstack([part.lame for part in parts]),
        )

    def of(self, indices: np.ndarray) -> "ElasticLaws":
        """Those at some places."""
        return ElasticLaws(self.kind[indices], self.modulus[indices], self.exponent[indices], self.lame[indices])


def elastic_law(
    law: Law, young_modulus: float | None, coefficients: Mapping[str, float] | None, poisson_ratio: float
) -> ElasticLaws:
    """The law of one material, as arrays of length 1.

    Args:
        law: its name.
        young_modulus: [kPa]; None where there are coefficients.
        coefficients: of the law, by name.
        poisson_ratio: at rest; it makes lambda what it is in Hooke's law.
    """
    if young_modulus is None:
        young_modulus = 2.0 * (1.0 + poisson_ratio) * initial_shear_modulus(law, coefficients or {})
    lame = lame_parameters(np.array([young_modulus]), np.array([poisson_ratio]))
    modulus, exponent = np.zeros((1, MODULI)), np.full((1, OGDEN_TERMS), 2.0)
    modulus[0, LAMBDA] = lame[0, 0]
    kind = POLYNOMIAL
    if law == "hooke":
        kind, modulus[0, MU] = HOOKE, lame[0, 1]
    elif law == "neo-hookean":
        modulus[0, C10] = 0.5 * lame[0, 1]
    elif law == "ogden":
        kind = OGDEN
        for term, (mu, alpha) in enumerate(ogden_terms(coefficients or {})):
            modulus[0, MU + term], exponent[0, term] = mu, alpha
    else:
        for name, column in (("c10", C10), ("c01", C01), ("c20", C20), ("c30", C30)):
            modulus[0, column] = (coefficients or {}).get(name, 0.0)
    return ElasticLaws(np.array([kind], dtype=np.int32), modulus, exponent, lame)
