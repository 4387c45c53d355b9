"""Things by name that are imported when somebody asks for one: to list the names takes no time."""

from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint
from typing import Any


class Imported(Mapping[str, Any]):
    """What a plug-in provides by name, imported on use.

    Args:
        package: the package in which the modules are.
        places: "module:name" by the name under which it is provided.
    """

    def __init__(self, package: str, places: Mapping[str, str]):
        self._package, self._places = package, places

    def __getitem__(self, name: str) -> Any:
        """Import what a name stands for."""
        return EntryPoint(name, f"{self._package}.{self._places[name]}", self._package).load()

    def __iter__(self) -> Iterator[str]:
        """The names, in their order."""
        return iter(self._places)

    def __len__(self) -> int:
        """Number of names."""
        return len(self._places)
