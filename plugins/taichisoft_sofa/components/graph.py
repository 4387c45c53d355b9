"""Relations of components in the tree: the object on which a component acts, and its topology."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from taichisoft.errors import SceneError
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.node import Node

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
    "DeformableOnRigidFrameMapping",
}
TOPOLOGIES = {
    "MeshTopology",
    "TetrahedronSetTopologyContainer",
    "TriangleSetTopologyContainer",
    "QuadSetTopologyContainer",
    "HexahedronSetTopologyContainer",
    "EdgeSetTopologyContainer",
    "PointSetTopologyContainer",
}
LOADERS = {"MeshVTKLoader", "MeshSTLLoader", "MeshOBJLoader", "MeshGmshLoader"}


def node_of(component: "Component") -> "Node":
    """The node of a component.

    Raises:
        SceneError: the component is in no node.
    """
    node = component.getContext()
    if node is None:
        raise SceneError(f"{component.describe()} ({component.place}) is in no node")
    return node


def in_node(node: "Node", types: set[str]) -> "Component | None":
    """The first component of one of these types in a node."""
    return next((component for component in node.objects if canonical(component.type_name) in types), None)


def upwards(node: "Node") -> "Iterator[Node]":
    """A node and its ancestors, along the first parent of each."""
    here: Node | None = node
    while here is not None:
        yield here
        parents = list(here.parents)
        here = parents[0] if parents else None


def nearest(
    node: "Node", types: set[str], fits: "Callable[[Component], bool]" = lambda component: True
) -> "Component | None":
    """The first component of one of these types that fits, in a node or else in its ancestors, or None."""
    for above in upwards(node):
        for component in above.objects:
            if canonical(component.type_name) in types and fits(component):
                return component
    return None


def mapping_of(state: "Component") -> "Component | None":
    """The mapping by which a mechanical object follows another, or None."""
    return in_node(node_of(state), MAPPINGS)


def independent_state(node: "Node") -> "Component | None":
    """The independent mechanical object on which everything in a node depends, or None."""
    for above in upwards(node):
        state = in_node(above, {STATE})
        if state is not None and mapping_of(state) is None:
            return state
    return None
