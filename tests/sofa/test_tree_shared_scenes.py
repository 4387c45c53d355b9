"""Public scenes of SOFA's plug-ins are loaded unmodified, and their controllers act on what they built."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scenes_of_sofa import declare, only_types

from taichisoft_sofa.loading import SceneTree, load_tree
from taichisoft_sofa.tree.value_kinds import TEXT, VECTOR, fixed, vectors

NODES = 5
# A scene: how many nodes and components it builds, how many bodies have a field of elasticity, and its controllers.
SCENES = {
    "cable-gripper/cablegripper.py": (33, 158, 3, 4),
    "cable-gripper/finger.py": (10, 51, 1, 1),
    "cable-gripper/gripper.py": (27, 130, 3, 4),
    "cable-gripper/step0.py": (33, 159, 3, 4),
    "cable-gripper/step1.py": (7, 29, 0, 0),
    "cable-gripper/step2.2.py": (6, 19, 1, 0),
    "cable-gripper/step2.py": (4, 13, 1, 0),
    "cable-gripper/step3.py": (7, 25, 1, 1),
    "cable-gripper/step4.py": (10, 51, 1, 1),
    "cable-gripper/step5.py": (27, 130, 3, 4),
    "cable-gripper/step6.py": (33, 159, 3, 4),
    "pneunet-appendix/gripper.py": (20, 120, 6, 1),
    "pneunet-python2/step1-meshLoading.pyscn": (2, 4, 0, 0),
    "pneunet-python2/step2-forceFieldAndMass.pyscn": (2, 7, 1, 0),
    "pneunet-python2/step3-stiffLayer.pyscn": (3, 10, 2, 0),
    "pneunet-python2/step4-boundaryConditions.pyscn": (3, 12, 2, 0),
    "pneunet-python2/step5-timeIntegrationAndMatrixSolver.pyscn": (3, 15, 2, 0),
    "pneunet-python2/step6-pneumaticActuatorAndPythonScriptController.pyscn": (4, 25, 2, 1),
    "pneunet-python2/step7-grabTheCube.pyscn": (20, 121, 6, 1),
    "pneunet-python2/step7-withSTLIB.py": (20, 122, 3, 1),
    "pneunet-steps/step1-meshLoading.py": (2, 8, 0, 0),
    "pneunet-steps/step2-forceFieldAndMass.py": (2, 14, 1, 0),
    "pneunet-steps/step3-stiffLayer.py": (3, 18, 2, 0),
    "pneunet-steps/step4-boundaryConditions.py": (3, 21, 2, 0),
    "pneunet-steps/step5-timeIntegrationAndMatrixSolver.py": (3, 27, 2, 0),
    "pneunet-steps/step6-pneumaticActuatorAndPythonScriptController.py": (4, 39, 2, 1),
    "pneunet-steps/step7-grabTheCube.py": (20, 137, 6, 1),
    "pneunet-steps/step7-withSTLIB.py": (20, 140, 3, 1),
    "soft-gripper/SoftGripper.pyscn": (10, 61, 3, 1),
    "soft-gripper/SoftGripperGrasping.pyscn": (18, 105, 3, 1),
}


@pytest.fixture
def scenes(shared: Path) -> Path:
    folder = shared / "sofa-scenes"
    if not folder.is_dir():
        pytest.skip("needs ../shared/sofa-scenes, which is not part of the project")
    return folder


@pytest.fixture(autouse=True)
def known_types(monkeypatch: pytest.MonkeyPatch) -> None:
    """The data that the controllers of these scenes use; a body has five nodes here, since no mesh is read."""
    only_types(monkeypatch)
    declare("CableConstraint", value=(VECTOR, [0.0]), pullPoint=fixed(3))
    declare("SurfacePressureConstraint", value=(VECTOR, [0.0]), triangles=TEXT)
    declare(
        "MechanicalObject",
        template=TEXT,
        position=lambda state: fixed(7) if state.template == "Rigid3" else vectors(3),
        rest_position=(vectors(3), np.arange(3.0 * NODES).reshape(-1, 3)),
    )


def load(scenes: Path, name: str) -> SceneTree:
    tree = load_tree(scenes / name, [scenes / "python"])
    tree.initialise()
    return tree


def of_type(tree: SceneTree, *types: str) -> list[object]:
    return [component for component in tree.components() if component.type_name in types]


@pytest.mark.parametrize("name", SCENES)
def test_shared_scenes_load_completely(scenes: Path, name: str) -> None:
    tree = load(scenes, name)
    fields = of_type(tree, "TetrahedronFEMForceField")
    found = len(list(tree.nodes())), len(list(tree.components())), len(fields), len(tree.controllers)
    assert found == SCENES[name]
    for component in tree.components():
        assert component.place is not None
        assert Path(component.place.file).is_relative_to(scenes / name.partition("/")[0])
        for data in component.data_by_name.values():
            if not data.hasParent():
                data.read_value()


def test_all_scenes_are_loaded(scenes: Path) -> None:
    folders = ("cable-gripper", "pneunet-appendix", "pneunet-python2", "pneunet-steps", "soft-gripper")
    files = (file for folder in folders for file in (scenes / folder).glob("*.py*"))
    with_scene = {str(file.relative_to(scenes)) for file in files if b"def createScene" in file.read_bytes()}
    assert with_scene - {"cable-gripper/grippercontroller.py"} == set(SCENES)


def test_the_cable_gripper_is_as_its_library_builds_it(scenes: Path) -> None:
    tree = load(scenes, "cable-gripper/step6.py")
    assert tree.root.gravity.value.tolist() == [0, -981, 0]
    assert tree.root.LocalMinDistance.contactDistance.value == 3
    finger = tree.root.Gripper.Finger2.ElasticMaterialObject
    assert finger.loader.rotation.value == [180, 0, 65]
    assert finger.container.position.getParent() is finger.loader.position
    assert finger.FixedBox.RestShapeSpringsForceField.points.getParent() is finger.FixedBox.BoxROI.indices
    assert finger.PullingCable.CableConstraint.pullPoint.value.tolist() == [3, 10.5, -7]
    assert len(finger.PullingCable.MechanicalObject.position) == 14
    assert finger.CollisionMesh.TriangleCollisionModel.group.value == [1, 2]
    types = Counter(component.type_name for component in tree.components())
    assert (types["CableConstraint"], types["UncoupledConstraintCorrection"], types["CGLinearSolver"]) == (3, 1, 1)


def test_links_of_the_tutorials_lead_to_the_first_finger(scenes: Path) -> None:
    for name in ("pneunet-appendix/gripper.py", "pneunet-python2/step7-grabTheCube.pyscn"):
        root = load(scenes, name).root
        springs = root.finger3.RestShapeSpringsForceField
        assert springs.points.getParent() is root.finger1.boxROI.indices
        assert root.finger3.modelSubTopo.container.tetrahedra.getParent() is root.finger1.boxROISubTopo.tetrahedraInROI
        assert root.finger3.modelSubTopo.container.position.getParent() is root.finger3.loader.position


@pytest.mark.parametrize(
    ("name", "body", "actuator", "plus", "up"),
    [
        ("pneunet-appendix/gripper.py", "finger2", "cavity.SurfacePressureConstraint", 0.01, [3, 0, 0]),
        ("pneunet-python2/step7-grabTheCube.pyscn", "finger2", "cavity.SurfacePressureConstraint", 0.01, [3, 0, 0]),
        ("pneunet-python2/step7-withSTLIB.py", "finger2", "cavity.SurfacePressureConstraint", 0.01, [0, 3, 0]),
        ("pneunet-steps/step7-grabTheCube.py", "Finger2", "Cavity.SurfacePressureConstraint", 0.01, [3, 0, 0]),
        ("pneunet-steps/step7-withSTLIB.py", "Finger2", "Cavity.SurfacePressureConstraint", 0.01, [3, 0, 0]),
        ("soft-gripper/SoftGripperGrasping.pyscn", "finger2", "effector2.cc2", 10.0, [10, 0, 0]),
        ("soft-gripper/SoftGripper.pyscn", "finger2", "actuator2.CableConstraint", 1.0, [0, 0, 0]),
        (
            "cable-gripper/step6.py",
            "Gripper.Finger2.ElasticMaterialObject",
            "PullingCable.CableConstraint",
            1.0,
            [0, 1, 0],
        ),
    ],
)
def test_keys_act_through_the_scenes_own_controllers(
    scenes: Path, name: str, body: str, actuator: str, plus: float, up: list[float]
) -> None:
    tree = load(scenes, name)
    finger = tree.root[body]
    value, state = finger[actuator].value, finger.getMechanicalState()
    before, rest = value.value[0], state.rest_position.value
    tree.key_pressed("+")
    tree.key_pressed("uparrow")
    assert value.value[0] == pytest.approx(before + plus, rel=1e-12)
    moved = state.rest_position.value - rest
    assert np.allclose(moved, up, atol=1e-9)
    assert Path(value.place.file).is_relative_to(scenes / name.partition("/")[0])


def test_a_pull_point_follows_the_gripper(scenes: Path) -> None:
    tree = load(scenes, "soft-gripper/SoftGripperGrasping.pyscn")
    point = tree.root.finger1.effector1.cc1.pullPoint
    before = point.value
    tree.key_pressed("up")
    assert (point.value - before).tolist() == [10, 0, 0]
