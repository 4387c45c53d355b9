"""Names of bodies, cavities and cables: their nodes' names, as short as they can be told apart."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from taichisoft_sofa.components.graph import node_of, upwards

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.node import Node


def body_names(nodes: "Sequence[Node]") -> list[str]:
    """A name for the body of each node: the node's own, else that of a node above, where bodies share theirs.

    Three nodes called "ElasticMaterialObject" below "Finger1", "Finger2" and "Finger3" get the names of these.
    """
    paths = [[clean(above.getName()) for above in upwards(node)] for node in nodes]
    names = [path[0] for path in paths]
    for name, count in Counter(names).items():
        if count > 1:
            same = [index for index, other in enumerate(names) if other == name]
            for index, better in zip(same, _told_apart([paths[index] for index in same]), strict=True):
                names[index] = better
    return unique(names)


def _told_apart(paths: list[list[str]]) -> list[str]:
    """The names at the lowest level above on which the paths all differ, else the whole paths."""
    for level in range(1, min(map(len, paths))):
        names = [path[level] for path in paths]
        if len(set(names)) == len(names):
            return names
    return ["-".join(reversed(path)) for path in paths]


def actuator_names(components: "Sequence[Component]") -> list[str]:
    """A name for each actuator of a body: that of its node, or its own where several share a node."""
    nodes = [node_of(component) for component in components]
    sharing = Counter(map(id, nodes))
    return [
        clean((component if sharing[id(node)] > 1 else node).getName())
        for component, node in zip(components, nodes, strict=True)
    ]


def unique(names: list[str]) -> list[str]:
    """The names, of which those that stand there twice get a number."""
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
    """A name without the signs that join names in a native scene."""
    return name.translate(str.maketrans("./|", "___")) or "unnamed"
