"""Shipped materials, materials of plug-ins, and files of materials."""

from pathlib import Path

import tomli_w

from taichisoft.errors import TaichisoftError
from taichisoft.running import provided
from taichisoft.scene import Material, data_folder, find_file, read_material


class MaterialError(TaichisoftError):
    """A test or a fit is not valid; says what would be."""


def shipped_materials() -> dict[str, Material]:
    """The materials that ship, by the name that a scene uses, in alphabetical order."""
    return {path.stem: read_material(path) for path in sorted((data_folder() / "materials").glob("*.toml"))}


def materials_of_plugins() -> dict[str, Material]:
    """The materials that plug-ins provide, by name."""
    found = {}
    for name, table in provided("material").items():
        try:
            found[name] = Material.model_validate(dict(table))
        except ValueError as error:
            raise MaterialError(f"material '{name}' of a plug-in: {' '.join(str(error).split())}") from error
    return found


def find_material(name: str) -> Material:
    """The material of a plug-in, a shipped material, or a material by its file."""
    of_plugins = materials_of_plugins()
    if name in of_plugins:
        return of_plugins[name]
    try:
        return read_material(find_file(name, "materials", (".toml",), error=MaterialError))
    except ValueError as error:
        raise MaterialError(str(error)) from error


def write_material(material: Material, path: Path) -> None:
    """Write the file of a material, with five digits of its coefficients."""
    table = material.model_dump(mode="json", exclude_none=True)
    table["coefficients"] = {name: float(f"{value:.5g}") for name, value in material.coefficients.items()}
    try:
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise MaterialError(f"{path}: cannot be written: {error.strerror}") from error
