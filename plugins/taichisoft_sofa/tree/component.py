"""A component of a node: a solver, a mesh loader, a force field; and what is declared of its type."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from taichisoft_sofa.tree.base import COMMON, TreeObject, misspelt
from taichisoft_sofa.tree.data import Data
from taichisoft_sofa.tree.place import Place
from taichisoft_sofa.tree.value_kinds import (
    ANY,
    BOOL,
    INTEGER,
    SCALAR,
    TEXT,
    VECTOR,
    Declared,
    KindOf,
    ValueKind,
    canonical,
)


@dataclass(frozen=True)
class ComponentType:
    """A type of component: its data by name, and the function that translates it to the draft of a scene."""

    data: Mapping[str, Declared]
    translate: Callable[[Any, Any], None]


Translate = TypeVar("Translate", bound=Callable[[Any, Any], None])
MARK = "component_types"
OF_COMPONENTS = {**COMMON, "template": Declared(TEXT), "src": Declared(TEXT)}


def component(*type_names: str, **data: Any) -> Callable[[Translate], Translate]:
    """Declare the types that a function translates, and the data that are read of them.

    A data is a kind, a kind with SOFA's default and perhaps bounds, `youngModulus=(SCALAR, 5000, ABOVE_0)`, or what
    `derived` or `unused` return. `register` makes the declarations known.
    """

    def mark(function: Translate) -> Translate:
        kind = ComponentType({name: _declaration(given) for name, given in data.items()}, function)
        vars(function).setdefault(MARK, {}).update(dict.fromkeys(type_names, kind))
        return function

    return mark


def _declaration(given: Any) -> Declared:
    if isinstance(given, Declared):
        return given
    return Declared(*given) if isinstance(given, tuple) else Declared(given)


def derived(kind: KindOf, compute: Callable[[Any], Any]) -> Declared:
    """A data that is computed from others by a function of the component, which reads values by `Data.given`."""
    return Declared(kind, compute=compute)


def unused(default: Any) -> Declared:
    """A data that affects the motion of bodies in SOFA, but not here: reported unless it has SOFA's default."""
    kinds: dict[type, ValueKind] = {bool: BOOL, int: INTEGER, float: SCALAR, tuple: VECTOR}
    return Declared(kinds.get(type(default), TEXT), default, unused=True)


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
        """Declaration of a data of this type, or None."""
        return declared(self.type_name).get(name) or OF_COMPONENTS.get(name)

    def has_known_data(self) -> bool:
        """Whether the type is declared."""
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
        """Names of the declared data of the type."""
        return list(declared(self.type_name))

    def link_start(self) -> Any:
        """The node of the component."""
        return self._context if self._context is not None else NOWHERE

    def getPathName(self) -> str:
        """Path from the root, such as /finger/loader."""
        return f"{self._context.getPathName().rstrip('/') if self._context is not None else ''}/{self.getName()}"

    def getContext(self) -> Any:
        """The node of the component."""
        return self._context

    def getTemplateName(self) -> str:
        """Template, such as Vec3."""
        template = self.findData("template")
        return "" if template is None else str(template.read_value())

    def getCategories(self) -> list[str]:
        """Categories, which are not recorded."""
        return []

    def reinit(self) -> None:
        """Request an update after changes of data, such as of the stiffness by Young's modulus."""
        self.reinit_requested = True


class _Nowhere:
    """Start of the links of a component without a node."""

    parents: tuple[Any, ...] = ()
    objects: tuple[Any, ...] = ()

    def getChild(self, _name: str, warning: bool = True) -> None:
        return None

    def own_object(self, _name: str) -> None:
        return None

    def getRoot(self) -> "_Nowhere":
        return self


NOWHERE = _Nowhere()
