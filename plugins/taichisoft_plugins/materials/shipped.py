"""The materials that ship, those of plug-ins, and a material as a file."""

from pathlib import Path

import tomli_w

from taichisoft.plugin_system.hooks import provided
from taichisoft.scenes.material import Material, read_material
from taichisoft.scenes.shipped import data_folder, find_file
from taichisoft_plugins.materials.tension_test import MaterialError

SUFFIXES = (".toml",)


def shipped_materials() -> dict[str, Material]:
    """All of them by the name that a scene uses, in alphabetical order."""
    return {path.stem: read_material(path) for path in sorted((data_folder() / "materials").glob("*.toml"))}


def materials_of_plugins() -> dict[str, Material]:
    """Those that plug-ins provide, by name.

    Raises:
        PluginError: two plug-ins claim one name.
        MaterialError: one is not valid.
    """
    found = {}
    for name, table in provided("material").items():
        try:
            found[name] = Material.model_validate(dict(table))
        except ValueError as error:
            raise MaterialError(f"material '{name}' of a plug-in: {' '.join(str(error).split())}") from error
    return found


def find_material(name: str) -> Material:
    """A material of a plug-in or a shipped one by name, or one by its file.

    Raises:
        MaterialError: there is none, or it is not valid.
    """
    of_plugins = materials_of_plugins()
    if name in of_plugins:
        return of_plugins[name]
    try:
        return read_material(find_file(name, "materials", SUFFIXES, error=MaterialError))
    except ValueError as error:
        raise MaterialError(str(error)) from error


def material_toml(material: Material) -> str:
    """The file of a material, with five digits of its coefficients."""
    table = material.model_dump(mode="json", exclude_none=True)
    table["coefficients"] = {name: float(f"{value:.5g}") for name, value in material.coefficients.items()}
    return tomli_w.dumps(table)


def write_material(material: Material, path: Path) -> None:
    """Write its file.

    Raises:
        MaterialError: the folder is not there, or cannot be written into.
    """
    try:
        path.write_text(material_toml(material), encoding="utf-8")
    except OSError as error:
        raise MaterialError(f"{path}: cannot be written: {error.strerror}") from error
