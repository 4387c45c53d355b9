"""Changes of a scene from the command line: another controller, and values such as --set contact.friction=0.3."""

from collections.abc import Sequence
from typing import Any

from taichisoft.errors import SceneError, nearest
from taichisoft.input_file import DEEPEST, parse_toml

NO_GOAL = "none"
# Tables whose keys are names that the user gave: a new one here is a misspelt one, not a default to be replaced.
NAMED_TABLES = ("soft_bodies", "rigid_bodies", "obstacles")


def change_scene(
    document: dict[str, Any], overrides: Sequence[str], controller: str | None, goal: str | None = None
) -> None:
    """Change the tables of a scene, before they are inherited and checked.

    Args:
        document: tables of a scene, changed in place.
        overrides: "key.key=value" each.
        controller: name of a controller to take instead of the scene's own, whose settings are then dropped, while
            its period and time limit stay; None for the scene's own.
        goal: kind of goal to take instead of the scene's own, of the same object or else of the first rigid body;
            "none" for none at all, None for the scene's own.

    Raises:
        SceneError: an override cannot be applied.
    """
    table = document.setdefault("controller", {}) if controller is not None else None
    if isinstance(table, dict) and table.get("name") != controller:
        table.pop("settings", None)
        table["name"] = controller
    if goal is not None:
        _change_goal(document, goal)
    for override in overrides:
        apply_override(document, override)


def _change_goal(document: dict[str, Any], kind: str) -> None:
    table, bodies = document.get("goal"), document.get("rigid_bodies")
    if kind == NO_GOAL:
        document.pop("goal", None)
        return
    table = dict(table) if isinstance(table, dict) else {}
    if table.get("kind", "held") != kind:
        table = {key: value for key, value in table.items() if key not in ("position", "height")}
    first = next(iter(bodies), None) if isinstance(bodies, dict) else None
    document["goal"] = ({"object": first} if first is not None else {}) | table | {"kind": kind}


def apply_override(
    document: dict[str, Any], override: str, example: str = "contact.friction=0.3", whole: str = "the scene"
) -> None:
    """Put the value of "key.key=value" into tables, before they are checked.

    The value is read as TOML, and as plain text when it is none. Tables that the scene leaves out are made;
    entries of lists are given by their index, from 0.

    Args:
        document: tables of a scene, or of any other TOML file, changed in place.
        override: text from the command line.
        example: valid override, for the error.
        whole: name of the document, for the error.

    Raises:
        SceneError: it has no "=", or leads to no place in the document.
    """
    key, separator, text = override.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not separator or not all(names):
        raise SceneError(f"--set {override}: must look like {example}")
    if len(names) > DEEPEST:
        raise SceneError(
            f"--set {names[0]}.{names[1]}...: has {len(names)} keys; nothing is nested deeper than {DEEPEST}"
        )
    place: Any = document
    for depth, name in enumerate(names):
        where = ".".join(names[:depth]) or whole
        problem = _why_not(place, name, where, names[depth + 1 :])
        if problem:
            raise SceneError(f"--set {override}: {problem}")
        index: Any = int(name) if isinstance(place, list) else name
        if depth == len(names) - 1:
            place[index] = _value(text)
        else:
            place = place[index] if isinstance(place, list) else place.setdefault(name, {})


def _why_not(place: Any, name: str, where: str, rest: list[str]) -> str:
    """What is wrong with going from `place` on to `name` and then to `rest`; empty when nothing is."""
    if isinstance(place, list):
        valid = name.isdecimal() and int(name) < len(place)
        return "" if valid else f"{where} has no entry '{name}'; it has {len(place)}, counted from 0"
    if not isinstance(place, dict):
        return f"{where} is not a table: it has no '{name}'"
    if name not in place and rest:
        if where in NAMED_TABLES:
            return f"{where} has no '{name}'; {nearest(name, list(place), 'there are')}"
        if rest[0].isdecimal():
            return f"{where} has no list '{name}' of its own"
    return ""


def _value(text: str) -> Any:
    try:
        document = parse_toml(f"value = {text}")
    except ValueError:
        return text.strip()
    return document["value"] if len(document) == 1 else text.strip()
