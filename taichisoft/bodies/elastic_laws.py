"""The laws of elasticity of a body's elements, as the kernels read them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.kernels.principal_stretches import LAMBDA, LAW_NUMBERS, MODULI, MU, PURE_NUMBERS, term_columns
from taichisoft.rubber_laws import RUBBER_LAWS
from taichisoft.scenes.elastic_law import Law, initial_shear_modulus, lame_parameters


@dataclass(frozen=True)
class ElasticLaws:
    """Laws of some elements or materials.

    Attributes:
        kind: number in LAW_NUMBERS, shape (count,).
        modulus: in the columns of `bodies/kernels/principal_stretches.py` [kPa], shape (count, MODULI).
        pure_number: coefficients without unit, shape (count, PURE_NUMBERS).
        lame: Lame's lambda and mu at rest [kPa], shape (count, 2).
    """

    kind: np.ndarray
    modulus: np.ndarray
    pure_number: np.ndarray
    lame: np.ndarray

    @classmethod
    def joined(cls, parts: "list[ElasticLaws]") -> "ElasticLaws":
        """Several, one after the other."""
        return cls(
            kind=np.concatenate([part.kind for part in parts]),
            modulus=np.vstack([part.modulus for part in parts]),
            pure_number=np.vstack([part.pure_number for part in parts]),
            lame=np.vstack([part.lame for part in parts]),
        )

    def select(self, indices: np.ndarray) -> "ElasticLaws":
        """Laws at these indices."""
        return ElasticLaws(self.kind[indices], self.modulus[indices], self.pure_number[indices], self.lame[indices])


def elastic_law(
    law: Law, young_modulus: float | None, coefficients: Mapping[str, float] | None, poisson_ratio: float
) -> ElasticLaws:
    """The law of one material, as arrays of length 1.

    Args:
        law: its name.
        young_modulus: at rest [kPa]; None where there are coefficients.
        coefficients: of the law, by name.
        poisson_ratio: at rest; lambda follows from it as in Hooke's law.
    """
    if young_modulus is None:
        young_modulus = 2.0 * (1.0 + poisson_ratio) * initial_shear_modulus(law, coefficients or {})
    lame = lame_parameters(np.array([young_modulus]), np.array([poisson_ratio]))
    modulus, pure_number = np.zeros((1, MODULI)), np.zeros((1, PURE_NUMBERS))
    modulus[0, LAMBDA] = lame[0, 0]
    if law == "hooke":
        modulus[0, MU] = lame[0, 1]
    else:
        rubber = RUBBER_LAWS[law]
        for term, values in enumerate(rubber.given_terms(coefficients or rubber.of_shear_modulus(lame[0, 1]))):
            moduli, pure_numbers = term_columns(rubber, term)
            modulus[0, moduli] = values[: len(moduli)]
            pure_number[0, pure_numbers] = values[len(moduli) :]
    return ElasticLaws(np.array([LAW_NUMBERS[law]], dtype=np.int32), modulus, pure_number, lame)
