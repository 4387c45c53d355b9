"""Data: what scenes write to them, in all the ways in which they do, and what they read."""

import numpy as np
import pytest
from scenes_of_sofa import declare, only_types

from taichisoft.errors import SceneError
from taichisoft_sofa.tree import value_kinds
from taichisoft_sofa.tree.component import Component, derived
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


def test_a_path_that_was_good_where_a_branch_was_made_stays_good_elsewhere() -> None:
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


def test_what_follows_from_other_data_is_computed_once_until_they_change(spring: Component) -> None:
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


def test_what_is_written_once_the_scene_is_complete_is_not_computed_any_more(spring: Component) -> None:
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
