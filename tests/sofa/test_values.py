"""Wrong values of data: each is one line that names it, or what SOFA makes of it, and never another number.

All data of all components are tried, as `components/known_components.py` lists them.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from taichisoft.errors import SceneError
from taichisoft_sofa.components.known_components import known_types
from taichisoft_sofa.loading import SceneTree
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.component import Component, declared
from taichisoft_sofa.tree.data import Data
from taichisoft_sofa.tree.node import Node
from taichisoft_sofa.tree.value_kinds import ANY, LINK, TEXT, TEXTS, canonical, numbers

TYPES = known_types()
NAN, INFINITE = float("nan"), float("inf")
VALUES = [NAN, INFINITE, "nan", -3.0, 0, 2.5, 1e300, "", "x", [], [1, 2, 3], [NAN] * 3, ["1", 2], [[1], [2, 3]], True]
VALUES += ["true", np.array([1.0, NAN, 2.0]), 10**400, {"a": 1}, object(), b"1", 1j, "1,2", "1 2 x"]
# Three numbers and nothing where one is needed, and so on: an index of a point, a point, a cell.
VALUES += [7, [0.0, 1.0, 2.0], list(range(7)), [-1.0] * 6]
WORDS = (ANY, TEXT, TEXTS, LINK)


def data_of(type_name: str) -> list[str]:
    """The data of a type that are numbers."""
    some = Node("root").addObject(type_name)
    return [name for name in declared(type_name) if some.findData(name).kind not in WORDS]


def test_types_have_data() -> None:
    assert sum(len(data_of(name)) for name in TYPES) > 200


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_a_value_is_what_was_written_or_an_error_of_one_line(type_name: str) -> None:
    for name in data_of(type_name):
        assert not Node("root").addObject(type_name, **{name: None}).findData(name).is_set()  # SOFA's default
        for value in VALUES:
            try:
                component = Node("root").addObject(type_name, **{name: value})
            except SceneError as error:
                assert f"data '{name}' of {type_name} '" in str(error)
                assert "\n" not in str(error)
                continue
            read = component.findData(name).given()
            written = numbers(value, bools=True)
            assert np.array_equal(np.ravel(read), written), f"{name} = {value!r} became {read!r}"
            bounds = declared(type_name)[name].bounds
            assert np.isfinite(written).all() or (bounds is not None and bounds.infinite)
            assert isinstance(value, bool) == isinstance(read, bool | np.bool_) or value in (0, 1, "true") or read == []


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> SceneTree:
    """A tetrahedron with a cavity, a cable and a surface, and a frame, in the memory alone."""
    made = SceneTree(tmp_path_factory.mktemp("scene") / "scene.py", [])
    root = made.root
    for loop in ("FreeMotionAnimationLoop", "GenericConstraintSolver", "CollisionPipeline", "BruteForceBroadPhase"):
        root.addObject(loop)
    root.addObject("CollisionResponse", response="FrictionContactConstraint", responseParams="mu=0.5")
    points = [[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]]
    body = root.addChild("body")
    body.addObject("EulerImplicitSolver")
    body.addObject("MeshTopology", position=points, tetrahedra=[[0, 1, 2, 3]], triangles=[[0, 2, 1], [0, 1, 3]])
    body.addObject("MechanicalObject", position=points)
    body.addObject("UniformMass", totalMass=0.1)
    body.addObject("TetrahedronFEMForceField", youngModulus=100, poissonRatio=0.3)
    body.addObject("LinearSolverConstraintCorrection")
    frame = root.addChild("frame")
    frame.addObject("EulerImplicitSolver")
    frame.addObject("MechanicalObject", template="Rigid3")
    frame.addObject("UniformMass", totalMass=0.1)
    frame.addObject("UncoupledConstraintCorrection")
    translation = translate(made)
    assert translation.refused == []
    assert translation.departures
    return made


def numbers_in(table: Any) -> Iterator[float]:
    """All numbers in tables within tables."""
    if isinstance(table, dict | list | tuple):
        for item in table.values() if isinstance(table, dict) else table:
            yield from numbers_in(item)
    elif isinstance(table, int | float | np.number):
        yield float(table)


@pytest.mark.parametrize("type_name", sorted(TYPES))
def test_no_value_ends_a_translation_but_in_one_line(
    tree: SceneTree, type_name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the translation reads is declared: else nothing says which values of it are valid."""
    find = Component.findData

    def find_declared(self: Component, name: str) -> Data | None:
        assert self.declared_data(name), f"{self.type_name}.{name} is read, but not declared"
        return find(self, name)

    monkeypatch.setattr(Component, "findData", find_declared)
    for node in (tree.root.body, tree.root.frame):
        for name in data_of(type_name):
            for value in VALUES:
                try:
                    component = node.addObject(type_name, name="tried", **{name: value})
                except SceneError:
                    continue
                try:
                    translation = translate(tree)
                finally:
                    node.removeObject(component)
                assert all("\n" not in line for line in (*translation.refused, *translation.departures))
                assert translation.refused or np.isfinite(list(numbers_in(translation.tables))).all()


@pytest.mark.parametrize(
    ("type_name", "values", "line"),
    [
        ("RestShapeSpringsForceField", {"stiffness": NAN}, "nan must be 0 or more"),
        ("RestShapeSpringsForceField", {"stiffness": -1.0}, "-1 must be 0 or more"),
        ("TetrahedronFEMForceField", {"poissonRatio": NAN}, "nan must be between -1 and 0.5"),
        ("TetrahedronFEMForceField", {"poissonRatio": 0.5}, "0.5 must be between -1 and 0.5"),
        ("TetrahedronFEMForceField", {"youngModulus": -5}, "-5 must be 0 or more"),
        ("TetrahedronFEMForceField", {"youngModulus": []}, "youngModulus has 0 numbers for 1 tetrahedra"),
        ("UniformMass", {"totalMass": [1, 2, 3]}, "must be a single number"),
        ("UniformMass", {"totalMass": 0}, "totalMass = 0; a body needs a mass above 0"),
        ("UniformMass", {"vertexMass": -1}, "vertexMass = -1 must be above 0"),
        ("UniformMass", {"vertexMass": -1, "totalMass": 1}, "vertexMass = -1 must be above 0"),
        ("MeshMatrixMass", {"massDensity": [1.0, 2.0]}, "massDensity has 2 numbers; a body has one density here"),
        ("EulerImplicitSolver", {"rayleighStiffness": -0.1}, "-0.1 must be 0 or more"),
        ("CableConstraint", {"indices": [-1]}, "-1 must be 0 or more"),
        ("CableConstraint", {"indices": [1.5]}, "1.5 is not an integer"),
        ("SurfacePressureConstraint", {"value": INFINITE}, "inf must be a finite number"),
        ("SurfacePressureConstraint", {"triangles": [0, 1, 9]}, "names point 9; its points are 0 to 3"),
        ("MeshTopology", {"tetrahedra": [0, 1, 2, 9]}, "names point 9; its points are 0 to 3"),
        ("CollisionResponse", {"response": "FrictionContact?mu=nan"}, "mu must be 0 or more"),
        ("CollisionResponse", {"response": "FrictionContact", "responseParams": "mu=-0.2"}, "mu must be 0 or more"),
        ("MechanicalObject", {"velocity": [[1, 0, 0], [0, 0, 0]]}, "velocity has 2 rows"),
        ("MechanicalObject", {"template": "Vec1"}, "template 'Vec1'; known are Vec3 and Rigid3"),
    ],
)
def test_a_wrong_value_says_what_would_be_valid(
    tree: SceneTree, type_name: str, values: dict[str, Any], line: str
) -> None:
    node = tree.root.body
    before = next((item for item in node.objects if canonical(item.type_name) == canonical(type_name)), None)
    if before is not None:
        node.removeObject(before)
    added = []
    try:
        if type_name == "MechanicalObject":
            values = {"position": before.position.value, **values} if "velocity" in values else values
        if type_name == "MeshTopology":
            values = {"position": before.position.value, **values}
        added.append(node.addObject(type_name, **values))
        refused = translate(tree).refused
    except SceneError as error:
        refused = [str(error)]
    finally:
        for component in added:
            node.removeObject(component)
        if before is not None:
            node.addObject(before)
    assert any(line in one for one in refused), refused


@pytest.mark.parametrize("dt", [0, -0.01, NAN, INFINITE, [0.1, 0.2], "x"])
def test_a_time_step_is_above_0(dt: object) -> None:
    with pytest.raises(SceneError, match="data 'dt' of node 'root': "):
        Node("root").dt = dt


@pytest.mark.parametrize(("stiffness", "made"), [([], [100.0]), ([5.0, 2.0], [5.0]), ([3, 2, 2, 3], [2.0, 3.0])])
def test_springs_take_first_stiffness(tree: SceneTree, stiffness: list[float], made: list[float]) -> None:
    """SOFA: 100 without any, the first one of a list of another length than that of the points."""
    springs = tree.root.body.addObject("RestShapeSpringsForceField", stiffness=stiffness)
    try:
        anchors = translate(tree).tables["soft_bodies"]["body"]["anchors"]
    finally:
        tree.root.body.removeObject(springs)
    assert [anchor["stiffness"] for anchor in anchors] == made


@pytest.mark.parametrize(
    ("type_name", "values", "line"),
    [
        ("EulerImplicitSolver", {"vdamping": 3}, "vdamping = 3 has no effect here"),
        ("TetrahedronFEMForceField", {"rayleighStiffness": 0.1}, "rayleighStiffness = 0.1 has no effect here"),
        ("TetrahedronFEMForceField", {"localStiffnessFactor": [2]}, "localStiffnessFactor = [2] has no effect here"),
        ("BarycentricMapping", {"mapForces": False}, "mapForces = False has no effect here"),
        ("RigidMapping", {"repartition": [0, 4]}, "repartition = [0, 4] has no effect here"),
        ("SpringForceField", {"rayleighStiffness": 0.1}, "rayleighStiffness = 0.1 has no effect here"),
        ("UniformMass", {"rayleighMass": 0.1}, "rayleighMass = 0.1 has no effect here"),
        ("RestShapeSpringsForceField", {"activeDirections": "1 0 0"}, "activeDirections = 1 0 0 has no effect here"),
        ("MechanicalObject", {"externalForce": [[0, 1, 0]]}, "externalForce = [[0, 1, 0]] has no effect here"),
        ("MeshVTKLoader", {"transformation": "1 0"}, "transformation = 1 0 has no effect here"),
        ("TetrahedronFEMForceField", {"youngModul": 3}, "did you mean 'youngModulus'?"),
        ("SparseLDLSolver", {"templat": 3}, "did you mean 'template'?"),
    ],
)
def test_what_is_given_in_vain_is_listed(tree: SceneTree, type_name: str, values: dict[str, Any], line: str) -> None:
    component = tree.root.body.addObject(type_name, **values)
    try:
        departures = translate(tree).departures
    finally:
        tree.root.body.removeObject(component)
    assert any(line in one and f"/{component.getName()}'" in one for one in departures), departures


@pytest.mark.parametrize(("type_name", "name"), [("TetrahedronFEMForceField", "bogus"), ("BVHNarrowPhase", "xyz")])
def test_other_data_are_listed_by_type(tree: SceneTree, type_name: str, name: str) -> None:
    component = tree.root.body.addObject(type_name, **{name: 3})
    try:
        assert translate(tree).not_read == {type_name: {name: None}}
    finally:
        tree.root.body.removeObject(component)


@pytest.mark.parametrize(
    ("type_name", "values"),
    [("EulerImplicitSolver", {"vdamping": 0}), ("MechanicalObject", {"externalForce": np.zeros((4, 3))})],
)
def test_sofas_defaults_are_not_listed(tree: SceneTree, type_name: str, values: dict[str, Any]) -> None:
    component = tree.root.body.addObject(type_name, **values)
    try:
        assert not any("no effect" in line for line in translate(tree).departures)
    finally:
        tree.root.body.removeObject(component)


def test_bodies_begin_with_the_velocity_of_their_scene(tree: SceneTree) -> None:
    soft, rigid = tree.root.body.MechanicalObject, tree.root.frame.MechanicalObject
    soft.velocity, rigid.velocity = [[1, 2, 3]] * 4, [1, 2, 3, 0.1, 0.2, 0.3]
    try:
        tables = translate(tree).tables
    finally:
        soft.velocity.unset()
        rigid.velocity.unset()
    assert tables["soft_bodies"]["body"]["velocity"] == [1.0, 2.0, 3.0]
    assert tables["rigid_bodies"]["frame"]["velocity"] == [1.0, 2.0, 3.0]
    assert tables["rigid_bodies"]["frame"]["angular_velocity"] == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("response", ["", "PenalityContactForceField", "FrictionlessContact"])
def test_a_response_without_friction_has_none(tree: SceneTree, response: str) -> None:
    component = tree.root.addObject("CollisionResponse", **({"response": response} if response else {}))
    try:
        translation = translate(tree)
    finally:
        tree.root.removeObject(component)
    assert translation.tables["contact"]["friction"] == 0.0
    assert any("touch without friction" in line for line in translation.departures)


@pytest.mark.parametrize(("box", "found"), [([-1, -1, -1, 1, 1, 1], [0]), ([1, 1, 1, 2, 2, 2], [])])
def test_a_box_selects_frames_by_their_origins(tree: SceneTree, box: list[float], found: list[int]) -> None:
    roi = tree.root.frame.addObject("BoxROI", box=box)
    try:
        assert roi.indices.value.tolist() == found
        assert translate(tree).refused == []
    finally:
        tree.root.frame.removeObject(roi)
