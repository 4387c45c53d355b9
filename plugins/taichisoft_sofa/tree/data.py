"""Data of a component: values written by the scene, computed from other data, or provided by a run."""

import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.place import Place, asked_by_older_code, here, now
from taichisoft_sofa.tree.value_kinds import ANY, LINK, TEXT, Declared, ValueKind, WrongValue, numbers

# Arithmetic on data: scenes add, compare, index and iterate over data like values.


class Arithmetic:
    """Base class of objects that act as their value in expressions."""

    value: Any
    __hash__ = object.__hash__

    def __setitem__(self, index: Any, item: Any) -> None:
        changed = self.value
        changed[index] = item
        self.value = changed

    def __iter__(self) -> Iterator[Any]:
        return iter(self.value)

    def __contains__(self, item: Any) -> bool:
        return item in self.value

    def __bool__(self) -> bool:
        value = self.value
        return len(value) > 0 if hasattr(value, "__len__") else bool(value)

    def __float__(self) -> float:
        return float(self._number())

    def __int__(self) -> int:
        return int(self._number())

    def __index__(self) -> int:
        return operator.index(self.value)

    def __round__(self, digits: int | None = None) -> Any:
        return round(self.value, digits)

    def __str__(self) -> str:
        return str(self.value)

    def __format__(self, form: str) -> str:
        return format(self.value, form)

    def __neg__(self) -> Any:
        return -_operand(self)

    def __abs__(self) -> Any:
        return abs(_operand(self))

    def __eq__(self, other: object) -> bool:
        mine: Any
        others: Any
        mine, others = (item.value if isinstance(item, Arithmetic) else item for item in (self, other))
        if mine is None or others is None:
            return self is other
        return np.array_equal(mine, others)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.array(self.value, dtype)

    def _number(self) -> Any:
        value = self.value
        if isinstance(value, str):
            return float(value)
        return value.item() if isinstance(value, np.ndarray) else value


def _operand(item: Any) -> Any:
    """The value of an operand; lists become arrays, so that they are added elementwise."""
    value = item.value if isinstance(item, Arithmetic) else item
    return np.asarray(value) if isinstance(value, list | tuple) else value


def _forward(operation: Callable[[Any, Any], Any]) -> Any:
    return lambda self, other: operation(_operand(self), _operand(other))


def _backward(operation: Callable[[Any, Any], Any]) -> Any:
    return lambda self, other: operation(_operand(other), _operand(self))


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "matmul"):
    setattr(Arithmetic, f"__{_name}__", _forward(getattr(operator, _name)))
    setattr(Arithmetic, f"__r{_name}__", _backward(getattr(operator, _name)))
for _name in ("lt", "le", "gt", "ge"):
    setattr(Arithmetic, f"__{_name}__", _forward(getattr(operator, _name)))


class Owner(Protocol):
    """Owner of data: a component or a node."""

    data_revision: int
    initialised: bool

    def getPathName(self) -> str: ...
    def described(self) -> str: ...
    def declared_data(self, name: str) -> Declared | None: ...
    def has_known_data(self) -> bool: ...
    def missing_attribute(self, name: str) -> str: ...
    def linked_data(self, path: str, same_name: str) -> "Data | None": ...


def getter(attribute: str) -> Callable[[Any], Any]:
    """Method of SOFA's that returns an attribute."""
    return lambda self: getattr(self, attribute)


class LinkPath(str):
    """The path of a data, component or node, with a reference to its target that survives changes of the tree.

    Attributes:
        target: target of the path.
    """

    target: Any

    def __new__(cls, path: str, target: Any) -> "LinkPath":
        link = super().__new__(cls, path)
        link.target = target
        return link


class Data(Arithmetic):
    """One data of a component or node.

    A scene writes numbers, texts, lists, arrays or links to it, and reads values of its kind. The value read is the one
    that is provided, by a run or computed from other data, unless the scene has written another since the run's last
    step or the initialisation of the component; without a provided one, the written value or the default.

    Attributes:
        name: name.
        owner: component or node of the data.
        revision: number of writes.
        place: line of the last write.
        provider: function that returns the value in a run, or None.
        was_read: whether anything has read what the scene wrote.
        names_given: number of writes to names of any component or node.
    """

    names_given = 0

    def __init__(self, name: str, owner: Owner, kind: ValueKind | None = None, default: Any = None) -> None:
        self.name = name
        self.owner = owner
        self.revision = 0
        self.place: Place | None = None
        self.provider: Callable[[], Any] | None = None
        self.was_read = False
        self._own = Declared(kind, default, None) if kind is not None else None
        self._written: Any = None
        self._converted: tuple[ValueKind, Any, Any] | None = None  # kind, converted value, and result
        self._rows: tuple[NDArray[Any], list[Any]] | None = None
        self._parent: Data | None = None
        self._path: str | None = None
        self._overrides = False
        self._taken = 0
        self._computed: tuple[int, Any] | None = None
        self._computing = False
        self._provided: tuple[object, Any] | None = None

    # Description.

    @property
    def kind(self) -> ValueKind:
        known = self._declared()
        if known is None:
            return ANY
        return known.kind if isinstance(known.kind, ValueKind) else known.kind(self.owner)

    @property
    def linkpath(self) -> LinkPath:
        return LinkPath(f"@{self.owner.getPathName()}.{self.name}", self)

    def described(self) -> str:
        return f"data '{self.name}' of {self.owner.described()}"

    # Reading.

    @property
    def value(self) -> Any:
        """Value: a number, a text, or a copy of an array; for older code a list of rows instead."""
        value = self.read_value()
        if (rows := self._older_rows(value)) is not None:
            return [list(row) for row in rows]
        return value.copy() if isinstance(value, np.ndarray) else value

    @value.setter
    def value(self, value: Any) -> None:
        self.set(value)

    def array(self) -> NDArray[Any]:
        """Read-only array of numbers."""
        value = self.read_value()
        if isinstance(value, str) or value is None:
            value = numbers(value or "")
        view = np.asarray(value).view()
        view.flags.writeable = False
        return view

    def read_value(self) -> Any:
        """Value, without a copy of arrays."""
        if not self._overrides and not self._computing:
            if self.provider is not None:
                return self._provide(self.provider)
            if (known := self._declared()) is not None and known.compute is not None:
                return self._compute(known.compute)
        return self.given()

    def given(self) -> Any:
        """Written value or target of the link, converted to the kind; else the default."""
        self.was_read = True
        if self._path is not None:
            self._parent = self.owner.linked_data(self._path, self.name)
            if self._parent is None:
                raise SceneError(f"{self.place}: {self.described()}: '{self._path}' leads to no data")
            self._path = None
        if self._parent is not None:
            value = self._parent.read_value()
            if value is not None:  # else nothing has been written there, such as what a device would send
                return self._convert(value)
        elif self.is_set():
            return self._convert(self._written)
        known = self._declared()
        if known is None and self.owner.has_known_data():
            raise SceneError(self.owner.missing_attribute(self.name))
        if known is None or known.default is None:
            return self.kind.empty()
        return self._convert(known.default)

    def is_set(self) -> bool:
        return self.revision > 0

    def is_declared(self) -> bool:
        return self._declared() is not None

    def is_own(self) -> bool:
        return self._own is not None

    def written(self) -> Any:
        """Written value, as in the scene; None for a link that was resolved."""
        self.was_read = True
        return self._path or self._written

    def written_text(self) -> str:
        """Written value as in the scene, for lists and errors."""
        if self._parent is not None or self._path is not None:
            return str(self._path or (self._parent and self._parent.linkpath))
        return str(self._written)

    # Writing.

    def set(self, value: Any, place: Place | None = None) -> None:
        """Write a value.

        Args:
            value: value, text of a value, or another data or its path as a link.
            place: line of the write; None: the line being executed.
        """
        self.place = place or here()
        self._parent = self._path = self._written = self._converted = None
        if hasattr(value, "linkpath") and not isinstance(value, Data):
            value = value.linkpath
        if isinstance(value, LinkPath) and isinstance(value.target, Data) and self.kind not in (LINK, TEXT):
            value = value.target
        if isinstance(value, Data):
            self._parent = value
        elif self._is_path(value):
            self._parent = self.owner.linked_data(value, self.name)
            self._path = value if self._parent is None else None
        else:
            self._written = value.copy() if isinstance(value, np.ndarray | list) else value
            self._convert(self._written)
        self._overrides = self.owner.initialised or self.provider is not None
        self.revision += 1
        self.owner.data_revision += 1
        Data.names_given += self.name == "name"

    @contextmanager
    def writeable(self, _shape: Any = None) -> Iterator[NDArray[Any]]:
        """Yield the numbers as an array to change, which is written back at the end."""
        changed = np.array(self.array())
        yield changed
        self.set(changed.copy())
        changed.flags.writeable = False

    def take(self) -> Any:
        """Value written since the last call, converted to the kind, or None; the provider's is read again."""
        self._overrides = self._overrides and self.provider is None
        if self.revision == self._taken:
            return None
        self._taken = self.revision
        return self.given()

    # Access like the value itself.

    def __getitem__(self, index: Any) -> Any:
        # Without a copy of the whole array: scenes loop over the nodes of a mesh.
        value = self.read_value()
        rows = self._older_rows(value)
        item = value[index] if rows is None else rows[index]
        return item.copy() if isinstance(item, np.ndarray | list) else item

    def __len__(self) -> int:
        value = self.read_value()
        rows = self._older_rows(value)
        return len(value if rows is None else rows)

    def unset(self) -> None:
        """Remove the written value."""
        self._written = self._converted = self._parent = self._path = None
        self._overrides = False
        self.revision = self._taken = 0
        self.owner.data_revision += 1

    def read(self, text: str) -> bool:
        """Write a text; returns whether it is of the data's kind."""
        try:
            self.set(text)
        except SceneError:
            return False
        return True

    def getValueString(self) -> str:
        value = self.read_value()
        return " ".join(f"{item:g}" for item in value.ravel()) if isinstance(value, np.ndarray) else str(value)

    # SOFA's names; values are computed on access, links are written like values, and scenes are not saved.

    getName = getter("name")
    getOwner = getter("owner")
    getLinkPath = getAsACreateObjectParameter = getter("linkpath")
    getParent = getter("_parent")
    isSet = is_set
    setParent = set
    writeableArray = writeable
    getSize = __len__
    shape = property(lambda self: self.array().shape)
    size = property(lambda self: self.array().size)
    ndim = property(lambda self: self.array().ndim)

    def setName(self, name: str) -> None:
        self.name = name

    def hasParent(self) -> bool:
        return self._parent is not None or self._path is not None

    def getValue(self, index: int = 0) -> Any:
        return self.array().ravel()[index]

    def typeName(self) -> str:
        return self.kind.name

    def tolist(self) -> Any:
        return self.array().tolist()

    getValueTypeString, toList = typeName, tolist

    def updateIfDirty(self) -> None: ...

    def __call__(self, *_arguments: Any, **_named: Any) -> Any:
        raise AttributeError(
            f"{self.owner.described()} has no method '{self.name}' here; '{self.name}' is taken for data"
        )

    def __repr__(self) -> str:
        return f"<{self.described()}>"

    # Parts.

    def _declared(self) -> Declared | None:
        return self._own or self.owner.declared_data(self.name)

    def _is_path(self, value: Any) -> bool:
        """Whether a value is a link; for undeclared data, only the path of an existing data is."""
        if not isinstance(value, str) or not value.lstrip().startswith("@"):
            return False
        kind = self.kind
        return kind not in (LINK, TEXT) and (kind is not ANY or "." in value.rpartition("/")[2].strip("."))

    def _convert(self, value: Any) -> Any:
        """Convert a value to the data's kind, which may depend on other data; the last conversion is cached."""
        kind = self.kind
        if kind is ANY:
            return value
        if self._converted is None or self._converted[0] is not kind or self._converted[1] is not value:
            known = self._declared()
            try:
                converted = kind.convert(value)
                if known is not None and known.bounds and (problem := known.bounds.problem(converted)):
                    raise WrongValue(problem)
            except (WrongValue, ValueError, TypeError, OverflowError) as error:
                raise SceneError(f"{self.place}: {self.described()}: {error}") from error
            self._converted = kind, value, converted
        return self._converted[2]

    def _older_rows(self, value: Any) -> list[Any] | None:
        """Rows of an array for code of the older generation; None for other code."""
        if not isinstance(value, np.ndarray) or not (width := self.kind.row) or not asked_by_older_code():
            return None
        if self._rows is None or self._rows[0] is not value:
            self._rows = value, value.reshape(-1, width).tolist()
        return self._rows[1]

    def _provide(self, provider: Callable[[], Any]) -> Any:
        """Value by the provider, cached within a moment, since scenes loop over the nodes of a mesh."""
        moment = now()
        if moment is None:
            return provider()
        if self._provided is None or self._provided[0] is not moment:
            self._provided = moment, provider()
        return self._provided[1]

    def _compute(self, compute: Callable[[Any], Any]) -> Any:
        """Computed value, cached until a data of the owner is written."""
        if self._computed is None or self._computed[0] != self.owner.data_revision:
            self._computing = True
            try:
                self._computed = self.owner.data_revision, self._convert(compute(self.owner))
            finally:
                self._computing = False
        return self._computed[1]
