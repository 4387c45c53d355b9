"""The controllers on fingers that cables close, those of the shipped cable gripper."""

from pathlib import Path
from typing import Any

import pytest

from taichisoft import Control, KeyEvent, Observation, Simulation, load_scene, make_controller, run
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_controllers.closed_loop import ClosedLoopController, Phase
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_controllers.scripted_controller import scripted_controller

TENDONS = ("finger1.tendon", "finger2.tendon", "finger3.tendon")
GRAVITY = 9810.0


def test_keys_and_sliders_pull_the_cables_at_the_scene_s_speed() -> None:
    """Two presses are 2 mm, for all; a slider moves one cable; 60 mm/s are 0.6 mm a step. Fingers bend inwards."""
    simulation, controller = Simulation(load_scene("cable-gripper")), KeyboardController()
    controller.reset(simulation.model)
    controller.key(KeyEvent("+"))
    controller.key(KeyEvent("+"))
    controller.key(KeyEvent("finger2.tendon", value=1.0))
    simulation.step(controller.control(simulation.observe()))
    assert simulation.observe().clipped == TENDONS
    assert simulation.state.actuator_target.tolist() == pytest.approx([0.6] * 3)
    for _ in range(30):
        simulation.step(controller.control(simulation.observe()))
    seen = simulation.observe()
    assert seen.cable_pulls == pytest.approx(dict(zip(TENDONS, [2.0, 1.0, 2.0], strict=True)), abs=1e-3)
    assert seen.bending_angles["finger1"] > 1.5 * seen.bending_angles["finger2"] > 0.03
    assert controller.sliders["finger1.tendon"].highest == 20.0  # the cable's own stop


def test_a_script_goes_on_from_a_state_to_the_bit(tmp_path: Path) -> None:
    script = tmp_path / "close.toml"
    script.write_text("keyframes = [{ time = 0.0, pull = 0.0 }, { time = 0.4, pull = 3.0 }]")
    straight = Simulation(load_scene("cable-gripper"))
    run(straight, scripted_controller(script), [], 0.1)
    resumed = Simulation(straight.model)
    resumed.restore(straight.state.copy())
    for simulation in (straight, resumed):
        run(simulation, scripted_controller(script), [], 0.2)
    assert resumed.state.time == pytest.approx(0.3)
    assert resumed.state == straight.state


def test_a_step_of_a_script_waits_for_a_tension(tmp_path: Path) -> None:
    """It stops where the mean tension passes 200 mN, before 2 mm; then the tensions are driven, from there."""
    script = tmp_path / "feel.toml"
    script.write_text(
        '[[steps]]\npull = 2.0\npull_speed = 10.0\nuntil = "tension > 200"\ntimeout = 0.3\n'
        "[[steps]]\ntension = 100.0\nduration = 0.1"
    )
    simulation = Simulation(load_scene("cable-gripper"))
    run(simulation, scripted_controller(script), [], 0.35)
    seen = simulation.observe()
    assert seen.cable_tensions == pytest.approx(dict.fromkeys(TENDONS, 100.0))
    assert all(0.1 < pull < 2.0 for pull in seen.cable_pulls.values())


class Watched(ClosedLoopController):
    """Keeps what it said."""

    def reset(self, model: Any) -> None:
        super().reset(model)
        self.signals: list[dict[str, float]] = []

    def control(self, observation: Observation) -> Control:
        control = super().control(observation)
        self.signals.append(dict(control.signals))
        return control


def test_closed_loop_lifts_an_unknown_weight_by_cables() -> None:
    """80 g take 1121 mN at friction 0.7, and it begins with 800: it slips, and is held with more. Quick, and low."""
    simulation, controller = Simulation(load_scene("cable-gripper")), Watched(lift=10.0, lift_time=0.8, hold=0.3)
    start = simulation.state.rigid_position[0, 2]
    run(simulation, controller, [], 5.0)
    first, last = controller.signals[0], controller.signals[-1]
    assert last["phase"] == Phase.HELD
    assert last["set_point"] > first["set_point"] == 800.0
    assert 0.7 * last["force"] > 0.08 * GRAVITY
    assert simulation.state.rigid_position[0, 2] - start > 7.0
    assert controller.summary()["pull asked for last"].endswith(" mm")


def test_the_closed_loop_says_when_cables_cannot_reach() -> None:
    simulation = Simulation(load_scene("cable-gripper"))
    controller = ClosedLoopController(highest_pull=1.0, pull_approach_speed=10.0)
    with pytest.raises(ControllerFailed, match=r"no contact of finger1, finger2, finger3 up to 1 mm; .* at 1\.0 mm"):
        run(simulation, controller, [], 1.0)


def test_the_closed_loop_needs_room_between_the_stops() -> None:
    scene = load_scene("cable-gripper", ["soft_bodies.finger1.cables.tendon.lowest_pull=16.0"])
    with pytest.raises(
        SceneError, match=r"highest_pull = 15: within the stops of the cables this leaves pulls from 16"
    ):
        ClosedLoopController().reset(Simulation(scene).model)


def test_the_shipped_scene_runs_its_own_script() -> None:
    scene = load_scene("cable-gripper")
    controller = make_controller(scene)
    simulation = Simulation(scene)
    controller.reset(simulation.model)
    control = controller.control(simulation.observe())
    assert control.cable_pull == dict.fromkeys(TENDONS, 0.0)
    assert not control.pressure
