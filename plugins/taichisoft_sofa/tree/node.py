"""A node of the tree: its components and the nodes below it."""

import logging
from collections.abc import Callable, Iterator
from typing import Any

from taichisoft_sofa.tree.component import COMMON, Component, TreeObject, follow, live
from taichisoft_sofa.tree.data import Data, getter
from taichisoft_sofa.tree.place import here
from taichisoft_sofa.tree.value_kinds import ABOVE_0, ALIASES, BOOL, INTEGER, SCALAR, Declared, canonical, fixed

LOG = logging.getLogger(__name__)
OF_NODES = {
    **COMMON,
    "gravity": live(fixed(3), (0.0, -9.81, 0.0)),
    "dt": Declared(SCALAR, 0.01, ABOVE_0),
    "time": Declared(SCALAR, 0.0),
    "animate": Declared(BOOL),
    "activated": Declared(BOOL, True),
    "nbMortalNodes": Declared(INTEGER),
}
# Functions of node and data that make components of special types.
MAKERS: dict[str, Callable[["Node", dict[str, Any]], Component]] = {}


class Members(list[Any]):
    """The children, parents or components of a node, also accessible by name."""

    def __contains__(self, item: object) -> bool:
        return any(item is member or item == member.getName() for member in self)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return next(member for member in self if member.getName() == key)
        return super().__getitem__(key)

    def at(self, index: int) -> Any:
        return self[index]


def ending_in(ending: str) -> Callable[..., Component | None]:
    """Method of a node that returns a component by the end of its type, the first or the one at an index; or None."""

    def get(self: "Node", index: int = 0) -> Component | None:
        matching = [item for item in self.objects if canonical(item.type_name).endswith(ending)]
        return matching[index] if index < len(matching) else None

    return get


class Node(TreeObject):
    """A node of the tree.

    Children, components and data are attributes by name.
    """

    _children: list["Node"]
    _parents: list["Node"]
    _objects: list[Component]
    _changes: list[tuple[TreeObject, str]]
    _taken: set[str]
    _names_given: int
    _numbers: dict[str, int]

    def __new__(cls, *arguments: Any, **named: Any) -> "Node":
        made = super().__new__(cls, *arguments, **named)
        made._children, made._parents, made._objects = [], [], []
        made._changes = []
        made._taken, made._names_given, made._numbers = set(), 0, {}
        return made

    def __init__(self, name: str = "unnamed", **data: Any) -> None:
        self.type_name = "Node"
        self.set_all({"name": name, **data})

    # Building.

    def addObject(self, kind: Any, **data: Any) -> Any:
        """Add a component by type and data, or an existing one, such as a controller."""
        if isinstance(kind, Node):
            return self.addChild(kind)
        if isinstance(kind, Component):
            return self._adopt(kind)
        if not isinstance(kind, str):
            raise TypeError(f"{self.described()}.addObject: {kind!r} is neither the name of a type nor a component")
        if maker := MAKERS.get(canonical(kind)):
            return maker(self, data)
        added = Component(kind, self)
        data = {name: value for name, value in data.items() if value is not None}
        free = None if "name" in data else self._free_name(kind)
        added.set_all(data if free is None else {"name": free, **data})
        self._objects.append(added)
        if free is not None:
            self._taken.add(free)
            self._names_given = Data.names_given
        self._note("adds", added)
        return added

    def addChild(self, child: Any, **data: Any) -> "Node":
        """Add a new child node by name, or an existing node, which may also have other parents."""
        if isinstance(child, str):
            child = Node(child, **data)
        child = getattr(child, "node", child) if not isinstance(child, TreeObject) else child
        if not isinstance(child, Node):
            raise TypeError(f"{self.described()}.addChild: {child!r} is neither a name nor a node")
        if child is self or child in self._above():
            raise ValueError(f"{self.described()}.addChild: '{child.getName()}' is above it already")
        if not any(self is known for known in child._parents):  # a node has few parents, and may have many children
            self._children.append(child)
            child._parents.append(self)
            self._note("adds", child)
        return child

    def add(self, made: Any, **data: Any) -> Any:
        """Add the result of a function of this node, or an argument of addObject or addChild."""
        if isinstance(made, str | TreeObject):
            return self.addObject(made, **data)
        return made(self, **data)

    def removeChild(self, child: Any) -> Any:
        """Remove a child node, given itself or its name."""
        found: Any = self.getChild(child, warning=False) if isinstance(child, str) else child
        if not any(found is known for known in self._children):
            raise ValueError(f"{self.described()}.removeChild: has no child '{child}'")
        self._note("removes", found)
        self._children = [known for known in self._children if known is not found]
        found._parents = [known for known in found._parents if known is not self]
        return found

    def removeObject(self, component: Any) -> None:
        """Remove a component, given itself or its name."""
        found: Any = self.own_object(component) if isinstance(component, str) else component
        if not any(found is known for known in self._objects):
            raise ValueError(f"{self.described()}.removeObject: has no object '{component}'")
        self._note("removes", found)
        self._objects = [known for known in self._objects if known is not found]
        self._names_given = 0
        found._context = None

    def moveChild(self, child: "Node", former: "Node | None" = None) -> None:
        """Move a node here from another parent, or from all its parents."""
        for parent in [former] if former is not None else child.parents:
            parent.removeChild(child)
        self.addChild(child)

    def detachFromGraph(self) -> None:
        """Remove the node from all parents."""
        for parent in self.parents:
            parent.removeChild(self)

    def _adopt(self, component: Component) -> Component:
        if component._context is not None and component._context is not self:
            component._context.removeObject(component)
        if not any(component is known for known in self._objects):
            component._context = self
            self._objects.append(component)
            self._names_given = 0
            self._note("adds", component)
        return component

    def _note(self, what: str, item: TreeObject) -> None:
        """Record a change of a complete tree; changes by the scene's own controllers affect a run."""
        root = self.getRoot()
        own_program = isinstance(item, Component) and type(item) is not Component
        if root.initialised and not own_program and (isinstance(item, Component) or any(item.walk_components())):
            root._changes.append((item, f"{here()}: the scene {what} {item.described()}"))

    def changes_of_tree(self) -> list[tuple[TreeObject, str]]:
        """Objects added or removed since the last call, with a line for each; for the root of a complete scene."""
        changes, self._changes = self._changes, []
        return changes

    def walk_components(self) -> Iterator[Component]:
        """All components of the node and its descendants."""
        for node in self.walk():
            yield from node._objects

    def _free_name(self, name: str) -> str:
        """An unused name for a component: the type, or the type with the first free number."""
        if self._names_given != Data.names_given:  # names have changed since; most scenes only add
            self._taken = {item.getName() for item in self._objects}
            self._names_given, self._numbers = Data.names_given, {}
        if name not in self._taken:
            return name
        number = self._numbers.get(name, 1)
        while f"{name}{number}" in self._taken:
            number += 1
        self._numbers[name] = number
        return f"{name}{number}"

    # Finding.

    @property
    def children(self) -> Members:
        """Child nodes, in the order of their addition."""
        return Members(self._children)

    @property
    def parents(self) -> Members:
        return Members(self._parents)

    @property
    def objects(self) -> Members:
        """Components, in the order of their addition."""
        return Members(self._objects)

    def getChild(self, name: str, warning: bool = True) -> "Node | None":
        """A descendant by name or a path such as finger/cavity, or None."""
        first, _, rest = str(name).partition("/")
        found = next((child for child in self._children if child.getName() == first), None)
        if found is not None and rest:
            return found.getChild(rest, warning)
        if found is None and warning:
            LOG.info("%s has no child '%s'", self.described(), name)
        return found

    def own_object(self, name: str) -> Component | None:
        """A component of this node by name, or None."""
        return next((item for item in self._objects if item.getName() == name), None)

    def getObject(self, name: str, warning: bool = True) -> Any:
        """A component by name or a path such as cavity/loader, or None."""
        found = self.own_object(str(name))
        if found is None and ("/" in name or name.startswith("@")):
            found = follow(str(name), self)
        if not isinstance(found, Component):
            if warning:
                LOG.info("%s has no object '%s'", self.described(), name)
            return None
        return found

    def getRoot(self) -> "Node":
        return self._parents[0].getRoot() if self._parents else self

    def walk(self) -> Iterator["Node"]:
        """The node and all descendants, each once, from the top down."""
        seen: set[int] = set()
        waiting = [self]
        while waiting:
            node = waiting.pop()
            if id(node) not in seen:
                seen.add(id(node))
                yield node
                waiting.extend(reversed(node._children))

    def _above(self) -> list["Node"]:
        return [node for parent in self._parents for node in (parent, *parent._above())]

    def __getitem__(self, path: str) -> Any:
        place: Any = self
        for name in filter(None, path.split(".")):
            place = getattr(place, name)
        return place

    # Description.

    def declared_data(self, name: str) -> Declared | None:
        return OF_NODES.get(name)

    def has_known_data(self) -> bool:
        """True: all nodes of SOFA have the same data."""
        return True

    def link_start(self) -> "Node":
        return self

    def known_names(self) -> list[str]:
        """Names of children, components, and declared data of nodes."""
        return [*(item.getName() for item in (*self._objects, *self._children)), *OF_NODES]

    def getPathName(self) -> str:
        return f"{self._parents[0].getPathName().rstrip('/')}/{self.getName()}" if self._parents else "/"

    def getRootPath(self) -> str:
        """Path to the root, such as ../../."""
        return "../" * (self.getPathName().count("/") if self._parents else 0)

    def described(self) -> str:
        return f"node '{self.getPathName() if self._parents else self.getName()}'"

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_"):
            found = self.own_object(name) or self.getChild(name, warning=False) or self._by_other_name(name)
            if found is not None:
                return found
        return super().__getattr__(name)

    def _by_other_name(self, name: str) -> Component | None:
        """A component without a name of its own by another name of its type, as versions of SOFA call it."""
        if canonical(name) == name and name not in ALIASES.values():
            return None
        same = (item for item in self._objects if canonical(item.type_name) == canonical(name))
        return next((item for item in same if item.getName() == item.type_name), None)

    def __hash__(self) -> int:
        return id(self)

    # SOFA's names, those of the older generation among them.

    createObject, createChild, getRootContext = addObject, addChild, getRoot
    getChildren, getParents, getObjects = getter("children"), getter("parents"), getter("objects")
    root = property(getRoot)
    isInitialized = getter("initialised")
    getMechanicalState, getMass = ending_in("MechanicalObject"), ending_in("Mass")
    getForceField, getMechanicalMapping = ending_in("ForceField"), ending_in("Mapping")

    def getContext(self) -> "Node":
        return self

    def hasObject(self, name: str) -> bool:
        return self.own_object(name) is not None

    def getGravity(self) -> Any:
        return self.gravity.value

    def setGravity(self, gravity: Any) -> None:
        self.gravity = gravity

    def getDt(self) -> float:
        return float(self.dt)

    def getTime(self) -> float:
        return float(self.time)

    def getRootDt(self) -> float:
        return self.getRoot().getDt()

    def init(self) -> None:
        """Do nothing: components are initialised on access."""
