"""SoftRobots' tutorials are accepted, unmodified, and run; `taichisoft sofa check --steps 50` runs all of them."""

from pathlib import Path

import pytest

from taichisoft_sofa.checking import checked

STEPS = {
    "FirstSteps/details/step1.py": 0,
    "FirstSteps/details/step4.py": 0,
    "DiamondRobot/DiamondRobot.py": 5,
    "Trunk/trunk.py": 0,
    "SoftFingerDesign/details/actuated_finger.py": 50,
    "SoftFingerDesign/details/gripper_simulation.py": 0,
    "Tripod/details/elasticbody.py": 0,
    "Tripod/details/step2.py": 0,
    "Tripod/details/step3.py": 0,
    "Tripod/details/step4-1.py": 0,
    "Tripod/details/step4-2.py": 50,
    "Tripod/details/step4-3.py": 0,
    "Tripod/details/step4.py": 0,
    "Tripod/details/step5.py": 0,
    "Tripod/details/step6.py": 50,
    "Tripod/details/step7.py": 0,
    "Tripod/details/tripod.py": 0,
    "Tripod/details/tripodcontroller.py": 0,
}
"""Steps to make of each scene."""


@pytest.fixture
def tutorials(shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sofa: None) -> Path:
    folder = shared / "sofa-scenes" / "softrobots-tutorials"
    if not folder.is_dir():
        pytest.skip("needs ../shared/sofa-scenes, which is not part of the project")
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
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
