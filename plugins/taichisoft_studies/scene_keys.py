"""The keys that a study varies: keys of a scene, or of the geometry that its bodies are meshed from."""

import json
from collections.abc import Mapping
from typing import Any

from taichisoft import Scene
from taichisoft.building import load_scene
from taichisoft.errors import nearest
from taichisoft_studies.errors import StudyError


def scene_with(name: str, overrides: Mapping[str, Any], controller: str | None) -> Scene:
    """Read a scene with values in place of its own.

    Args:
        name: path of the scene, or name of a shipped one.
        overrides: values by dotted key. A key whose first part a scene does not have ("body.width") belongs to the
            geometry of all soft bodies that are meshed from a geometry file; "NAME:body.width" to that of one body.
        controller: name of a controller instead of the scene's own.

    Raises:
        StudyError: a key belongs to no geometry.
        SceneError: see `load_scene`; names the key and its value.
    """
    of_scene = {key: value for key, value in overrides.items() if is_of_scene(key)}
    texts = [f"{key}={toml_value(value)}" for key, value in of_scene.items()]
    if len(of_scene) < len(overrides):
        resolved = load_scene(name, texts, controller)
        of_geometry = {key: value for key, value in overrides.items() if key not in of_scene}
        texts += _geometry_overrides(name, resolved, of_geometry)
    return load_scene(name, texts, controller)


def is_of_scene(key: str) -> bool:
    """Whether a key begins with one of the scene's tables or values."""
    return key.partition(".")[0] in Scene.model_fields


def toml_value(value: Any) -> str:
    """A value as TOML in one line, tables included."""
    if isinstance(value, Mapping):
        inner = ", ".join(f"{json.dumps(key)} = {toml_value(one)}" for key, one in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)


def _geometry_overrides(name: str, scene: Scene, values: Mapping[str, Any]) -> list[str]:
    """Overrides "soft_bodies.NAME.mesh=..." that lay values over the geometry of each body that they are for."""
    from taichisoft_meshing.geometry_file import is_geometry

    meshes = {
        body: table.mesh.model_dump(mode="json", exclude_none=True)
        for body, table in scene.soft_bodies.items()
        if is_geometry(table.mesh.file)
    }
    for key, value in values.items():
        body, separator, path = key.rpartition(":")
        if separator and body not in meshes:
            raise StudyError(f"{key}: '{body}' has no geometry file; {nearest(body, list(meshes), 'bodies with one')}")
        if not meshes:
            tables = ", ".join(Scene.model_fields)
            raise StudyError(
                f"{key}: is not a key of a scene ({tables}), and no soft body of {name} is meshed from a geometry file "
                "(.toml, .step)"
            )
        for mesh in [meshes[body]] if separator else meshes.values():
            place = mesh.setdefault("set", {})
            if path == "mesh.largest":  # which a size that the scene asks for would take the place of
                mesh.update(dict.fromkeys(("size", "preset", "nodes")))
            *tables_above, last = path.split(".")
            for table in tables_above:
                place = place.setdefault(table, {})
            place[last] = value
    given = {body: {key: one for key, one in mesh.items() if one is not None} for body, mesh in meshes.items()}
    return [f"soft_bodies.{body}.mesh={toml_value(mesh)}" for body, mesh in given.items()]
