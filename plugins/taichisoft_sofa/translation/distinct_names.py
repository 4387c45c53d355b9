"""Names of bodies, cavities and cables: the shortest distinct names of their nodes."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from taichisoft_sofa.components.graph import node_of, upwards

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.node import Node


def body_names(nodes: "Sequence[Node]") -> list[str]:
    """Name the body of each node: by the node, or by an ancestor if bodies share the node's name.

    Three nodes "ElasticMaterialObject" below "Finger1", "Finger2" and "Finger3" are named "Finger1", and so on.
    """
    paths = [[clean(above.getName()) for above in upwards(node)] for node in nodes]
    names = [path[0] for path in paths]
    for name, count in Counter(names).items():
        if count > 1:
            same = [index for index, other in enumerate(names) if other == name]
            for index, better in zip(same, _distinct_names([paths[index] for index in same]), strict=True):
                names[index] = better
    return unique(names)


def _distinct_names(paths: list[list[str]]) -> list[str]:
    """Names at the lowest level at which all paths differ, else the whole paths."""
    for level in range(1, min(map(len, paths))):
        names = [path[level] for path in paths]
        if len(set(names)) == len(names):
            return names
    return ["-".join(reversed(path)) for path in paths]


def actuator_names(components: "Sequence[Component]") -> list[str]:
    """Name each actuator of a body: by its node, or by its own name if several share a node."""
    nodes = [node_of(component) for component in components]
    sharing = Counter(map(id, nodes))
    return [
        clean((component if sharing[id(node)] > 1 else node).getName())
        for component, node in zip(components, nodes, strict=True)
    ]


def unique(names: list[str]) -> list[str]:
    """Make names unique by numbers."""
    taken: set[str] = set()
    numbers: dict[str, int] = {}
    found = []
    for name in names:
        free = name
        while free in taken:
            numbers[name] = numbers.get(name, 1) + 1
            free = f"{name}{numbers[name]}"
        taken.add(free)
        found.append(free)
    return found


def clean(name: str) -> str:
    """Replace the characters that join names in a native scene."""
    return name.translate(str.maketrans("./|", "___")) or "unnamed"
