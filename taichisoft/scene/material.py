"""Materials by name: a file with the law of a silicone, its density, and where its numbers come from.

A soft body or region that names a material takes the keys of `material_keys` from it. The engine sees only these.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, ValidationError

from taichisoft.base.files import read_toml
from taichisoft.runtime.rubber_laws import RUBBER_LAWS
from taichisoft.scene.table import Number, PoissonRatio, Positive, Table

# The laws of elasticity that a scene may name, and whether its coefficients fit them.

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
    """Refuse coefficients that do not fit the law."""
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


ELASTICITY = ("law", "young_modulus", "coefficients")
"""Keys of a body or region that a material takes the place of."""


class Mixing(Table):
    """How the two parts of a silicone are mixed."""

    a: Positive
    """Parts of A [-]."""
    b: Positive
    """Parts of B [-]."""
    by: Literal["weight", "volume", "weight or volume"]
    """What is measured in these parts."""
    source: str
    """Where the ratio comes from."""


class Material(Table):
    """A rubber: `material = "NAME"` names a shipped one, or a file (.toml) with these keys."""

    name: str
    """What it is called."""
    law: Law
    """Law of elasticity to which the coefficients belong."""
    coefficients: dict[str, Number]
    """Coefficients of the law [kPa, exponents -]: young_modulus of Hooke's law, mu of the neo-Hookean one, and those
    that docs/elements.md lists of the others."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio at rest [-]."""
    density: Positive
    """Density [kg/mm^3]."""
    highest_stretch: Annotated[float, Field(strict=True, gt=1)]
    """Stretch up to which the law was fitted [-]; a run that goes beyond says so."""
    error: Number | None = None
    """Root mean square of the misfit over the largest stress of the fit [-]."""
    source: str
    """Where the numbers come from, and under which licence."""
    mixing: Mixing | None = None
    """Ratio of its two parts, for casting; no simulation uses it."""

    @property
    def shear_modulus(self) -> float:
        """At rest [kPa]."""
        return initial_shear_modulus(self.law, self.coefficients, self.poisson_ratio)


def material_keys(material: Material) -> dict[str, Any]:
    """The keys of a soft body that follow from its material."""
    keys: dict[str, Any] = {"law": material.law, "poisson_ratio": material.poisson_ratio, "density": material.density}
    if takes_young_modulus(material.law):
        return keys | {"young_modulus": 2.0 * (1.0 + material.poisson_ratio) * material.shear_modulus}
    return keys | {"coefficients": material.coefficients}


def read_material(path: str | Path) -> Material:
    """Read a material's file.

    Raises:
        ValueError: it is not readable, or not valid; begins with the path.
    """
    try:
        return Material.model_validate(read_toml(Path(path)))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{path}: {key}: {first['msg'][:1].lower()}{first['msg'][1:]}") from error
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not readable as TOML: {error}") from error


def with_material(table: Any, wanted: tuple[str, ...]) -> Any:
    """A table of a scene in which the keys `wanted` come from its material where it does not give them itself."""
    if not isinstance(table, dict) or table.get("material") is None:
        return table
    material = table["material"]
    if isinstance(material, str):
        useless = [key for key in ELASTICITY if table.get(key) is not None]
        if useless:
            raise ValueError(f"{', '.join(useless)} would have no effect beside material; remove one of them")
        material = read_material(material)
    elif isinstance(material, dict):
        material = Material.model_validate(material)
    elif not isinstance(material, Material):
        raise ValueError(f"material = {material!r}: must be the name of a material, or of a file (.toml)")
    keys = {key: value for key, value in material_keys(material).items() if key in wanted}
    if table.get("mass") is not None:
        keys.pop("density", None)
    given = {key: value for key, value in table.items() if value is not None}
    return {**keys, **given, "material": material}
