"""What components and nodes have in common: a name, data, and attributes that are those data."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from itertools import count
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taichisoft.errors import nearest
from taichisoft_sofa.tree.data import Data, LinkPath
from taichisoft_sofa.tree.kinds import ANY, BOOL, TEXT, TEXTS, Declared, kind_called
from taichisoft_sofa.tree.links import follow
from taichisoft_sofa.tree.place import Place, here

if TYPE_CHECKING:
    from taichisoft_sofa.tree.links import Branch

# What every component and node has.
COMMON = {
    "name": Declared(TEXT),
    "tags": Declared(TEXTS),
    "printLog": Declared(BOOL),
    "listening": Declared(BOOL, True),
    "componentState": Declared(TEXT, "Valid"),
    "bbox": Declared(ANY),
}
# Their attributes that are no data of SOFA's.
INTERNAL = {"data_by_name", "place", "type_name", "data_revision", "initialised", "reinit_requested"}
_made = count()


class Base(ABC):
    """A component or node.

    Attributes:
        type_name: its type, as the scene writes it.
        data_by_name: its data by their names: those that the scene wrote to or asked for.
        place: the line that made it.
        data_revision: how often its data were written to.
        initialised: whether the scene is complete; what is written from then on replaces what follows from other data.
    """

    type_name: str
    data_by_name: dict[str, Data]
    place: Place | None
    data_revision: int
    initialised: bool
    _order: int

    def __new__(cls, *_arguments: Any, **_named: Any) -> Self:
        # Not in __init__, which classes of scenes may leave out.
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
        """What is known of a data of this type."""

    @abstractmethod
    def has_known_data(self) -> bool:
        """Whether all data of this type are known, so that any other name is a mistake."""

    def computed_by(self, _data: Data) -> Callable[[], Any] | None:
        """What gives the value of a data that follows from others; none where it does not."""
        return None

    def findData(self, name: str) -> Data | None:
        """A data by its name; None where there is none."""
        found = self.data_by_name.get(name)
        if found is None and (self.declared_data(name) or not self.has_known_data()):
            found = self.data_by_name[name] = Data(name, self)
        return found

    def getData(self, name: str, *_rest: Any) -> Data | None:
        """A data by its name; None where there is none."""
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
        """Add a data of its own: its name, its type as SOFA calls it (`Vec3d`, `vector<int>`) and its value."""
        if isinstance(name, Data):
            self.data_by_name[name.name] = name
            return name
        added = self.data_by_name[name] = Data(name, self, kind_called(type or _type_of(value)), default)
        if value is not None:
            added.set(value)
        return added

    def addNewData(self, name: str, _group: str, _help: str, type: str, value: Any) -> Data:
        """Add a data of its own, in the older generation."""
        return self.addData(name, value, type=type)

    def set_all(self, values: Mapping[str, Any]) -> None:
        """Write to the data that `values` names, made here where nothing is known of the type."""
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
        """The values of its data by their names."""
        return {name: data.value for name, data in self.data_by_name.items()}

    # Names and paths.

    @abstractmethod
    def link_start(self) -> "Branch":
        """The node from which its links start."""

    def getName(self) -> str:
        """Its name."""
        data = self.data_by_name.get("name")
        return str(data.read_value()) if data is not None and data.is_set() else self.type_name

    def setName(self, name: str, *_number: int) -> None:
        """Give it another name."""
        self.set_all({"name": name})

    def getClassName(self) -> str:
        """Its type."""
        return self.type_name

    @abstractmethod
    def getPathName(self) -> str:
        """The path from the root to it, such as /finger/loader."""

    @property
    def linkpath(self) -> LinkPath:
        """The path that leads to it, as data take it."""
        return LinkPath(f"@{self.getPathName()}", self)

    def getLinkPath(self) -> LinkPath:
        """The path that leads to it, as data take it."""
        return self.linkpath

    def getAsACreateObjectParameter(self) -> LinkPath:
        """The path that leads to it, as data take it."""
        return self.linkpath

    def described(self) -> str:
        """What errors call it."""
        return f"{self.type_name} '{self.getPathName()}'"

    def linked_data(self, path: str, same_name: str) -> Data | None:
        """The data that a path leads to, in a component that of the same name; None if it leads nowhere."""
        found = path.target if isinstance(path, LinkPath) else follow(path, self.link_start(), self)
        return found.findData(same_name) if isinstance(found, Base) else found

    def linked(self, name: str) -> Any:
        """The component, node or data that a link among the data leads to, such as `src`; None if it leads nowhere."""
        data = self.findData(name)
        if data is None or not data.is_set():
            return None
        path = data.read_value()
        if isinstance(path, LinkPath):
            return path.target
        return follow(str(path), self.link_start(), self) if str(path).startswith("@") else None

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
        """Whether writing to an attribute writes to a data, and does not just remember something for the scene."""
        return name in self.data_by_name or self.declared_data(name) is not None

    def missing_attribute(self, name: str) -> str:
        """The error about an attribute that is not there."""
        known = sorted({*self.data_by_name, *COMMON, *self.known_names()})
        return f"{self.described()} has no '{name}'; {nearest(name, known, 'there are')}"

    def known_names(self) -> list[str]:
        """The names of what it has besides its data."""
        return []

    def __repr__(self) -> str:
        return f"<{self.described()}>"

    # What SOFA calls.

    def init(self) -> None:
        """Nothing; scenes' own classes do what they need once the scene is complete."""

    def reinit(self) -> None:
        """Nothing; components remember that they were asked to."""


def _type_of(value: Any) -> str:
    """The type of a data whose scene gives a value alone."""
    names = {bool: "bool", int: "int", float: "double", str: "string"}
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return "vector<double>"
    return names.get(type(value), "")
