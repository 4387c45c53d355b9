"""Nodes, components and their data: what scenes write to them, in all ways in which they do, and what they read."""

import numpy as np
import pytest
from scenes_of_sofa import declare, only_types

from taichisoft.errors import SceneError
from taichisoft_sofa.tree import value_kinds
from taichisoft_sofa.tree.component import Component, derived
from taichisoft_sofa.tree.modules import Prefab
from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.value_kinds import (
    BOOL,
    INDICES,
    SCALAR,
    TEXT,
    VECTOR,
    fixed,
    index_rows,
    kind_called,
    vectors,
)


@pytest.fixture
def root() -> Node:
    return Node("root")


def test_children_and_components_are_attributes(root: Node) -> None:
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


# Data: what scenes write to them, in all the ways in which they do, and what they read.


SPRING = {
    "stiffness": (SCALAR, 5.0),
    "drawn": BOOL,
    "method": TEXT,
    "value": VECTOR,
    "pullPoint": fixed(3),
    "points": INDICES,
    "position": vectors(3),
    "triangles": index_rows(3),
}


@pytest.fixture(autouse=True)
def known_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """A type of component whose data are known, and no others."""
    monkeypatch.setattr(value_kinds, "ALIASES", {"OldSpring": "Spring"})
    only_types(monkeypatch)
    declare("Spring", **SPRING)


@pytest.fixture
def spring() -> Component:
    return Node("root").addChild("finger").addObject("Spring", name="spring")


@pytest.mark.parametrize(
    ("name", "written", "read"),
    [
        ("stiffness", 3, 3.0),
        ("stiffness", "1e12", 1e12),
        ("stiffness", [2], 2.0),
        ("drawn", "true", True),
        ("drawn", "0", False),
        ("drawn", 1, True),
        ("method", "large", "large"),
        ("value", 0.5, [0.5]),
        ("value", "0.5 2", [0.5, 2]),
        ("value", [[1], [2, 3]], [1, 2, 3]),
        ("pullPoint", (1, 2, 3), [1, 2, 3]),
        ("points", "0 3-5 9", [0, 3, 4, 5, 9]),
        ("points", " 1 2", [1, 2]),
        ("position", "1 2 3  4 5 6", [[1, 2, 3], [4, 5, 6]]),
        ("position", [1, 2, 3], [[1, 2, 3]]),
        ("position", np.eye(3), np.eye(3)),
        ("position", [["1", "2", 3]], [[1, 2, 3]]),
        ("triangles", "0 1 2", [[0, 1, 2]]),
    ],
)
def test_what_is_written_becomes_a_value_of_the_kind(
    spring: Component, name: str, written: object, read: object
) -> None:
    setattr(spring, name, written)
    value = spring.findData(name).value
    assert type(value) is type(read) or isinstance(value, np.ndarray)
    assert np.array_equal(value, read)


@pytest.mark.parametrize(
    ("name", "written", "error"),
    [
        ("stiffness", "soft", "'soft' is not a number"),
        ("stiffness", [1, 2], "must be a single number"),
        ("drawn", "perhaps", "must be true or false"),
        ("pullPoint", [1, 2], "has 2 numbers; 3 are needed"),
        ("position", "1 2 3 4", "4 numbers are not rows of 3"),
        ("points", "1 2.5", "'2.5' is not an integer"),
    ],
)
def test_a_wrong_value_is_an_error_with_its_place(spring: Component, name: str, written: object, error: str) -> None:
    with pytest.raises(
        SceneError, match=f"test_tree_data.py, line .*data '{name}' of Spring '/finger/spring'.*{error}"
    ):
        setattr(spring, name, written)


def test_an_unwritten_data_has_its_default_or_is_empty(spring: Component) -> None:
    assert spring.stiffness.value == 5.0
    assert not spring.stiffness.isSet()
    assert spring.position.value.shape == (0, 3)
    assert spring.method.value == ""


def test_a_type_is_known_by_its_older_name_too() -> None:
    assert Node("root").addObject("OldSpring", stiffness="2").stiffness.value == 2.0


def test_data_stand_for_their_values_in_expressions(spring: Component) -> None:
    spring.stiffness, spring.value, spring.method = 4, [1.0, 2.0], "large"
    assert spring.stiffness + 1 == 5
    assert 2 / spring.stiffness == 0.5
    assert spring.stiffness > 3
    assert float(spring.stiffness) == 4
    assert np.array_equal(spring.value * 2, [2, 4])
    assert np.array_equal((1, 1) + spring.value, [2, 3])  # noqa: RUF005
    assert spring.value == [1, 2]
    assert spring.value[1] == 2
    assert list(spring.value) == [1, 2]
    assert len(spring.value) == 2
    assert "quite " + spring.method == "quite large"
    assert f"{spring.stiffness:.1f}" == "4.0"
    assert not spring.drawn


def test_a_value_is_a_copy_and_an_array_cannot_be_written_to(spring: Component) -> None:
    spring.value = [1.0, 2.0]
    spring.value.value[0] = 7
    assert spring.value.value[0] == 1
    with pytest.raises(ValueError, match="read-only"):
        spring.value.array()[0] = 7


def test_an_item_or_an_array_that_is_written_to_is_a_change(spring: Component) -> None:
    spring.position = [[1, 2, 3]]
    before = spring.position.revision
    with spring.position.writeableArray() as array:
        array[0, 1] = 9
    assert spring.position[0][1] == 9
    spring.position[0] = [4, 5, 6]
    assert spring.position.value.tolist() == [[4, 5, 6]]
    assert spring.position.revision == before + 2


def test_where_a_data_was_written_last_is_known(spring: Component) -> None:
    spring.stiffness = 1
    first = spring.stiffness.place
    spring.stiffness.value = 2
    assert first.file == spring.stiffness.place.file == __file__
    assert spring.stiffness.place.line == first.line + 2


def test_nothing_is_known_of_other_types_and_anything_goes() -> None:
    thing = Node("root").addObject("Thing", size="1 2", deep=[[1, [2]]])
    assert thing.size.value == "1 2"
    assert thing.size.array().tolist() == [1, 2]
    assert thing.deep.value == [[1, [2]]]
    assert thing.other.value is None


def test_a_name_that_the_type_does_not_have_is_an_error(spring: Component) -> None:
    with pytest.raises(AttributeError, match="Spring '/finger/spring' has no 'stifness'; did you mean 'stiffness'"):
        _ = spring.stifness
    assert spring.findData("stifness") is None


def test_data_that_nothing_reads_can_be_written_to(spring: Component) -> None:
    with pytest.raises(SceneError, match="Spring '/finger/spring' has no 'colour'; there are: "):
        _ = spring.colour.value
    spring.findData("colour").value = "red"
    assert spring.colour == "red"


def test_a_link_is_followed_when_it_is_read(spring: Component) -> None:
    finger = spring.getContext()
    other = finger.addChild("inside").addObject("Spring", position="@loader.position")
    finger.addObject("Loader", name="loader", position="1 2 3")
    assert other.position.value.tolist() == [[1, 2, 3]]
    finger.loader.position = [[4, 5, 6]]
    assert other.position.value.tolist() == [[4, 5, 6]]


@pytest.mark.parametrize(
    "path",
    ["@../finger/spring.value", "@/finger/spring.value", "@[-1].value", "@spring.value", "@spring", "@./spring.value"],
)
def test_paths_lead_to_data(spring: Component, path: str) -> None:
    spring.value = [1, 2]
    other = spring.getContext().addObject("Spring", name="other", value=path)
    assert other.value.value.tolist() == [1, 2]


def test_a_link_that_leads_nowhere_is_an_error_when_it_is_read(spring: Component) -> None:
    spring.value = "@../nowhere/roi.indices"
    with pytest.raises(SceneError, match=r"line .*data 'value' of Spring .*'@../nowhere/roi.indices' leads to no data"):
        _ = spring.value.value


@pytest.mark.parametrize("way", ["data", "path", "link path", "parent"])
def test_data_follow_data_that_they_are_given(spring: Component, way: str) -> None:
    spring.value = [1]
    other = spring.getContext().addObject("Spring", name="other")
    if way == "parent":
        other.value.setParent(spring.value)
    else:
        ways = {"data": spring.value, "path": spring.value.getLinkPath(), "link path": spring.value.linkpath}
        other.value = ways[way]
    spring.value = [2]
    assert other.value.value.tolist() == [2]
    assert other.value.hasParent()


def test_links_survive_moving_a_branch() -> None:
    prefab = Node("prefab")
    loader = prefab.addObject("Loader", name="loader", position="1 2 3")
    made = prefab.addObject("Spring", position=str(loader.position.getLinkPath()))
    assert str(loader.position.getLinkPath()) == "@/loader.position"
    Node("root").addChild("finger").addChild(prefab)
    assert made.position.value.tolist() == [[1, 2, 3]]


def test_the_component_that_a_link_leads_to(spring: Component) -> None:
    loader = spring.getContext().addObject("Loader", name="loader")
    topology = spring.getContext().addChild("inside").addObject("MeshTopology", src="@../loader", input=loader)
    assert topology.src.value == "@../loader"
    assert topology.linked("src") is loader
    assert topology.linked("input") is loader
    assert topology.linked("output") is None


def test_computed_data_are_cached(spring: Component) -> None:
    asked: list[Component] = []

    def doubled(item: Component) -> np.ndarray:
        asked.append(item)
        return 2 * item.position.given()

    declare("Spring", **SPRING | {"position": derived(vectors(3), doubled)})
    spring.position = [[1, 2, 3]]
    assert spring.position.value.tolist() == [[2, 4, 6]]
    assert spring.position.value.tolist() == [[2, 4, 6]]
    assert len(asked) == 1
    spring.stiffness = 7
    assert spring.position.value.tolist() == [[2, 4, 6]]
    assert len(asked) == 2


def test_late_writes_replace_computed_data(spring: Component) -> None:
    declare("Spring", **SPRING | {"position": derived(vectors(3), lambda item: 2 * item.position.given())})
    spring.position = [[1, 2, 3]]
    spring.initialised = True
    assert spring.position.value.tolist() == [[2, 4, 6]]
    spring.position = [[1, 2, 3]]
    assert spring.position.value.tolist() == [[1, 2, 3]]


def test_a_run_provides_values_and_takes_what_was_written(spring: Component) -> None:
    spring.value = [1]
    spring.value.take()
    spring.value.provider = lambda: np.array([10.0])
    assert spring.value[0] == 10
    spring.value = [spring.value[0] + 1]
    assert spring.value[0] == 11
    assert spring.value.take().tolist() == [11]
    assert spring.value.take() is None
    assert spring.value[0] == 10


def test_the_kinds_of_data_that_scenes_add() -> None:
    root = Node("root")
    root.addData(name="angle", type="double", value="1.5", help="", group="")
    root.addData(name="way", type="vector<Vec3d>", value=[1, 2, 3, 4, 5, 6])
    assert root.angle.value == 1.5
    assert root.way.value.shape == (2, 3)
    assert kind_called("Vec6f") is fixed(6)
    assert kind_called("vector<double>") is VECTOR
    assert kind_called("vector<int>") is INDICES


def test_a_kind_may_depend_on_the_template() -> None:
    declare("State", position=lambda item: fixed(7) if item.template == "Rigid3" else vectors(3))
    assert Node("root").addObject("State", position=range(7), template="Rigid3").position.shape == (7,)
    state = Node("root").addObject("State", position=[1, 2, 3, 0, 0, 0])
    assert state.position.shape == (2, 3)
    state.position.setParent(Node("other").addObject("Thing", position=range(7)).position)
    state.template = "Rigid3"
    assert state.position.shape == (7,)


def test_a_value_is_read_as_its_kind_is_now() -> None:
    declare("State", position=lambda item: vectors(2) if item.template == "Vec2" else vectors(3))
    state = Node("root").addObject("State", position=[1, 2, 3, 4, 5, 6])
    state.template = "Vec2"
    assert state.position.shape == (3, 2)
