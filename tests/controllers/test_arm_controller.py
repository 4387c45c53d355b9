"""The controller "arm": scripts carry a cube, keys jog, links go where the joints bring them, runs go on."""

from pathlib import Path

import numpy as np
import pytest
from arms import STANDING, tool_of
from scipy.spatial.transform import Rotation

from taichisoft import KeyEvent, Simulation, load_scene, make_controller, run, scene_from_dict
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_to_toml
from taichisoft_arm.arm_controller import ArmController
from taichisoft_arm.kinematics import solve

SCRIPT = """
[[steps]]
pressure = 10.0
duration = 0.1
[[steps]]
move = { to = [0.0, 0.0, 30.0], speed = 100.0 }
[[steps]]
until = "lift > 15 and contact_force > 100"
timeout = 0.2
[[steps]]
move = { to = [20.0, 0.0, 30.0] }
[[steps]]
move = { to = [20.0, 0.0, 10.0], speed = 100.0 }
[[steps]]
pressure = 0.0
duration = 0.1
"""


def scene(folder: Path, script: str | None = SCRIPT, **settings):
    """The tiny gripper, carried by the shipped arm."""
    given = {**STANDING, "ramp": 0.05, **settings}
    if script is not None:
        (folder / "steps.toml").write_text(script)
        given["script"] = str(folder / "steps.toml")
    tables = load_scene(TINY_GRIPPER).model_dump(mode="json", exclude_none=True)
    return scene_from_dict({**tables, "controller": {"name": "arm", "settings": given}})


def steered(folder: Path, **settings) -> tuple[Simulation, ArmController]:
    """A simulation and a controller without a script."""
    simulation = Simulation(scene(folder, None, **settings))
    controller = make_controller(simulation.model.scene)
    controller.reset(simulation.model)
    return simulation, controller


def go_on(simulation: Simulation, controller: ArmController, steps: int = 40) -> None:
    for _ in range(steps):
        simulation.step(controller.control(simulation.observe()))


def test_a_cube_is_picked_carried_and_placed(tmp_path):
    """By 20 mm sideways and 20 mm up on the way; the pads, which the air lengthens, let go of it 0.5 mm beside.

    The links are where forward kinematics puts them, to round-off of positions of some 500 mm.
    """
    simulation = Simulation(scene(tmp_path))
    controller = make_controller(simulation.model.scene)
    slip = []

    def watch(report):
        if 0.2 < report.time < 0.9:
            slip.append(report.observation.object_positions["cube"] - report.observation.base_translation)

    outcome = run(simulation, controller, duration=1.35, on_step=watch)
    assert outcome == "completed"
    assert np.ptp(slip, axis=0).max() < 0.5
    seen = simulation.observe()
    assert seen.object_positions["cube"] == pytest.approx([20.0, 0.0, 5.2], abs=0.5)
    assert seen.base_translation == pytest.approx([20.0, 0.0, 0.0], abs=1e-9)
    assert seen.base_rotation == pytest.approx(0.0, abs=1e-12)
    base = controller._base
    joints = base.observed(seen)
    assert tool_of(base, joints) == pytest.approx([20.0, 0.0, 10.0], abs=1e-9)
    motions = base.arm.motions(joints)
    bodies = simulation.model.rigid_bodies
    assert sum(body.follows == "arm_joint_3" for body in bodies) == 1
    for number, body in enumerate(bodies):
        if body.follows in base.arm.frame_names():
            motion = motions[base.arm.frame_names().index(body.follows)]
            place = motion[:3, :3] @ body.start_position + motion[:3, 3]
            assert simulation.state.rigid_position[number] == pytest.approx(place, abs=1e-9)


def test_a_run_goes_on_in_the_middle_of_a_way(tmp_path):
    """Bit for bit, from what the controller saved while the arm moved; and a scene that is written out adds nothing."""
    first = Simulation(scene(tmp_path))
    controller = make_controller(first.model.scene)
    controller.reset(first.model)
    go_on(first, controller, 25)
    saved, state = controller.save(), first.state
    go_on(first, controller, 10)
    (tmp_path / "resolved.toml").write_text(scene_to_toml(first.model.scene))
    again = load_scene(tmp_path / "resolved.toml")
    assert again == first.model.scene
    second = Simulation(again)
    second.restore(state)
    other = make_controller(again)
    other.reset(second.model)
    other.restore(saved)
    go_on(second, other, 10)
    assert second.state.position.tolist() == first.state.position.tolist()
    assert second.state.frame_pose.tolist() == first.state.frame_pose.tolist()


@pytest.mark.parametrize("links", ["colliding", "drawn"])
def test_links_push_what_they_touch_if_asked(links):
    """The hand, 32 mm in radius, moves 30 mm towards a ball of 10 mm that floats 63 mm beside; they keep 1 mm apart.

    The ball is at rest until it is touched, after 20 mm, and then goes ahead of the hand, which gives no speed back.
    """
    tables = {
        "gravity": [0.0, 0.0, 0.0],
        "contact": {"friction": 0.0},
        "base_pivot": [0.0, 0.0, 120.0],
        "rigid_bodies": {"ball": {"sphere": {"radius": 10.0}, "mass": 0.01, "position": [63.0, 0.0, 130.0]}},
        "controller": {"name": "arm", "settings": {**STANDING, "links": links}},
    }
    simulation = Simulation(scene_from_dict(tables))
    controller = make_controller(simulation.model.scene)
    controller.reset(simulation.model)
    for _ in range(10):
        controller.key(KeyEvent("right"))
    go_on(simulation, controller, 28)
    place, base = simulation.observe().object_positions["ball"][0], simulation.observe().base_translation[0]
    assert 25.0 < base <= 30.0
    if links == "drawn":
        assert place == 63.0
    else:
        assert place == pytest.approx(base + 43.0, abs=0.2)


def test_keys_jog_in_the_axes_of_the_world_and_of_the_tool(tmp_path):
    """3 mm and 11.25 degrees a key; the tool turns about itself, and in its own axes goes where it then looks."""
    simulation, controller = steered(tmp_path, links="none")
    assert controller.interactive
    place = np.array([0.0, 0.0, 10.0])
    for key, way in (
        ("up", [0, 0, 3]),
        ("right", [3, 0, 0]),
        ("i", [0, 3, 0]),
        ("down", [0, 0, -3]),
        ("k", [0, -3, 0]),
    ):
        controller.key(KeyEvent(key))
        place = place + way
    controller.key(KeyEvent("a"))
    go_on(simulation, controller)
    seen, base = simulation.observe(), controller._base
    assert tool_of(base, base.observed(seen)) == pytest.approx(place, abs=1e-8)
    assert np.degrees(seen.base_rotation) == pytest.approx([0.0, 0.0, 11.25], abs=1e-9)
    controller.key(KeyEvent("w"))
    assert "tool axes" in controller.status
    controller.key(KeyEvent("right"))
    controller.key(KeyEvent("d"))
    go_on(simulation, controller)
    seen = simulation.observe()
    turned = Rotation.from_euler("z", 11.25, degrees=True)
    assert tool_of(base, base.observed(seen)) == pytest.approx(place + turned.apply([3.0, 0.0, 0.0]), abs=1e-8)
    tilted = turned * Rotation.from_euler("x", 11.25, degrees=True)
    assert seen.base_rotation == pytest.approx(tilted.as_rotvec(), abs=1e-9)


def test_sliders_keep_joints_and_air_within_their_limits(tmp_path):
    simulation, controller = steered(tmp_path, links="none")
    assert controller.sliders["joint_1"].unit == "degrees" and controller.sliders["left.cavity"].unit == "kPa"
    start = controller.sliders["joint_1"].value
    controller.key(KeyEvent("joint_1", value=start + 5.0))
    controller.key(KeyEvent("left.cavity", value=5.0))
    asked = controller.control(simulation.observe())
    assert asked.pressure == {"left.cavity": 5.0, "right.cavity": 0.0}
    speed = (asked.signals["joint_1"] - start) / simulation.model.scene.time.step  # degrees/s, held by all the others
    assert 0.0 < speed < np.degrees(controller._base.arm.chain.speed[0])
    go_on(simulation, controller, 60)
    assert controller.control(simulation.observe()).signals["joint_1"] == pytest.approx(start + 5.0, abs=1e-9)
    controller.key(KeyEvent("joint_6", value=9999.0))
    assert controller.sliders["joint_6"].value == pytest.approx(360.0, abs=0.1)


def test_key_takes_over_from_the_script_within_reach(tmp_path):
    simulation = Simulation(scene(tmp_path, links="none", translation_step=150.0))
    controller = make_controller(simulation.model.scene)
    controller.reset(simulation.model)
    assert not controller.interactive and "the script steers" in controller.status
    go_on(simulation, controller, 25)
    before = simulation.observe().base_translation
    controller.key(KeyEvent("x"))  # no key of the arm
    assert "the script steers" in controller.status
    controller.key(KeyEvent("right"))
    go_on(simulation, controller, 20)
    seen = simulation.observe()
    moved = seen.base_translation - before
    assert 10.0 < moved[0] <= 20.0  # 100 mm/s, with which the arm is jogged
    assert moved[1:] == pytest.approx([0.0, 0.0], abs=5.0)  # every joint goes straight, not the tool
    assert seen.pressures == {"left.cavity": 10.0, "right.cavity": 10.0}
    for _ in range(5):
        controller.key(KeyEvent("right"))
    assert "does not reach further" in controller.status
    other = make_controller(simulation.model.scene)
    other.reset(simulation.model)
    other.restore(controller.save())
    assert other.sliders == controller.sliders
    asked = [one.control(seen).base_translation.tolist() for one in (controller, other)]
    assert asked[0] == asked[1]


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ("move = { to = [0.0, -900.0, 0.0] }", "steps.0: the arm does not reach [0.0, -900.0, 0.0]"),
        ("joints = [0.0, 0.0, 0.0]", "steps.0: joints has 3 values; the arm has 6 joints"),
        ("joints = [0.0, 500.0, 0.0, 0.0, 0.0, 0.0]", "steps.0: joints: joint_2 = 500: must be from -99.9811"),
        ("move = { to = [0.0, 0.0, 60.0] }\nduration = 0.01", "steps.0: duration = 0.01 s: the arm needs"),
    ],
)
def test_a_way_that_the_arm_cannot_go_is_found_before_it_moves(tmp_path, step, said):
    simulation = Simulation(scene(tmp_path, f"[[steps]]\n{step}", links="none"))
    controller = make_controller(simulation.model.scene)
    controller.reset(simulation.model)
    with pytest.raises(ControllerFailed, match=r"steps\.toml: ") as refused:
        controller.control(simulation.observe())
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("step", "said"),
    [
        ("move = {}", "needs to or turn"),
        ('move = { to = [0, 0, 0.0], by = "joints", speed = 3.0 }', "have no effect beside"),
        ("base_translation = [0.0, 0.0, 0.0]\nduration = 1.0", "an arm carries the base; give move or joints"),
        ("move = { turn = [0.0, 0.0, 9.0] }\njoints = [1.0]", "move and joints are both given"),
        ("move = { to = [0, 0, 0.0], speed = 3.0 }\nduration = 1.0", "duration and move.speed are both given"),
        ("name = 'nothing'", "it needs at least one of move, joints, pressure"),
        ("duration = 1.0", "duration without anything that moves"),
    ],
)
def test_steps_that_say_nothing_or_too_much_are_refused(tmp_path, step, said):
    with pytest.raises(SceneError) as refused:
        make_controller(scene(tmp_path, f"[[steps]]\n{step}", links="none"))
    assert said in str(refused.value)


def test_the_shipped_scene_is_whole():
    """Its arm reaches every place of its script, which nothing but its run of ten seconds shows otherwise."""
    shipped = load_scene("pick-and-place")
    assert len([body for body in shipped.rigid_bodies.values() if body.follows]) == 12
    controller = make_controller(shipped)
    base, places = controller._base, [step.move.to for step in controller._script._steps if step.move is not None]
    assert len(places) == 5
    for place in places:
        motion = np.eye(4)
        motion[:3, 3] = np.array(place) - shipped.controller.settings["tool"]
        assert solve(base.arm.chain, base.arm.link_pose(motion), base.arm.start) is not None
