"""Prefabs: nodes built from parameters, defined by scenes and SOFA's libraries."""

from typing import Any

from taichisoft_sofa.tree.node import Node


class RawPrefab(Node):
    """A node of a class defined by a scene."""

    def __init__(self, *_arguments: Any, **named: Any) -> None:
        self.type_name = "Node"
        known = {name: value for name, value in named.items() if self.declared_data(name) is not None}
        self.set_all({"name": "unnamed", **known})

    def addPrefabParameter(
        self,
        name: str,
        help: str = "",
        type: str = "",
        default: Any = None,
    ) -> None:
        """Add a parameter of the prefab as a data."""
        self.addData(name, default, type=type)


class Prefab(RawPrefab):
    """A node whose content is made by its method `init`, from the parameters listed in its class."""

    prefabParameters: list[dict[str, Any]] = []  # noqa: RUF012
    prefabData: list[dict[str, Any]] = []  # noqa: RUF012
    properties: list[dict[str, Any]] = []  # noqa: RUF012

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **{"name": type(self).__name__, **named})
        self.addData("prefabname", type(self).__name__, type="string")
        for parent in named.get("parents", [named["parent"]] if "parent" in named else []):
            parent.addChild(self)
        for listed in (*self.prefabParameters, *self.prefabData, *self.properties):
            name = listed["name"]
            self.addData(name, named.get(name, listed.get("default")), type=listed.get("type", ""))
        self.init()
