"""Rigid bodies that the base carries: where it takes them, whatever they touch; what they bear is on the base."""

from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.mesh import write_stl
from taichisoft.scene import scene_from_dict

STEP, MASS = 0.01, 0.05
WEIGHT = 9810.0 * MASS


def tray(time: dict[str, Any] | None = None, **changes: Any) -> Simulation:
    """A tray on the base, a cube of 50 g on the tray, and a floor below, in which the tray may dip."""
    palm = {"box": [80.0, 80.0, 10.0], "position": [0.0, 0.0, -5.0], "rotation": [0.0, 0.0, 30.0], "follows": "base"}
    scene = {
        "time": {"step": STEP, **(time or {})},
        "contact": {"friction": 0.5, "contact_distance": 0.2, "alarm_distance": 2.0},
        "rigid_bodies": {
            "palm": {**palm, **changes},
            "cube": {"box": [20.0, 20.0, 20.0], "mass": MASS, "position": [15.0, 0.0, 10.2]},
        },
        "obstacles": {"floor": {"plane": {"point": [0, 0, -60], "normal": [0, 0, 1]}}},
        "base_pivot": [0.0, 0.0, 40.0],
    }
    return Simulation(scene_from_dict(scene))


def test_it_is_where_the_base_is(figures: Figures) -> None:
    """Position and rotation are those of the base's pose applied to the start, to round-off, after turns and ways."""
    simulation, pivot = tray(), np.array([0.0, 0.0, 40.0])
    start = Rotation.from_euler("xyz", [0, 0, 30], degrees=True)
    worst = 0.0
    velocity, turning = np.array([3.0, -40.0, 5.0]), np.array([0.3, -0.2, 1.5])
    for _ in range(60):
        simulation.step(Control(base_velocity=velocity, base_angular_velocity=turning))
        seen = simulation.observe()
        turn = Rotation.from_rotvec(seen.base_rotation)
        place = turn.apply(np.array([0.0, 0.0, -5.0]) - pivot) + pivot + seen.base_translation
        quaternion = seen.object_rotations["palm"]
        off = (turn * start).inv() * Rotation.from_quat(quaternion[[1, 2, 3, 0]])
        worst = max(worst, float(np.abs(seen.object_positions["palm"] - place).max()), float(off.magnitude()))
    figures.at_most("pose of the palm against the base's [mm, rad]", worst, 1e-12)


def test_it_carries_by_friction_and_the_base_bears_it(figures: Figures) -> None:
    """A cube rides along while the base speeds up at less than mu g, and stays behind at more.

    The force on the base is m (g - a) all the time, to 1e-6 of the weight: the solver's tolerance.
    """
    for acceleration, rides in ((0.3 * 9810.0, True), (0.8 * 9810.0, False)):
        simulation = tray()
        for _ in range(20):
            simulation.step()
        before = simulation.state.rigid_position[1] - simulation.state.rigid_position[0]
        worst = 0.0
        for number in range(12):
            velocity = simulation.state.rigid_velocity[1]
            report = simulation.step(Control(base_velocity=np.array([acceleration * STEP * (number + 1), 0.0, 0.0])))
            assert report.converged
            change = (simulation.state.rigid_velocity[1] - velocity) / STEP
            expected = MASS * (np.array([0.0, 0.0, -9810.0]) - change)
            worst = max(worst, float(np.abs(report.observation.base_force - expected).max()) / WEIGHT)
        slid = np.linalg.norm(simulation.state.rigid_position[1] - simulation.state.rigid_position[0] - before)
        assert (slid < 0.01) if rides else (slid > 1.0)
        figures.at_most(f"force on the base against m (g - a), a = {acceleration / 9810:g} g", worst, 1e-6)


def test_its_torque_is_that_of_the_load(figures: Figures) -> None:
    """At rest the torque about the pivot is r x m g, 15 mm from it."""
    simulation = tray()
    for _ in range(100):
        report = simulation.step()
    arm = simulation.state.rigid_position[1] - np.array([0.0, 0.0, 40.0])
    torque = np.cross(arm, [0.0, 0.0, -WEIGHT])
    figures.at_most("torque on the base", np.abs(report.observation.base_torque - torque).max() / WEIGHT, 1e-4)


def test_it_does_not_give_way_to_obstacles() -> None:
    """The base pushes it into the floor, where nothing happens: both are where they are."""
    simulation = tray()
    for _ in range(30):
        report = simulation.step(Control(base_velocity=np.array([0.0, 0.0, -200.0])))
        assert report.converged
    assert simulation.state.rigid_position[0, 2] == pytest.approx(-65.0, abs=1e-12)
    assert ("palm", "floor") not in report.observation.normal_forces


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": 1.0}, "exactly one of mass, density, follows is needed; given: mass, follows"),
        ({"velocity": [1.0, 0.0, 0.0]}, "velocity would have no effect beside follows"),
        ({"follows": "wrist"}, "follows"),
        ({"follows": None}, "exactly one of mass, density, follows is needed; given: none"),
    ],
)
def test_tables_that_make_no_sense(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        tray(**changes)


def test_a_carried_body_has_no_mass_to_vary() -> None:
    with pytest.raises(SceneError, match="'palm' follows the frame 'base' and has no mass"):
        tray().model.varied(masses={"palm": 1.0})


def test_a_driven_sheet_without_thickness_pushes_a_soft_block_in_first_order(block: Any, tmp_path: Any) -> None:
    """An open surface is a body that follows: in overdamped dynamics it moves a free block at its own speed."""
    sheet = tmp_path / "sheet.stl"
    write_stl(np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), sheet)
    table = {"mesh": block((1, 1, 1), (10.0, 10.0, 10.0)), "mass": 0.01, "young_modulus": 100.0, "poisson_ratio": 0.3}
    scene = {
        "gravity": [0.0, 0.0, 0.0],
        "time": {"step": STEP, "dynamics": "overdamped"},
        "contact": {"friction": 0.5, "contact_distance": 0.2, "alarm_distance": 2.0},
        "soft_bodies": {"block": {**table, "translation": [0.0, 0.0, 5.2]}},
        "frames": {"lift": {}},
        "rigid_bodies": {"sheet": {"surface": str(sheet), "follows": "lift"}},
    }
    simulation = Simulation(scene_from_dict(scene))
    lowest = simulation.state.position[:, 2].min()
    for number in range(20):
        simulation.step(Control(frame_translation={"lift": np.array([0.0, 0.0, 0.1 * (number + 1)])}))
    moved = simulation.state.position[:, 2].min() - lowest
    gap = simulation.state.position[:, 2].min() - 2.0
    assert moved == pytest.approx(2.0, abs=0.21)  # but for the distance at which contact begins
    assert gap == pytest.approx(0.2, abs=1e-6)


def test_springs_hold_a_rigid_body_as_implicit_euler_has_them(figures: Figures) -> None:
    """m x'' = -k x - b k x' + m g and J q'' = -c q - b c q': each step is that of implicit Euler, to round-off.

    v1 = (m v0 + h (m g - k (x0 - a))) / (m + h (h + b) k), x1 = x0 + h v1, about a frame at a that moves; a turn about
    a principal axis alike. At rest the body hangs m g / k below the frame.
    """
    springs = {"stiffness": 300.0, "angular_stiffness": 9000.0, "rayleigh_stiffness": 0.02, "follows": "lift"}
    body = {"box": [20.0, 30.0, 40.0], "mass": MASS, "position": [1.0, 2.0, 3.0], "angular_velocity": [0.0, 0.0, 4.0]}
    scene = {"time": {"step": STEP}, "frames": {"lift": {}}, "rigid_bodies": {"box": {**body, "springs": springs}}}
    simulation = Simulation(scene_from_dict(scene))
    inertia, lag = MASS * (20.0**2 + 30.0**2) / 12, STEP * (STEP + 0.02)
    height, speed, angle, turning, worst = 3.0, 0.0, 0.0, 4.0, 0.0
    for number in range(40):
        aim = 3.0 + 0.2 * min(number, 10)
        simulation.step(Control(frame_translation={"lift": np.array([0.0, 0.0, aim - 3.0])}))
        speed = (MASS * speed - STEP * (WEIGHT + 300.0 * (height - aim))) / (MASS + lag * 300.0)
        turning = (inertia * turning - STEP * 9000.0 * angle) / (inertia + lag * 9000.0)
        height, angle = height + STEP * speed, angle + STEP * turning
        half = simulation.state.rigid_rotation[0, 3]
        worst = max(worst, abs(simulation.state.rigid_position[0, 2] - height), abs(2.0 * np.arcsin(half) - angle))
    figures.at_most("place [mm] and angle [rad] against implicit Euler's", worst, 1e-11)
    for _ in range(400):
        simulation.step()
    assert simulation.state.rigid_position[0, 2] == pytest.approx(5.0 - WEIGHT / 300.0, abs=1e-9)


def test_springs_lead_to_a_frame_that_exists() -> None:
    body = {"box": [1.0, 1.0, 1.0], "mass": MASS, "springs": {"stiffness": 1.0, "follows": "lfit"}}
    with pytest.raises(SceneError, match=r"rigid_bodies\.box\.springs\.follows is 'lfit', which is not a frame"):
        scene_from_dict({"rigid_bodies": {"box": body}})


def test_what_follows_a_frame_need_not_be_a_solid(tmp_path: Any) -> None:
    """A flat closed surface, which no free body can have, is one that follows a frame."""
    corners, both = np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0]]), np.array([[0, 1, 2], [0, 2, 1]])
    write_stl(corners, both, tmp_path / "flat.stl")
    body = {"surface": str(tmp_path / "flat.stl"), "collides": False}
    simulation = Simulation(scene_from_dict({"rigid_bodies": {"flat": {**body, "follows": "base"}}}))
    simulation.step(Control(base_translation=np.array([1.0, 2.0, 3.0])))
    assert simulation.state.rigid_position[0] == pytest.approx([1.0, 2.0, 3.0])
    with pytest.raises(TaichisoftError, match="encloses no volume"):
        Simulation(scene_from_dict({"rigid_bodies": {"flat": {**body, "mass": MASS}}}))
