"""The reference of all scene keys, written from the scene's own definition.

python -m taichisoft.scenes.reference > docs/scenes.md
"""

from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from taichisoft.scenes import scene

HEADING = """# Scenes

<!-- Written by `python -m taichisoft.scenes.reference > docs/scenes.md`; a test compares. -->

A scene is a TOML file. Units are millimetre, kilogram and second: forces in mN, pressures and moduli in kPa.
Files are looked for beside the scene, in the current folder, and among what ships. A soft body may say
`like = "other"` to take over everything that it does not set itself from a soft body above it. `taichisoft run`
writes the resolved scene, with every default filled in, to `scene.toml` in its output folder.
"""

TABLES: dict[str, type[BaseModel]] = {
    "(top level)": scene.Scene,
    "[time]": scene.Time,
    "[contact]": scene.Contact,
    "[[contact.pairs]]": scene.PairFriction,
    "[controller]": scene.Controller,
    "[limits]": scene.Limits,
    "[[pushes]]": scene.Push,
    "[goal]": scene.Goal,
    "[soft_bodies.NAME]": scene.SoftBody,
    "[soft_bodies.NAME.mesh]": scene.BodyMesh,
    "[[soft_bodies.NAME.regions]]": scene.Region,
    "[[soft_bodies.NAME.anchors]]": scene.Anchor,
    "[soft_bodies.NAME.cavities.NAME]": scene.Cavity,
    "[rigid_bodies.NAME]": scene.RigidBody,
    "[obstacles.NAME]": scene.Obstacle,
    "plane = { ... } of an obstacle": scene.Plane,
}


def scene_reference() -> str:
    """The reference as Markdown."""
    parts = [HEADING]
    for title, table in TABLES.items():
        parts.append(
            f"\n## {title}\n\n{(table.__doc__ or '').strip()}\n\n| key | value | default | |\n|---|---|---|---|"
        )
        parts += [_row(key, field) for key, field in table.model_fields.items() if _has_row(field)]
    return "\n".join(parts) + "\n"


def _row(key: str, field: FieldInfo) -> str:
    if field.is_required():
        default = "required"
    elif field.default is None:
        default = ""
    elif field.default == "":
        default = "empty"
    else:
        default = f"`{list(field.default) if isinstance(field.default, tuple) else field.default}`"
    return (
        f"| `{key}` | {_kind(field.annotation)} | {default} | {(field.description or '').replace('|', chr(92) + '|')} |"
    )


def _kind(annotation: Any) -> str:
    """A type in a reader's words."""
    if annotation in (float, int, str):
        return {float: "number", int: "whole number", str: "text"}[annotation]
    arguments = [argument for argument in get_args(annotation) if argument is not type(None)]
    origin = get_origin(annotation)
    if origin is tuple:
        return f"[{', '.join(_kind(argument) for argument in arguments)}]"
    if origin is dict:
        return "table"
    if arguments and all(isinstance(argument, str) for argument in arguments):
        return " or ".join(f'"{argument}"' for argument in arguments)
    return _kind(arguments[0]) if arguments else "table"


def _has_row(field: FieldInfo) -> bool:
    """Whether a key must be there, or the reference has no heading of its own for what it holds."""
    inner = [field.annotation, *get_args(field.annotation)]
    listed = any(argument in TABLES.values() for argument in inner if isinstance(argument, type))
    return field.is_required() or not listed


if __name__ == "__main__":
    print(scene_reference(), end="")
