"""Values by name that are made when somebody looks."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any


class LazyValues(Mapping[str, Any]):
    """A mapping whose names are known, and whose values are made one by one, each once."""

    def __init__(self, names: Iterable[str], make: Callable[[str], Any]):
        self._names, self._make = tuple(names), make
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """The value of a name."""
        if name not in self._names:
            raise KeyError(name)
        if name not in self._made:
            self._made[name] = self._make(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        """The names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Number of names."""
        return len(self._names)

    def __reduce__(self) -> tuple[Any, ...]:
        """Other processes get what was made: they have no renderer."""
        return dict, (dict(self._made),)
