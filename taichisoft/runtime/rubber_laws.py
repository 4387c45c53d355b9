"""The laws of rubber: the energy, the coefficients and the fit of each. A new law is a function and an entry here.

With the principal stretches s1, s2, s3 and J = s1 s2 s3, an energy is that of shape plus that of volume,
U(J) = lambda / 2 (J - 1)^2. The energy of shape has one of two forms:
    InvariantLaw  W(K, L), linear in L, with K = I1 - 3 - 2 (J - 1) + (J - 1)^2 and L = I2 - 3 - 4 (J - 1), which are
                  I1 - 3 and I2 - 3 where the volume stays, and 2 e : e for small strains e;
    StretchLaw    w(s1) + w(s2) + w(s3) + w'(1) ((J - 1)^2 / 2 - (J - 1)).
All agree with Hooke's law for small strains, and none has a barrier at J = 0, so that inverted elements can come back.

The derivatives of W and w are functions for numpy and for Taichi alike (`domain_deformation.py`): plain
arithmetic without branches, with functions such as `numpy.exp` that Taichi has under the same name. Stresses, tangents,
moduli at rest, curves of tension and fits all follow from them.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np

SMALLEST_STRETCH = 0.05
"""Below this stretch w goes on as its parabola (Stomakhin et al. 2012, Energetically Consistent Invertible Elasticity):
a power has no value at the negative stretches of inverted elements. A membrane is as thin at 4.5 times its size."""


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of a law.

    Attributes:
        name: in scenes and materials; in a law of several terms followed by the number of the term, from 1.
        unit: kPa, in proportion to which the energy is, or none.
        needed: whether it must be given; else it is 0 where it is missing.
        starts: of one without unit, values from which a fit begins its search.
        searched: of one without unit, the range of the search.
    """

    name: str
    unit: Literal["kPa", "-"] = "kPa"
    needed: bool = True
    starts: tuple[float, ...] = ()
    searched: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class RubberLaw(ABC):
    """A law given by the derivatives of its energy.

    Attributes:
        derivatives: of the energy of a term, a function of the form's variable and of the coefficients.
        coefficients: of a term, those in kPa first.
        terms: number of terms that may be given; their energies add up.
        last_not_negative: whether a fit leaves out the last coefficients rather than have the last one negative.
    """

    derivatives: Callable[..., tuple[Any, ...]]
    coefficients: tuple[Coefficient, ...]
    terms: int = 1
    last_not_negative: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all coefficients."""
        return tuple(name for term in range(self.terms) for name in self.term_names(term))

    @property
    def needed(self) -> tuple[str, ...]:
        """The names of the coefficients that must be given."""
        return tuple(
            name for name, coefficient in zip(self.term_names(0), self.coefficients, strict=True) if coefficient.needed
        )

    @property
    def takes_young_modulus(self) -> bool:
        """Whether scenes give Young's modulus instead of coefficients: true of laws with a single coefficient."""
        return len(self.names) == 1

    def term_names(self, term: int) -> tuple[str, ...]:
        """The names of the coefficients of a term, counted from 0."""
        names = [coefficient.name for coefficient in self.coefficients]
        return tuple(f"{name}{term + 1}" for name in names) if self.terms > 1 else tuple(names)

    def given_terms(self, coefficients: Mapping[str, float]) -> list[tuple[float, ...]]:
        """Coefficients of the given terms, in the order of the arguments of `derivatives`; missing ones are 0."""
        names = [self.term_names(term) for term in range(self.terms)]
        return [
            tuple(coefficients.get(name, 0.0) for name in term)
            for term in names
            if any(name in coefficients for name in term)
        ]

    def of_shear_modulus(self, shear_modulus: float) -> dict[str, float]:
        """The coefficient of a law with a single one, for a shear modulus at rest [kPa]."""
        (name,) = self.names
        return {name: shear_modulus / self.shear_modulus({name: 1.0})}

    def _sum(self, variable: Any, coefficients: Mapping[str, float]) -> list[Any]:
        """The sums of the derivatives over all terms."""
        terms = [self.derivatives(variable, *values) for values in self.given_terms(coefficients)]
        return [sum(parts) for parts in zip(*terms, strict=True)]

    @abstractmethod
    def shear_modulus(self, coefficients: Mapping[str, float]) -> float:
        """The shear modulus at rest [kPa]."""

    @abstractmethod
    def tension(self, coefficients: Mapping[str, float], stretch: "np.ndarray") -> "np.ndarray":
        """Force over the area at rest [kPa] of incompressible rubber pulled along one axis, to `stretch` [-]."""

    @abstractmethod
    def principal_stress(self, coefficients: Mapping[str, float], stretches: "np.ndarray") -> "np.ndarray":
        """Cauchy's stress of the energy of shape, s_i / J dW/ds_i [kPa], at stretches [-], both (count, 3)."""


class InvariantLaw(RubberLaw):
    """An energy of invariants: `derivatives(k, ...)` gives dW/dK, dW/dL and d2W/dK2 [kPa]."""

    def shear_modulus(self, coefficients: Mapping[str, float]) -> float:
        """See `RubberLaw`."""
        by_k, by_l, _ = self._sum(0.0, coefficients)
        return float(2.0 * (by_k + by_l))

    def tension(self, coefficients: Mapping[str, float], stretch: "np.ndarray") -> "np.ndarray":
        """See `RubberLaw`."""
        by_k, by_l, _ = self._sum(stretch**2 + 2.0 / stretch - 3.0, coefficients)
        stress: np.ndarray = 2.0 * (stretch - stretch**-2) * (by_k + by_l / stretch)
        return stress

    def principal_stress(self, coefficients: Mapping[str, float], stretches: "np.ndarray") -> "np.ndarray":
        """See `RubberLaw`."""
        j = stretches.prod(axis=1, keepdims=True)
        squares = stretches**2
        i1 = squares.sum(axis=1, keepdims=True)
        by_k, by_l, _ = self._sum(i1 - 3.0 - 2.0 * (j - 1.0) + (j - 1.0) ** 2, coefficients)
        along = 2.0 * by_k * squares + 2.0 * by_l * squares * (i1 - squares)
        stress: np.ndarray = along / j + 2.0 * by_k * (j - 2.0) - 4.0 * by_l
        return stress


class StretchLaw(RubberLaw):
    """An energy that is a sum over the stretches: `derivatives(s, ...)` gives w' and w'' [kPa]."""

    def shear_modulus(self, coefficients: Mapping[str, float]) -> float:
        """See `RubberLaw`."""
        slope, bend = self._sum(1.0, coefficients)
        return float(0.5 * (slope + bend))

    def tension(self, coefficients: Mapping[str, float], stretch: "np.ndarray") -> "np.ndarray":
        """See `RubberLaw`."""
        across = stretch**-0.5
        along_slope, across_slope = (self._sum(s, coefficients)[0] for s in (stretch, across))
        stress: np.ndarray = along_slope - across_slope * across**3
        return stress

    def principal_stress(self, coefficients: Mapping[str, float], stretches: "np.ndarray") -> "np.ndarray":
        """See `RubberLaw`."""
        j = stretches.prod(axis=1, keepdims=True)
        base = stretches.clip(min=SMALLEST_STRETCH)
        slope, bend = self._sum(base, coefficients)
        at_rest, _ = self._sum(1.0, coefficients)
        stress: np.ndarray = (slope + bend * (stretches - base)) * stretches / j + at_rest * (j - 2.0)
        return stress


def _neo_hookean(k: Any, mu: Any) -> tuple[Any, Any, Any]:
    """mu / 2 K (Smith, de Goes and Kim 2018, Stable Neo-Hookean Flesh Simulation; their lambda is lambda + mu here)."""
    return 0.5 * mu, 0.0, 0.0


def _mooney_rivlin(k: Any, c10: Any, c01: Any) -> tuple[Any, Any, Any]:
    """c10 K + c01 L."""
    return c10, c01, 0.0


def _yeoh(k: Any, c10: Any, c20: Any, c30: Any) -> tuple[Any, Any, Any]:
    """c10 K + c20 K^2 + c30 K^3."""
    return c10 + k * (2.0 * c20 + 3.0 * k * c30), 0.0, 2.0 * c20 + 6.0 * k * c30


def _ogden(s: Any, mu: Any, alpha: Any) -> tuple[Any, Any]:
    """mu / alpha (s^alpha - 1)."""
    slope = mu * s ** (alpha - 1.0)
    return slope, (alpha - 1.0) * slope / s


RUBBER_LAWS: dict[str, RubberLaw] = {
    "neo-hookean": InvariantLaw(_neo_hookean, (Coefficient("mu"),)),
    "mooney-rivlin": InvariantLaw(_mooney_rivlin, (Coefficient("c10"), Coefficient("c01"))),
    # With a negative last term the rubber would give way beyond the test.
    "yeoh": InvariantLaw(
        _yeoh,
        (Coefficient("c10"), Coefficient("c20", needed=False), Coefficient("c30", needed=False)),
        last_not_negative=True,
    ),
    "ogden": StretchLaw(
        _ogden,
        (
            Coefficient("mu"),
            Coefficient("alpha", "-", starts=(-4.0, -2.0, 1.5, 2.5, 4.0, 6.0), searched=(-20.0, 20.0)),
        ),
        terms=3,
    ),
}
