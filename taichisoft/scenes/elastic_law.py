"""The laws of elasticity that a scene may name, with their coefficients."""

from collections.abc import Mapping
from typing import Literal

Law = Literal["hooke", "neo-hookean", "mooney-rivlin", "yeoh", "ogden"]

OGDEN_TERMS = 3
COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "hooke": (),
    "neo-hookean": (),
    "mooney-rivlin": ("c10", "c01"),
    "yeoh": ("c10", "c20", "c30"),
    "ogden": tuple(f"{what}{term}" for term in range(1, OGDEN_TERMS + 1) for what in ("mu", "alpha")),
}
"""Names of the coefficients of each law, in kPa except Ogden's exponents alpha; without any it takes young_modulus."""
NEEDED = {"mooney-rivlin": ("c10", "c01"), "yeoh": ("c10",), "ogden": ("mu1", "alpha1")}


def check_coefficients(law: Law, coefficients: Mapping[str, float] | None) -> None:
    """Refuse coefficients that do not fit the law.

    Raises:
        ValueError: there are unknown ones, some are missing, or they make a material of no stiffness.
    """
    known = COEFFICIENTS[law]
    if coefficients is None:
        if known:
            raise ValueError(
                f'law = "{law}" needs coefficients = {{ {", ".join(NEEDED[law])} }} instead of young_modulus'
            )
        return
    if not known:
        raise ValueError(f'law = "{law}" takes young_modulus instead of coefficients')
    unknown = [name for name in coefficients if name not in known]
    if unknown:
        raise ValueError(f'coefficients.{unknown[0]}: law = "{law}" has {", ".join(known)}')
    missing = [name for name in NEEDED[law] if name not in coefficients]
    missing += [
        f"{other}{term}"
        for term in range(1, OGDEN_TERMS + 1)
        for one, other in (("mu", "alpha"), ("alpha", "mu"))
        if f"{one}{term}" in coefficients and f"{other}{term}" not in coefficients
    ]
    if missing:
        raise ValueError(f'coefficients: law = "{law}" needs {missing[0]}, too')
    if initial_shear_modulus(law, coefficients) <= 0.0:
        formula = {"mooney-rivlin": "2 (c10 + c01)", "yeoh": "2 c10", "ogden": "the sum of mu alpha / 2"}[law]
        raise ValueError(f"coefficients: the shear modulus at rest, {formula}, must be positive")


def initial_shear_modulus(law: Law, coefficients: Mapping[str, float], poisson_ratio: float = 0.5) -> float:
    """The shear modulus at rest [kPa] of a law with coefficients.

    Those of materials include young_modulus of Hooke's law, of which Poisson's ratio is needed, and mu of the
    neo-Hookean one.
    """
    if law == "hooke":
        return coefficients["young_modulus"] / (2.0 * (1.0 + poisson_ratio))
    if law == "neo-hookean":
        return coefficients["mu"]
    if law == "ogden":
        return 0.5 * sum(mu * alpha for mu, alpha in ogden_terms(coefficients))
    return 2.0 * (coefficients["c10"] + coefficients.get("c01", 0.0))


def ogden_terms(coefficients: Mapping[str, float]) -> list[tuple[float, float]]:
    """Modulus mu [kPa] and exponent alpha of each of Ogden's terms that is given."""
    terms = range(1, OGDEN_TERMS + 1)
    return [(coefficients[f"mu{term}"], coefficients[f"alpha{term}"]) for term in terms if f"mu{term}" in coefficients]
