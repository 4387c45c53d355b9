"""Paths of links between components: @loader.position, @../finger1/boxROI.indices, @/Config."""

import re
from collections.abc import Sequence
from typing import Any, Protocol


class Branch(Protocol):
    """Interface of a node for paths."""

    @property
    def parents(self) -> Sequence[Any]: ...
    @property
    def objects(self) -> Sequence[Any]: ...
    def getChild(self, name: str, warning: bool = ...) -> Any: ...
    def own_object(self, name: str) -> Any: ...
    def getRoot(self) -> Any: ...


def follow(path: str, start: Branch, owner: Any = None) -> Any:
    """Resolve a path to a component, a node or a data; None for a broken path.

    Args:
        path: path, with or without @.
        start: node at which the path starts.
        owner: component with the path; @[-1] is the component added before it.

    A path that begins with a name is searched in the node, then in its ancestors.
    """
    path = path.strip().removeprefix("@")
    folder, slash, last = path.rpartition("/")
    name, _, data = last.partition(".") if last.strip(".") else (last, "", "")
    path = f"{folder}{slash}{name}"
    if path.startswith("/"):
        found = _descend(start.getRoot(), path.split("/"), owner)
    elif path.startswith(".") or not path:
        found = _descend(start, path.split("/"), owner)
    else:
        found = _first_above(start, path.split("/"), owner)
    return found.findData(data) if found is not None and data else found


def _first_above(node: Branch, names: list[str], owner: Any) -> Any:
    found = _descend(node, names, owner)
    for parent in node.parents:
        if found is not None:
            break
        found = _first_above(parent, names, owner)
    return found


def _descend(place: Any, names: list[str], owner: Any) -> Any:
    """Resolve a list of names from a node; for the last name, components take precedence over nodes."""
    for index, name in enumerate(names):
        if place is None or not hasattr(place, "own_object"):
            return None
        if name in ("", "."):
            continue
        if name == "..":
            place = next(iter(place.parents), None)
        elif neighbour := re.fullmatch(r"\[(-?\d+)\]", name):
            place = _neighbour(place, owner, int(neighbour[1]))
        else:
            at_end = index == len(names) - 1
            place = (place.own_object(name) if at_end else None) or place.getChild(name, warning=False)
    return place


def _neighbour(node: Branch, owner: Any, offset: int) -> Any:
    """The component added `offset` places after `owner`, before it if negative."""
    objects = list(node.objects)
    here = next((index for index, item in enumerate(objects) if item is owner), len(objects))
    return objects[here + offset] if 0 <= here + offset < len(objects) else None
