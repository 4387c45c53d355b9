"""What translations read: values of data of a component, and the components to which it is related in the tree."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.value_kinds import canonical
from taichisoft_sofa.tree.value_kinds import numbers as parse_numbers

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.node import Node


def computed(component: "Component | None", name: str, width: int) -> np.ndarray:
    """Rows of `width` numbers, written by the scene or computed; no rows without a component that has such data."""
    data = None if component is None else component.findData(name)
    value = None if data is None or not (data.is_declared() or data.is_set()) else data.read_value()
    dtype = np.float64 if name in ("position", "rest_position") else np.int64
    if value is None:
        return np.zeros((0, width), dtype=dtype)
    return parse_numbers(value).reshape(-1, width).astype(dtype)


def described(component: "Component") -> str:
    """Type, path and line of a component, for error messages."""
    return f"{component.described()} ({component.place})"


STATE = "MechanicalObject"
MAPPINGS = {
    "BarycentricMapping",
    "RigidMapping",
    "IdentityMapping",
    "SubsetMapping",
    "SkinningMapping",
    "BarycentricMappingRigid",
    "RigidRigidMapping",
    "SubsetMultiMapping",
    "ArticulatedSystemMapping",
    "DeformableOnRigidFrameMapping",
}
ASSEMBLING = {"SubsetMultiMapping", "ArticulatedSystemMapping"}
"""Mappings from several mechanical objects."""
TOPOLOGIES = {
    "RegularGridTopology",
    "SparseGridTopology",
    "MeshTopology",
    "TetrahedronSetTopologyContainer",
    "TriangleSetTopologyContainer",
    "QuadSetTopologyContainer",
    "HexahedronSetTopologyContainer",
    "EdgeSetTopologyContainer",
    "PointSetTopologyContainer",
}
LOADERS = {"MeshVTKLoader", "MeshSTLLoader", "MeshOBJLoader", "MeshGmshLoader", "GIDMeshLoader"}


def node_of(component: "Component") -> "Node":
    """The node of a component."""
    node = component.getContext()
    if node is None:
        raise SceneError(f"{described(component)} is in no node")
    return node


def in_node(node: "Node", types: set[str]) -> "Component | None":
    """The first component of one of these types in a node."""
    return next((component for component in node.objects if canonical(component.type_name) in types), None)


def upwards(node: "Node") -> "Iterator[Node]":
    """A node and its ancestors, each once: along the first parent of each, then along the others, as in SOFA."""
    seen: set[int] = set()
    waiting = [node]
    while waiting:
        above = waiting.pop()
        if id(above) not in seen:
            seen.add(id(above))
            yield above
            waiting.extend(reversed(above.parents))


def nearest(
    node: "Node", types: set[str], fits: "Callable[[Component], bool]" = lambda component: True
) -> "Component | None":
    """The first component of one of these types that fits, in a node or else in its ancestors, or None."""
    for above in upwards(node):
        for component in above.objects:
            if canonical(component.type_name) in types and fits(component):
                return component
    return None


def topology_of(
    component: "Component", link: str = "topology", fits: "Callable[[Component], bool]" = lambda topology: True
) -> "Component | None":
    """The topology to which a data links, else the nearest one that fits, or None."""
    linked: Component | None = component.linked(link)
    return linked if component.read_text(link) else nearest(node_of(component), TOPOLOGIES, fits)


def mesh_of(component: "Component") -> "Component | None":
    """The component to which `src` links, else the topology or the loader in the node, or None."""
    if component.read_text("src"):
        linked: Component | None = component.linked("src")
        return linked
    return in_node(node_of(component), TOPOLOGIES) or in_node(node_of(component), LOADERS)


def mapping_of(state: "Component") -> "Component | None":
    """The mapping by which a mechanical object follows others, or None."""
    for component in node_of(state).objects:
        if canonical(component.type_name) in MAPPINGS:
            output = component.linked("output") if component.findData("output") is not None else None
            if output is None or not hasattr(output, "type_name") or canonical(output.type_name) in (STATE, "Node"):
                return component  # else it moves a visual model alone
    return None


def inputs_of(mapping: "Component") -> "list[Component]":
    """The mechanical objects that a mapping's output follows: linked ones, else the nearest one above its node."""
    names = [name for name in ("input1", "input", "object1") if (data := mapping.findData(name)) and data.is_set()]
    if not names:
        above = (nearest(parent, {STATE}) for parent in node_of(mapping).parents)
        return [state for state in above if state is not None][:1]
    return [linked_state(mapping, *link) for link in mapping.linked_all(names[0])]


def linked_state(mapping: "Component", path: str, target: Any) -> "Component":
    """The mechanical object to which a link of a mapping leads, itself or by its node."""
    kind = getattr(target, "type_name", "")
    state = in_node(target, {STATE}) if kind == "Node" else target if canonical(kind) == STATE else None
    if state is None:
        raise mapping.refused(f"'{path}' leads to no MechanicalObject")
    found: Component = state
    return found


def is_assembled(state: "Component") -> bool:
    """Whether a mechanical object is put together from several others: by joints, or from points and frames of them."""
    mapping = mapping_of(state)
    return mapping is not None and canonical(mapping.type_name) in ASSEMBLING


def independent_state(node: "Node") -> "Component | None":
    """The mechanical object on which everything in a node depends: an independent or assembled one, or None."""
    state, passed = nearest(node, {STATE}), set[int]()
    while state is not None and id(state) not in passed and not is_assembled(state):
        passed.add(id(state))
        mapping = mapping_of(state)
        if mapping is None:
            return state
        state = next(iter(inputs_of(mapping)), None)
    return state


def present_value(actuator: "Component") -> float:
    """The present value of an actuator."""
    values, index = actuator.read_numbers("value"), int(actuator.read_number("valueIndex"))
    if index >= len(values):
        raise actuator.refused(f"value has {len(values)} numbers; number {index} is needed")
    return float(values[index])
