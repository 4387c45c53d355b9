"""A component of a node: a solver, a mesh loader, a force field."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from taichisoft_sofa.tree.base import COMMON, TreeObject
from taichisoft_sofa.tree.data import Data
from taichisoft_sofa.tree.kinds import TEXT, Declared, canonical, declared
from taichisoft_sofa.tree.place import Place

# Functions that compute data, such as the positions of a loader, by type of component and name of data. Their argument
# is the component; they read values of the scene by `Data.given`.
COMPUTED: dict[str, dict[str, Callable[[Any], Any]]] = {}
OF_COMPONENTS = {**COMMON, "template": Declared(TEXT), "src": Declared(TEXT)}


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
        """Whether the type has declarations."""
        return bool(declared(self.type_name)) or canonical(self.type_name) in COMPUTED

    def computed_by(self, data: Data) -> Callable[[], Any] | None:
        """Function that computes a data from other data, or None."""
        function = COMPUTED.get(canonical(self.type_name), {}).get(data.name)
        return None if function is None else lambda: function(self)

    def findData(self, name: str) -> Data | None:
        """A data by name, or None."""
        if name not in self.data_by_name and name in COMPUTED.get(canonical(self.type_name), {}):
            self.data_by_name[name] = Data(name, self)
        return super().findData(name)

    def takes_data(self, name: str, value: Any) -> bool:
        """True for values, even of unknown data; False for functions and other objects."""
        return super().takes_data(name, value) or isinstance(
            value, bool | int | float | str | list | tuple | np.ndarray | Data
        )

    def known_names(self) -> list[str]:
        """Names of the declared data of the type."""
        return [*declared(self.type_name), *COMPUTED.get(canonical(self.type_name), {})]

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
