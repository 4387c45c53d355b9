"""Data of a component: what a scene wrote, what follows from it, and what a run knows of it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.arithmetic import Arithmetic
from taichisoft_sofa.tree.kinds import ANY, LINK, TEXT, Declared, Kind, WrongValue, numbers
from taichisoft_sofa.tree.moment import now
from taichisoft_sofa.tree.place import Place, asked_by_older_code, here


class Owner(Protocol):
    """What data belongs to: a component or a node."""

    data_revision: int
    initialised: bool

    def getPathName(self) -> str: ...
    def described(self) -> str: ...
    def declared_data(self, name: str) -> Declared | None: ...
    def computed_by(self, data: "Data") -> Callable[[], Any] | None: ...
    def linked_data(self, path: str, same_name: str) -> "Data | None": ...


class LinkPath(str):
    """The path of a data, component or node, which remembers what it leads to when the tree around it changes.

    Attributes:
        target: what the path leads to.
    """

    target: Any

    def __new__(cls, path: str, target: Any) -> "LinkPath":
        link = super().__new__(cls, path)
        link.target = target
        return link


class Data(Arithmetic):
    """One data of a component or node.

    A scene writes numbers, texts, lists, arrays or links to it, and reads values of its kind. What is read is, in this
    order: what a run provides; what was written since the component was initialised; what follows from other data; what
    the scene gave.

    Attributes:
        name: its name.
        owner: the component or node that has it.
        revision: how often it was written to.
        place: the line that wrote to it last.
        provider: gives the value that it has in a run, where one goes on.
        names_given: how often any name was written, of whatever component or node.
    """

    names_given = 0

    def __init__(self, name: str, owner: Owner, kind: Kind | None = None, default: Any = None) -> None:
        self.name = name
        self.owner = owner
        self.revision = 0
        self.place: Place | None = None
        self.provider: Callable[[], Any] | None = None
        self._own = Declared(kind, default, None) if kind is not None else None
        self._written: Any = None
        self._converted: tuple[Kind, Any, Any] | None = None  # a kind, what was converted to it, and the result
        self._rows: tuple[NDArray[Any], list[Any]] | None = None
        self._parent: Data | None = None
        self._path: str | None = None
        self._overrides = False
        self._taken = 0
        self._computed: tuple[int, Any] | None = None
        self._computing = False
        self._provided: tuple[object, Any] | None = None

    # What it is.

    @property
    def kind(self) -> Kind:
        """The kind of its values."""
        known = self._declared()
        if known is None:
            return ANY
        return known.kind if isinstance(known.kind, Kind) else known.kind(self.owner)

    @property
    def linkpath(self) -> LinkPath:
        """The path that leads to it, as other data take it."""
        return LinkPath(f"@{self.owner.getPathName()}.{self.name}", self)

    def described(self) -> str:
        """What errors call it."""
        return f"data '{self.name}' of {self.owner.described()}"

    # Reading.

    @property
    def value(self) -> Any:
        """Its value: a number, a text, or an array, which is a copy; for older code a list of rows in its place."""
        value = self.read_value()
        if (rows := self._older_rows(value)) is not None:
            return [list(row) for row in rows]
        return value.copy() if isinstance(value, np.ndarray) else value

    @value.setter
    def value(self, value: Any) -> None:
        self.set(value)

    def array(self) -> NDArray[Any]:
        """Its numbers, not to be written to."""
        value = self.read_value()
        if isinstance(value, str) or value is None:
            value = numbers(value or "")
        view = np.asarray(value).view()
        view.flags.writeable = False
        return view

    def read_value(self) -> Any:
        """Its value, of which arrays are not copied.

        Raises:
            SceneError: A link leads nowhere, or a value is not of the kind.
        """
        if self.provider is not None and self.revision == self._taken:
            return self._provide(self.provider)
        if not self._overrides and not self._computing:
            compute = self.owner.computed_by(self)
            if compute is not None:
                return self._compute(compute)
        return self.given()

    def given(self) -> Any:
        """What was written to it, or what its link leads to, as a value of its kind; its default without that."""
        if self._path is not None:
            self._parent = self.owner.linked_data(self._path, self.name)
            if self._parent is None:
                raise SceneError(f"{self.place}: {self.described()}: '{self._path}' leads to no data")
            self._path = None
        if self._parent is not None:
            return self._convert(self._parent.read_value())
        if self.is_set():
            return self._convert(self._written)
        known = self._declared()
        if known is None or known.default is None:
            return self.kind.empty()
        return self._convert(known.default)

    def is_set(self) -> bool:
        """Whether anything was written to it."""
        return self.revision > 0

    def is_own(self) -> bool:
        """Whether the scene added it, to a component that has no such data by itself."""
        return self._own is not None

    def written_text(self) -> str:
        """What was written to it, as the scene has it, for lists and errors."""
        if self._parent is not None or self._path is not None:
            return str(self._path or (self._parent and self._parent.linkpath))
        return str(self._written)

    # Writing.

    def set(self, value: Any, place: Place | None = None) -> None:
        """Write to it.

        Args:
            value: A value, a text that stands for one, or another data or its path to follow.
            place: the line that writes; the one that is being executed when it is not given.

        Raises:
            SceneError: the value is not of its kind.
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
        self._overrides = self.owner.initialised
        self.revision += 1
        self.owner.data_revision += 1
        Data.names_given += self.name == "name"

    @contextmanager
    def writeable(self, _shape: Any = None) -> Iterator[NDArray[Any]]:
        """Its numbers as an array to change, which is written back at the end."""
        changed = np.array(self.array())
        yield changed
        self.set(changed.copy())
        changed.flags.writeable = False

    def take(self) -> Any:
        """What was written to it since the last call, as a value of its kind; None if nothing was.

        While there is something to take it is also what is read, in place of what the provider gives.
        """
        if self.revision == self._taken:
            return None
        self._taken = self.revision
        return self.given()

    # As if it were its value.

    def __getitem__(self, index: Any) -> Any:
        # Without a copy of all: scenes loop over the nodes of a mesh.
        value = self.read_value()
        rows = self._older_rows(value)
        item = value[index] if rows is None else rows[index]
        return item.copy() if isinstance(item, np.ndarray | list) else item

    def __len__(self) -> int:
        value = self.read_value()
        rows = self._older_rows(value)
        return len(value if rows is None else rows)

    # SOFA's own names.

    writeableArray = writeable

    def getName(self) -> str:
        """Its name."""
        return self.name

    def setName(self, name: str) -> None:
        """Give it another name."""
        self.name = name

    def getOwner(self) -> Any:
        """The component or node that has it."""
        return self.owner

    def getLinkPath(self) -> LinkPath:
        """The path that leads to it, as other data take it."""
        return self.linkpath

    def getAsACreateObjectParameter(self) -> LinkPath:
        """The path that leads to it, as other data take it."""
        return self.linkpath

    def isSet(self) -> bool:
        """Whether anything was written to it."""
        return self.is_set()

    def unset(self) -> None:
        """Forget what was written to it."""
        self._written = self._converted = self._parent = self._path = None
        self._overrides = False
        self.revision = self._taken = 0
        self.owner.data_revision += 1

    def setParent(self, parent: Any) -> None:
        """Follow another data, or the one that a path leads to."""
        self.set(parent)

    def getParent(self) -> "Data | None":
        """The data that it follows."""
        return self._parent

    def hasParent(self) -> bool:
        """Whether it follows another data."""
        return self._parent is not None or self._path is not None

    def read(self, text: str) -> bool:
        """Write a text to it; whether that is of its kind."""
        try:
            self.set(text)
        except SceneError:
            return False
        return True

    def getValue(self, index: int = 0) -> Any:
        """A number of it."""
        return self.array().ravel()[index]

    def getValueString(self) -> str:
        """Its value as a text."""
        value = self.read_value()
        return " ".join(f"{item:g}" for item in value.ravel()) if isinstance(value, np.ndarray) else str(value)

    def getSize(self) -> int:
        """How many rows it has."""
        return len(self)

    def typeName(self) -> str:
        """What kind of values it has."""
        return self.kind.name

    getValueTypeString = typeName

    def tolist(self) -> Any:
        """Its value as lists."""
        return self.array().tolist()

    toList = tolist

    def updateIfDirty(self) -> None:
        """Nothing: it is always up to date."""

    def isDirty(self) -> bool:
        """Whether it waits to be computed: never, since that is done when it is read."""
        return False

    def setPersistent(self, _persistent: bool) -> None:
        """Nothing: no scene is written back."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of its array."""
        return self.array().shape

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return self.array().size

    @property
    def ndim(self) -> int:
        """How many dimensions its array has."""
        return self.array().ndim

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
        """Whether a value is to be followed: where nothing is known of the data, only a path that names one."""
        if not isinstance(value, str) or not value.lstrip().startswith("@"):
            return False
        kind = self.kind
        return kind not in (LINK, TEXT) and (kind is not ANY or "." in value.rpartition("/")[2].strip("."))

    def _convert(self, value: Any) -> Any:
        """Something as a value of its kind, which changes with other data; the same again is not converted again."""
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
        """The rows of an array as the older generation gives them, if it is older code that asks."""
        if not isinstance(value, np.ndarray) or not (width := self.kind.row) or not asked_by_older_code():
            return None
        if self._rows is None or self._rows[0] is not value:
            self._rows = value, value.reshape(-1, width).tolist()
        return self._rows[1]

    def _provide(self, provider: Callable[[], Any]) -> Any:
        """What a run gives, asked for once in a moment: scenes loop over the nodes of a mesh."""
        moment = now()
        if moment is None:
            return provider()
        if self._provided is None or self._provided[0] is not moment:
            self._provided = moment, provider()
        return self._provided[1]

    def _compute(self, compute: Callable[[], Any]) -> Any:
        """What follows from other data, kept until some data of the owner is written to."""
        if self._computed is None or self._computed[0] != self.owner.data_revision:
            self._computing = True
            try:
                self._computed = self.owner.data_revision, self._convert(compute())
            finally:
                self._computing = False
        return self._computed[1]
