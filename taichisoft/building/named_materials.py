"""Materials that plug-ins provide by name, filled into a scene's tables in place of their names."""

from collections.abc import Iterator
from typing import Any

from taichisoft.plugin_system.hooks import provided


def fill_in_materials(document: dict[str, Any]) -> None:
    """Replace names of plug-ins' materials in soft bodies and regions by the materials; other names stay.

    Raises:
        PluginError: two plug-ins provide the same name, or a material is not valid.
    """
    named = [table for table in _tables(document) if isinstance(table.get("material"), str)]
    if not named:
        return  # without names, no plug-in is loaded
    materials = provided("material")
    for table in named:
        if table["material"] in materials:
            table["material"] = dict(materials[table["material"]])


def _tables(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Tables of soft bodies and regions; values that are not tables are refused later, with their keys."""
    bodies = document.get("soft_bodies")
    for body in bodies.values() if isinstance(bodies, dict) else ():
        if isinstance(body, dict):
            yield body
            regions = body.get("regions")
            yield from (one for one in (regions if isinstance(regions, list) else ()) if isinstance(one, dict))
