"""Components of a node, with what is declared of their types; what components and nodes have in common."""

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from types import ModuleType
from typing import Any, Self, TypeVar

import numpy as np

from taichisoft.errors import SceneError, nearest
from taichisoft_sofa.tree.data import Data, LinkPath, getter
from taichisoft_sofa.tree.place import Place, here
from taichisoft_sofa.tree.value_kinds import (
    ANY,
    BOOL,
    FALSE,
    INTEGER,
    LINK,
    SCALAR,
    TEXT,
    TEXTS,
    TRUE,
    VECTOR,
    Declared,
    ValueKind,
    WrongValue,
    canonical,
    kind_called,
    numbers,
)

# Paths of links between components: @loader.position, @../finger1/boxROI.indices, @/Config.


def follow(path: str, start: Any, owner: Any = None) -> Any:
    """Resolve a path to a component, a node or a data; None for a broken path.

    Args:
        path: path, with or without @.
        start: node at which the path starts; None of a component without a node, all of whose paths are broken.
        owner: component with the path; @[-1] is the component added before it.

    A path that begins with a name is searched in the node, then in its ancestors.
    """
    if start is None:
        return None
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


def _first_above(node: Any, names: list[str], owner: Any) -> Any:
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


def _neighbour(node: Any, owner: Any, offset: int) -> Any:
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

    # Names and paths.

    @abstractmethod
    def link_start(self) -> Any:
        """The node from which links start, or None."""

    def getName(self) -> str:
        data = self.data_by_name.get("name")
        return str(data.read_value()) if data is not None and data.is_set() else self.type_name

    def setName(self, name: str, *_number: int) -> None:
        self.set_all({"name": name})

    @abstractmethod
    def getPathName(self) -> str:
        """Path from the root, such as /finger/loader."""

    @property
    def linkpath(self) -> LinkPath:
        return LinkPath(f"@{self.getPathName()}", self)

    def described(self) -> str:
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

    # Values for the translation.

    def is_given(self, name: str) -> bool:
        """Whether the scene wrote to a data."""
        data = self.findData(name)
        return data is not None and data.is_set()

    def read_data(self, *names: str) -> Any:
        """The value of the first of these data that the scene wrote, else the default of the first, or None."""
        for name in names:
            if self.is_given(name) and (data := self.findData(name)) is not None:
                return data.given()
        data = self.findData(names[0]) if self.declared_data(names[0]) is not None else None
        return None if data is None else data.given()

    def read_numbers(self, *names: str, default: Sequence[float] | None = None) -> np.ndarray:
        """Numbers of the first of these data that the scene wrote, else the default, flattened, shape (n,).

        A default replaces the declared one.
        """
        if default is not None and not any(self.is_given(name) for name in names):
            return np.array(default, dtype=np.float64)
        value = self.read_data(*names)
        try:
            return np.zeros(0) if value is None else numbers(value, bools=True)
        except WrongValue as error:
            raise self.refused(f"{names[0]}: {error}") from error

    def read_number(self, *names: str, default: float | None = None) -> float:
        """The first number of a data."""
        values = self.read_numbers(*names, default=None if default is None else [default])
        if not len(values):
            raise self.refused(f"{names[0]} is empty; a number is needed")
        return float(values[0])

    def read_each(self, name: str, count: int, things: str) -> np.ndarray:
        """A number of a data for each of `count` things, given one by one or the same for all, shape (count,)."""
        values = self.read_numbers(name)
        if len(values) not in (1, count):
            raise self.refused(f"{name} has {len(values)} numbers for {count} {things}")
        return np.broadcast_to(values, count)

    def read_vector(self, *names: str, default: Sequence[float] | None = None) -> np.ndarray:
        """Three numbers of a data; a default replaces the declared one."""
        values = self.read_numbers(*names, default=default)
        if len(values) != 3:
            raise self.refused(f"{names[0]} has {len(values)} numbers; 3 are needed")
        return values

    def read_flag(self, name: str) -> bool:
        """A data that is true or false."""
        value = self.read_data(name)
        if isinstance(value, str):
            if value.strip().lower() not in TRUE | FALSE:
                raise self.refused(f"{name} = '{value}'; must be true or false")
            return value.strip().lower() in TRUE
        return value is not None and bool(np.ravel(value)[0])

    def read_text(self, *names: str) -> str:
        """A data as text."""
        value = self.read_data(*names)
        return "" if value is None else str(value).strip()

    def refused(self, why: str) -> SceneError:
        """Error that this cannot be translated, and why."""
        return SceneError(f"{self.described()} ({self.place}): {why}")

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

    # SOFA's names, those of the older generation among them.

    getLinkPath = getAsACreateObjectParameter = getter("linkpath")
    getClassName = getter("type_name")

    def getData(self, name: str, *_rest: Any) -> Data | None:
        return self.findData(name)

    def getDataFields(self) -> dict[str, Any]:
        """Values of the data by name."""
        return {name: data.value for name, data in self.data_by_name.items() if data.is_set() or data.is_declared()}

    def addNewData(self, name: str, _group: str, _help: str, type: str, value: Any) -> Data:
        return self.addData(name, value, type=type)

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


@dataclass(frozen=True)
class ComponentType:
    """A type of component: its data by name, and the function that translates it to the draft of a scene."""

    data: Mapping[str, Declared]
    translate: Callable[[Any, Any], None]


Translate = TypeVar("Translate", bound=Callable[[Any, Any], None])
MARK = "component_types"
OF_COMPONENTS = {**COMMON, "template": Declared(TEXT), "src": Declared(LINK)}


def component(*type_names: str, **data: Any) -> Callable[[Translate], Translate]:
    """Declare the types that a function translates, and the data that are read of them.

    A data is SOFA's default, with bounds `radius=(1.0, ABOVE_0)`; a kind, with a default and bounds where that says too
    little, `indices=(INDICES, (0,), FROM_0)`; or what `derived`, `live` or `unused` return. `register` makes the
    declarations known.
    """

    def mark(function: Translate) -> Translate:
        kind = ComponentType({name: _declaration(given) for name, given in data.items()}, function)
        vars(function).setdefault(MARK, {}).update(dict.fromkeys(type_names, kind))
        return function

    return mark


KINDS: dict[type, ValueKind] = {bool: BOOL, int: INTEGER, float: SCALAR, str: TEXT, tuple: VECTOR}
"""Kinds of data by the type of SOFA's default; a tuple of numbers is one of any length."""


def _declaration(given: Any) -> Declared:
    if isinstance(given, Declared):
        return given
    is_alone = not isinstance(given, tuple) or all(isinstance(part, int | float) for part in given)
    first, *others = (given,) if is_alone else given
    return Declared(KINDS[type(first)], first, *others) if type(first) in KINDS else Declared(first, *others)


def derived(given: Any, compute: Callable[[Any], Any]) -> Declared:
    """A data that is computed from others by a function of the component, which reads values by `Data.given`."""
    return replace(_declaration(given), compute=compute)


def live(*given: Any) -> Declared:
    """A data of this kind or default, and bounds, that a run reads in every step."""
    return replace(_declaration(given if len(given) > 1 else given[0]), live=True)


def unused(default: Any) -> Declared:
    """A data that affects the motion of bodies in SOFA, but not here: reported unless it has SOFA's default."""
    return replace(_declaration(default), unused=True)


def without_effect(names: str) -> dict[str, Declared]:
    """Data that nothing reads, but that would pass for misspelt names of others; any value is valid."""
    return dict.fromkeys(names.split(), Declared(ANY))


TYPES: dict[str, ComponentType] = {}
"""The known types by their present names; `register` fills it."""


def register(*modules: ModuleType) -> None:
    """Make the types known that functions of the modules declare."""
    for module in modules:
        for item in vars(module).values():
            TYPES.update(vars(item).get(MARK, {}) if callable(item) and hasattr(item, "__dict__") else {})


def declared(type_name: str) -> Mapping[str, Declared]:
    """Declared data of a type of component by name; empty for an undeclared type."""
    known = TYPES.get(canonical(type_name))
    return {} if known is None else known.data


def names_of(type_name: str) -> tuple[str, ...]:
    """Names of the declared data of a type of component, and of those of every component."""
    return *declared(type_name), *OF_COMPONENTS


class Component(TreeObject):
    """A component, called an object in scenes.

    Attributes:
        reinit_requested: whether `reinit` was called and not yet processed.
    """

    _context: TreeObject | None
    reinit_requested: bool

    def __new__(cls, *arguments: Any, **named: Any) -> "Component":
        made = super().__new__(cls, *arguments, **named)
        made._context = None
        made.reinit_requested = False
        return made

    def __init__(
        self,
        type_name: str,
        context: TreeObject | None = None,
        data: Mapping[str, Any] | None = None,
        place: Place | None = None,
    ) -> None:
        self.type_name = type_name
        self.place = place or self.place
        self._context = context
        self.set_all(data or {})

    def declared_data(self, name: str) -> Declared | None:
        return declared(self.type_name).get(name) or OF_COMPONENTS.get(name)

    def has_known_data(self) -> bool:
        return canonical(self.type_name) in TYPES

    def findData(self, name: str) -> Data | None:
        """A data by name; None for a misspelt one. Other names that are not declared can be written to, not read."""
        found = super().findData(name)
        if found is None and type(self) is Component and not misspelt(name, names_of(self.type_name)):
            found = self.data_by_name[name] = Data(name, self)
        return found

    def takes_data(self, name: str, value: Any) -> bool:
        """True for values, even of unknown data; False for functions and other objects."""
        return super().takes_data(name, value) or isinstance(
            value, bool | int | float | str | list | tuple | np.ndarray | Data
        )

    def known_names(self) -> list[str]:
        return list(declared(self.type_name))

    def link_start(self) -> Any:
        return self._context

    def getPathName(self) -> str:
        return f"{self._context.getPathName().rstrip('/') if self._context is not None else ''}/{self.getName()}"

    def getContext(self) -> Any:
        return self._context

    def getTemplateName(self) -> str:
        template = self.findData("template")
        return "" if template is None else str(template.read_value())

    def reinit(self) -> None:
        """Request an update after changes of data, such as of the stiffness by Young's modulus."""
        self.reinit_requested = True
