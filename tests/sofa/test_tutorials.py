"""SoftRobots' tutorials are accepted, unmodified, and run; `taichisoft sofa check --steps 50` runs all of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichisoft import Control, KeyEvent, Simulation, load_scene, make_controller
from taichisoft.scene import scene_from_dict
from taichisoft_sofa.controller.sofa_controller import SofaController
from taichisoft_sofa.scene_reader import checked

STEPS = {
    "FirstSteps/details/step1.py": 0,
    "FirstSteps/details/step4.py": 0,
    "DiamondRobot/DiamondRobot.py": 5,
    "Trunk/trunk.py": 0,
    "SoftFingerDesign/details/actuated_finger.py": 50,
    "SoftFingerDesign/details/gripper_simulation.py": 0,
    "SoftFingerDesign/details/s90_servo.py": 0,
    "SoftFingerDesign/details/actuated_arm.py": 0,
    "Tripod/details/elasticbody.py": 0,
    "Tripod/details/step1.py": 0,
    "Tripod/details/s90servo.py": 20,
    "Tripod/details/actuatedarm.py": 0,
    "Tripod/details/maze.py": 50,
    "Tripod/details/step2.py": 0,
    "Tripod/details/step3.py": 0,
    "Tripod/details/step4-2.py": 20,
    "Tripod/details/step5.py": 0,
    "Tripod/details/step6.py": 20,
    "Tripod/details/step7.py": 0,
}
"""Steps to make of each scene; those left out of a series have no component that the next ones lack."""


@pytest.fixture
def tutorials(
    shared: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, sofa: None
) -> Path:
    folder = shared / "sofa-scenes" / "softrobots-tutorials"
    if not folder.is_dir():
        pytest.skip("needs ../shared/sofa-scenes, which is not part of the project")
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path_factory.getbasetemp() / "tutorials"))  # many share their meshes
    return folder


@pytest.mark.parametrize("name", STEPS)
def test_a_tutorial_is_accepted_and_runs(tutorials: Path, name: str) -> None:
    found = checked(tutorials / name, str(tutorials.parent / "python"), False, steps=STEPS[name])
    assert found.problems == []


@pytest.mark.parametrize("name", ["step8.py", "step8-maze.py", "step9.py"])
def test_tutorials_of_the_inverse_solver_are_refused_for_it(tutorials: Path, name: str) -> None:
    found = checked(tutorials / "Tripod/details" / name, str(tutorials.parent / "python"), False)
    assert found.problems[0].startswith("QPInverseProblemSolver '/QP' (")
    assert "belongs to the inverse solver" in found.problems[0]


def _of_finger(root: Any) -> Control:
    return Control(pressure={"Finger.Cavity": root.Finger.Cavity.SurfacePressureConstraint.value.value[0] / 0.01})


def _of_trunk(root: Any) -> Control:
    cables = [child for child in root.Simulation.Trunk.children if child.getName().startswith("cable")]
    return Control(cable_pull={f"Trunk.{one.getName()}": one.cable.value.value[0] for one in cables})


def _of_maze(root: Any) -> Control:
    pose = np.array(root.Effector.goalMO.rest_position.value)[0]
    turn = Rotation.from_quat(pose[3:]).as_rotvec()
    return Control(frame_translation={"Effector": pose[:3] - [0, 40, 0]}, frame_rotation={"Effector": turn})


@pytest.mark.parametrize(
    ("name", "keys", "control"),
    [
        ("../pneunet-steps/step6-pneumaticActuatorAndPythonScriptController.py", "+++", _of_finger),
        ("Trunk/trunk.py", "", _of_trunk),
        ("Tripod/details/maze.py", "", _of_maze),
    ],
)
def test_a_converted_tutorial_moves_alike_by_native_controls(
    tutorials: Path, tmp_path: Path, name: str, keys: str, control: Callable[[Any], Control]
) -> None:
    """docs/sofa.md says which native control is which value of SOFA; both runs are the same to the last digits."""
    scene = load_scene(tutorials / name, reader_settings={"python_path": str(tutorials.parent / "python")})
    made, simulation = make_controller(scene), Simulation(scene)
    assert isinstance(made, SofaController)
    made.reset(simulation.model)
    native = Simulation(scene_from_dict({**scene.model_dump(exclude_none=True), "controller": None}))
    for step in range(4):
        for key in keys if step == 0 else ():
            made.key(KeyEvent(key))
        simulation.step(made.control(simulation.observe()))
        native.step(control(made._tree.root))
    for field in ("position", "rigid_position", "rigid_rotation"):
        assert np.allclose(getattr(native.state, field), getattr(simulation.state, field), rtol=0, atol=1e-9)
    assert np.abs(simulation.state.position - simulation.model.rest_position).max(initial=0.0) > 0.01 or "maze" in name
