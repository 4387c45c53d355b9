"""The tree itself: nodes, components, their names and paths."""

import pytest

from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.modules import Prefab
from taichisoft_sofa.tree.node import Node


@pytest.fixture
def root() -> Node:
    return Node("root")


def test_children_components_and_data_are_attributes_by_their_names(root: Node) -> None:
    finger = root.addChild("finger")
    loader = finger.addObject("MeshVTKLoader", name="loader", filename="finger.vtk")
    assert root.finger is finger
    assert root.finger.loader is loader
    assert root.finger.loader.filename.value == "finger.vtk"
    assert root["finger.loader.filename"].value == "finger.vtk"


def test_a_component_without_a_name_has_that_of_its_type(root: Node) -> None:
    first, second = root.addObject("BoxROI"), root.addObject("BoxROI")
    assert root.BoxROI is first
    assert root.BoxROI1 is second
    assert second.getClassName() == "BoxROI"
    first.name = "box"
    assert root.box is first


def test_the_older_generation_builds_the_same(root: Node) -> None:
    loader = root.createChild("finger").createObject("MeshVTKLoader", name="loader")
    assert root.getChild("finger").getObject("loader") is loader
    assert root.getChild("thumb") is None
    assert root.getObject("thumb") is None


def test_components_are_found_by_paths(root: Node) -> None:
    loader = root.addChild("finger").addChild("cavity").addObject("MeshSTLLoader", name="loader")
    assert root.getObject("finger/cavity/loader") is loader
    assert root.finger.getObject("/finger/cavity/loader") is loader
    assert root.getChild("finger/cavity") is root.finger.cavity
    assert loader.getPathName() == "/finger/cavity/loader"
    assert loader.getLinkPath() == "@/finger/cavity/loader"
    assert loader.position.getLinkPath() == "@/finger/cavity/loader.position"
    assert root.getPathName() == "/"
    assert root.finger.getRoot() is root.finger.root is root


def test_what_is_not_there_is_an_error_that_names_what_is_near(root: Node) -> None:
    root.addChild("finger")
    with pytest.raises(AttributeError, match="node 'root' has no 'fingr'; did you mean 'finger'"):
        _ = root.fingr
    with pytest.raises(AttributeError, match="has no method 'grow' here"):
        root.addObject("Thing").grow(3)


def test_members_are_listed_in_order_and_by_name(root: Node) -> None:
    for name in ("one", "two"):
        root.addChild(name)
        root.addObject("Thing", name=name)
    assert [child.getName() for child in root.children] == ["one", "two"]
    assert "two" in root.objects
    assert "three" not in root.objects
    assert root.objects["two"] is root.objects.at(1)
    assert root.hasObject("one")


def test_nodes_and_components_go_away(root: Node) -> None:
    thing = root.addObject("Thing")
    child = root.addChild("child")
    root.removeObject(thing)
    root.removeChild("child")
    assert not root.objects
    assert not root.children
    assert not child.parents
    with pytest.raises(ValueError, match="has no child 'child'"):
        root.removeChild("child")


def test_a_node_may_have_two_parents_and_is_met_once(root: Node) -> None:
    shared = root.addChild("one").addChild("shared")
    root.addChild("two").addChild(shared)
    root.one.addChild(shared)
    assert [node.getName() for node in root.walk()] == ["root", "one", "shared", "two"]
    assert len(shared.parents) == 2
    assert len(root.one.children) == 1
    with pytest.raises(ValueError, match="above it already"):
        shared.addChild(root)


def test_a_node_moves(root: Node) -> None:
    child = root.addChild("one").addChild("child")
    root.addChild("two").moveChild(child)
    assert child.getPathName() == "/two/child"
    assert not root.one.children


def test_the_data_of_a_node(root: Node) -> None:
    assert root.gravity.value.tolist() == [0, -9.81, 0]
    root.gravity = "0 -9810 0"
    root.dt.value = 0.02
    assert root.findData("gravity").value.tolist() == [0, -9810, 0]
    assert root.getDt() == 0.02
    assert root.findData("weight") is None


def test_other_attributes_are_remembered_for_the_scene(root: Node) -> None:
    root.helper = print
    finger = root.addChild("finger")
    root.finger_again = finger
    assert root.helper is print
    assert root.finger_again is finger
    assert "helper" not in root.data_by_name


def test_a_value_that_is_assigned_to_a_component_is_data(root: Node) -> None:
    solver = root.addObject("EulerImplicitSolver")
    solver.rayleighMass = 0.1
    assert solver.findData("rayleighMass").value == 0.1


def test_the_mechanical_state_of_a_node(root: Node) -> None:
    root.addObject("EulerImplicitSolver")
    assert root.getMechanicalState() is None
    state = root.addObject("MechanicalObject", name="tetras")
    assert root.getMechanicalState() is state


def test_a_component_remembers_that_it_must_see_to_changes(root: Node) -> None:
    field = root.addObject("TetrahedronFEMForceField")
    assert not field.reinit_requested
    field.reinit()
    assert field.reinit_requested


class Finger(Prefab):
    """A prefab as scenes define them."""

    prefabParameters = [  # noqa: RUF012
        {"name": "size", "type": "Vec3d", "help": "", "default": [1, 1, 1]},
        {"name": "mesh", "type": "string", "help": "", "default": ""},
    ]

    def init(self) -> None:
        self.loader = self.addObject("MeshVTKLoader", name="loader", filename=self.mesh.value)
        self.box = self.addObject("NewROI", name="roi", box=self.size)


def test_a_prefab_fills_itself_from_its_parameters(root: Node) -> None:
    finger = Finger(mesh="finger.vtk", size=[1, 2, 3])
    assert root.addChild(finger) is finger
    assert root.Finger.loader.filename.value == "finger.vtk"
    assert root.Finger.roi.box.value.tolist() == [1, 2, 3]
    finger.size = "4 5 6"
    assert finger.roi.box.value.tolist() == [4, 5, 6]
    assert finger.prefabname == "Finger"


def test_a_prefab_may_be_given_its_parent(root: Node) -> None:
    Finger(name="thumb", parent=root)
    assert root.thumb.loader.getPathName() == "/thumb/loader"


def test_a_component_that_was_added_nowhere_has_no_links() -> None:
    thing = Component("Thing")
    thing.value = "@loader.position"
    assert thing.value.hasParent()
    assert thing.getPathName() == "/Thing"
