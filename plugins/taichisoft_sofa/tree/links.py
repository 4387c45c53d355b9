"""Paths from one component to another, as links have them: @loader.position, @../finger1/boxROI.indices, @/Config."""

import re
from collections.abc import Sequence
from typing import Any, Protocol


class Branch(Protocol):
    """A node, as far as paths are concerned."""

    @property
    def parents(self) -> Sequence[Any]: ...
    @property
    def objects(self) -> Sequence[Any]: ...
    def getChild(self, name: str, warning: bool = ...) -> Any: ...
    def own_object(self, name: str) -> Any: ...
    def getRoot(self) -> Any: ...


def follow(path: str, start: Branch, owner: Any = None) -> Any:
    """What a path leads to: a component, a node, or a data; None if it leads nowhere.

    Args:
        path: the path, with its @ or without.
        start: the node at which it starts.
        owner: the component whose path it is; @[-1] is the one added before it.

    A path that begins with a name is looked for in the node, then in the nodes above it.
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
    """What stands at the end of names from a node on; a component of the last name goes before a node."""
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
    """The component that was added so many places after another, or before it where that is negative."""
    objects = list(node.objects)
    here = next((index for index, item in enumerate(objects) if item is owner), len(objects))
    return objects[here + offset] if 0 <= here + offset < len(objects) else None
