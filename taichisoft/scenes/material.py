"""Materials by name: a file with the law of a silicone, its density, and where its numbers come from.

A soft body or region that names a material takes the keys of `material_keys` from it. The engine sees only these.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from taichisoft.scenes.table import Number, PoissonRatio, Positive, Table

Law = Literal["hooke", "neo-hookean", "mooney-rivlin", "yeoh", "ogden"]
OGDEN_TERMS = 3


class Material(Table):
    """A rubber: `material = "NAME"` names a shipped one, or a file (.toml) with these keys."""

    name: str
    """What it is called."""
    law: Law
    """Law of elasticity to which the coefficients belong."""
    coefficients: dict[str, Number]
    """Coefficients of the law: young_modulus of Hooke's, mu of the neo-Hookean one, c10 and c01 of Mooney and Rivlin's,
    c10, c20, c30 of Yeoh's, mu1 and alpha1 to mu3 and alpha3 of Ogden's [kPa, alpha -]."""
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

    @property
    def shear_modulus(self) -> float:
        """At rest [kPa]."""
        return initial_shear_modulus(self.law, self.coefficients, self.poisson_ratio)


def initial_shear_modulus(law: Law, coefficients: Mapping[str, float], poisson_ratio: float = 0.5) -> float:
    """The shear modulus of a law at rest [kPa]; Poisson's ratio tells that of Hooke's law."""
    if law == "hooke":
        return coefficients["young_modulus"] / (2.0 * (1.0 + poisson_ratio))
    if law == "neo-hookean":
        return coefficients["mu"]
    if law == "ogden":
        terms = [term for term in range(1, OGDEN_TERMS + 1) if f"mu{term}" in coefficients]
        return 0.5 * sum(coefficients[f"mu{term}"] * coefficients[f"alpha{term}"] for term in terms)
    return 2.0 * (coefficients["c10"] + coefficients.get("c01", 0.0))


def material_keys(material: Material) -> dict[str, float]:
    """The keys of a soft body that follow from its material: Hooke's law with the moduli that the material has at rest.

    This is the one place to change where a body can have other laws: `law` and `coefficients` take the place of
    `young_modulus`.
    """
    young_modulus = 2.0 * (1.0 + material.poisson_ratio) * material.shear_modulus
    return {"young_modulus": young_modulus, "poisson_ratio": material.poisson_ratio, "density": material.density}


def read_material(path: str | Path) -> Material:
    """Read a material's file.

    Raises:
        ValueError: it is not readable, or not valid; begins with the path.
    """
    try:
        return Material.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ValueError(f"{path}: not readable as TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{path}: {key}: {first['msg'][:1].lower()}{first['msg'][1:]}") from error


def with_material(table: Any, wanted: tuple[str, ...]) -> Any:
    """A table of a scene in which the keys `wanted` come from its material where it does not give them itself.

    Raises:
        ValueError: the material cannot be read, or the table has a Young's modulus of its own beside it.
    """
    if not isinstance(table, dict) or table.get("material") is None:
        return table
    material = table["material"]
    if isinstance(material, str):
        if table.get("young_modulus") is not None:
            raise ValueError("beside material there is no effect of young_modulus; remove one of them")
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
