"""Base class of components and nodes: name, data, and access to data by attributes."""

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import count
from typing import Any, Protocol, Self

import numpy as np

from taichisoft.errors import nearest
from taichisoft_sofa.tree.data import Data, LinkPath
from taichisoft_sofa.tree.place import Place, here
from taichisoft_sofa.tree.value_kinds import ANY, BOOL, TEXT, TEXTS, Declared, kind_called

# Paths of links between components: @loader.position, @../finger1/boxROI.indices, @/Config.


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
        if place is None or not hasattr(type(place), "own_object"):
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


ALIKE = 0.8
"""Similarity from which on a name is taken for a misspelt one [-]."""


@cache
def misspelt(name: str, known: tuple[str, ...]) -> str | None:
    """The known name that is meant by a misspelt one, or None; a longer name with a known one in it is another."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=ALIKE)
    return near[0] if near and near[0] != name and not name.startswith(near[0]) and not name.endswith(near[0]) else None


# Data of every component and node.
COMMON = {
    "name": Declared(TEXT),
    "tags": Declared(TEXTS),
    "printLog": Declared(BOOL),
    "listening": Declared(BOOL, True),
    "componentState": Declared(TEXT, "Valid"),
    "bbox": Declared(ANY),
}
# Attributes that are not data of SOFA.
INTERNAL = {"data_by_name", "place", "type_name", "data_revision", "initialised", "reinit_requested"}
_made = count()


class TreeObject(ABC):
    """A component or node.

    Attributes:
        type_name: type, as written in the scene.
        data_by_name: data that the scene wrote or read, by name.
        place: line of the scene that made it.
        data_revision: number of writes to its data.
        initialised: whether the scene is complete; later writes replace computed values.
    """

    type_name: str
    data_by_name: dict[str, Data]
    place: Place | None
    data_revision: int
    initialised: bool
    _order: int

    def __new__(cls, *_arguments: Any, **_named: Any) -> Self:
        # Not in __init__, which classes of scenes may not call.
        made = super().__new__(cls)
        made.data_by_name = {}
        made.place = here()
        made.data_revision = 0
        made.initialised = False
        made.type_name = cls.__name__
        made._order = next(_made)
        return made

    # Data.

    @abstractmethod
    def declared_data(self, name: str) -> Declared | None:
        """Declaration of a data of this type, or None."""

    @abstractmethod
    def has_known_data(self) -> bool:
        """Whether all data of this type are declared, so that any other name is an error."""

    def findData(self, name: str) -> Data | None:
        """A data by name, or None."""
        found = self.data_by_name.get(name)
        if found is None and (self.declared_data(name) or not self.has_known_data()):
            found = self.data_by_name[name] = Data(name, self)
        return found

    def getData(self, name: str, *_rest: Any) -> Data | None:
        """A data by name, or None."""
        return self.findData(name)

    def addData(
        self,
        name: str | Data,
        value: Any = None,
        help: str = "",
        group: str = "",
        type: str = "",
        default: Any = None,
        **_rest: Any,
    ) -> Data:
        """Add a data by name, SOFA's type (`Vec3d`, `vector<int>`) and value."""
        if isinstance(name, Data):
            self.data_by_name[name.name] = name
            return name
        added = self.data_by_name[name] = Data(name, self, kind_called(type or _type_of(value)), default)
        if value is not None:
            added.set(value)
        return added

    def addNewData(self, name: str, _group: str, _help: str, type: str, value: Any) -> Data:
        """Add a data, in the older generation."""
        return self.addData(name, value, type=type)

    def set_all(self, values: Mapping[str, Any]) -> None:
        """Write to the data named in `values`; data of unknown types are made."""
        # The kinds of other data may depend on the template.
        for name, value in sorted(values.items(), key=lambda item: item[0] not in ("name", "template")):
            data = self.data_by_name.get(name)
            if data is None:
                data = self.data_by_name[name] = Data(name, self)
            data.set(value, self.place)

    @property
    def __data__(self) -> dict[str, Data]:
        return self.data_by_name

    def getDataFields(self) -> dict[str, Any]:
        """Values of the data by name."""
        return {name: data.value for name, data in self.data_by_name.items()}

    # Names and paths.

    @abstractmethod
    def link_start(self) -> "Branch":
        """The node from which links start."""

    def getName(self) -> str:
        """Name."""
        data = self.data_by_name.get("name")
        return str(data.read_value()) if data is not None and data.is_set() else self.type_name

    def setName(self, name: str, *_number: int) -> None:
        """Set the name."""
        self.set_all({"name": name})

    def getClassName(self) -> str:
        """Type."""
        return self.type_name

    @abstractmethod
    def getPathName(self) -> str:
        """Path from the root, such as /finger/loader."""

    @property
    def linkpath(self) -> LinkPath:
        """Link to this object, for data."""
        return LinkPath(f"@{self.getPathName()}", self)

    def getLinkPath(self) -> LinkPath:
        """Link to this object, for data."""
        return self.linkpath

    def getAsACreateObjectParameter(self) -> LinkPath:
        """Link to this object, for data."""
        return self.linkpath

    def described(self) -> str:
        """Description for error messages."""
        return f"{self.type_name} '{self.getPathName()}'"

    def linked_data(self, path: str, same_name: str) -> Data | None:
        """Target of a link to a data; for a link to a component its data `same_name`; None for a broken link."""
        found = path.target if isinstance(path, LinkPath) else follow(path, self.link_start(), self)
        return found.findData(same_name) if isinstance(found, TreeObject) else found

    def linked(self, name: str) -> Any:
        """Target of a data that is a link, such as `src`: component, node or data; None for a broken link."""
        data = self.findData(name)
        if data is None or not data.is_set():
            return None
        path = data.read_value()
        if isinstance(path, LinkPath):
            return path.target
        return follow(str(path), self.link_start(), self) if str(path).startswith("@") else None

    def linked_all(self, name: str) -> "list[tuple[str, Any]]":
        """Links of a data, a list or a text with spaces, each with its target; None for a broken link."""
        data = self.findData(name)
        written = None if data is None else data.written()
        if isinstance(written, str) and not isinstance(written, LinkPath):
            links: list[Any] = list(written.split())
        else:
            links = list(written) if isinstance(written, list | tuple) else [] if written is None else [written]
        links = [link.linkpath if hasattr(link, "linkpath") else link for link in links]
        return [
            (str(link), link.target if isinstance(link, LinkPath) else follow(str(link), self.link_start(), self))
            for link in links
        ]

    # Attributes.

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name in INTERNAL:
            raise AttributeError(name)
        found = self.findData(name)
        if found is None:
            raise AttributeError(self.missing_attribute(name))
        return found

    def __setattr__(self, name: str, value: Any) -> None:
        if name in INTERNAL or name.startswith("_") or not self.takes_data(name, value):
            object.__setattr__(self, name, value)
        else:
            data = self.findData(name)
            if data is None:
                data = self.data_by_name[name] = Data(name, self)
            data.set(value)

    def takes_data(self, name: str, _value: Any) -> bool:
        """Whether writing to an attribute writes to a data, instead of a plain attribute of the scene."""
        return name in self.data_by_name or self.declared_data(name) is not None

    def missing_attribute(self, name: str) -> str:
        """Message about a missing attribute."""
        known = sorted({*self.data_by_name, *COMMON, *self.known_names()} - {name})
        return f"{self.described()} has no '{name}'; {nearest(name, known, 'there are')}"

    def known_names(self) -> list[str]:
        """Valid names besides the data."""
        return []

    def __repr__(self) -> str:
        return f"<{self.described()}>"

    # Called by SOFA.

    def init(self) -> None:
        """Do nothing; classes of scenes override this for the complete scene."""

    def reinit(self) -> None:
        """Do nothing; components record the request."""


def _type_of(value: Any) -> str:
    """Type of a data that was added by value only."""
    names = {bool: "bool", int: "int", float: "double", str: "string"}
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return "vector<double>"
    return names.get(type(value), "")
