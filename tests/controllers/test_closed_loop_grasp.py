"""The closed-loop controller on simulated grippers: it lifts, holds against pushes, and says why when it cannot."""

from typing import Any

import numpy as np
import pytest

from taichisoft import Observation, Simulation, State, load_scene, run
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene.scene import ExternalForce
from taichisoft_controllers.closed_loop import ClosedLoopController, Phase

QUICK = {"lift": 10.0, "lift_time": 0.8, "hold": 0.4}
GRAVITY = 9810.0


class Watched(ClosedLoopController):
    """Keeps what it was shown and what it said."""

    def reset(self, model: Any) -> None:
        super().reset(model)
        self.seen: list[Observation] = []
        self.signals: list[dict[str, float]] = []

    def control(self, observation: Observation) -> Any:
        control = super().control(observation)
        self.seen.append(observation)
        self.signals.append(dict(control.signals))
        return control

    def signal(self, name: str) -> np.ndarray:
        return np.array([signals[name] for signals in self.signals])


def grasp(
    scene: Any,
    duration: float,
    overrides: tuple[str, ...] = (),
    forces: tuple[ExternalForce, ...] = (),
    **settings: Any,
):
    """The controller and the last state of a run."""
    controller = Watched(**settings)
    simulation = Simulation(load_scene(scene, overrides).model_copy(update={"external_forces": list(forces)}))
    run(simulation, controller, [], duration)
    return controller, simulation.state


def lift_of_cube(state: State, controller: Watched, axis: int) -> float:
    return float(state.rigid_position[0, axis] - controller.seen[0].object_positions["cube"][axis])


def test_the_gripper_lifts_20_g_and_a_push_of_half_the_weight_does_not_make_it_drop_them() -> None:
    """Downwards for 0.2 s. And Coulomb, from what was observed in the air: the fingers press enough for the weight."""
    push = ExternalForce(body="cube", force=(-0.5 * 0.02 * GRAVITY, 0.0, 0.0), start=3.3, duration=0.2)
    overrides = ("rigid_bodies.cube.mass=0.02", "time.step=0.02")
    controller, state = grasp("gripper", 4.0, overrides, (push,), **QUICK)
    assert controller.signals[-1]["phase"] == Phase.HELD
    assert lift_of_cube(state, controller, axis=0) == pytest.approx(10.0, abs=3.0)
    assert np.linalg.norm(state.rigid_velocity[0]) < 1.0
    in_the_air = [seen for seen in controller.seen if ("cube", "floor") not in seen.normal_forces and seen.time > 2.0]
    assert len(in_the_air) > 75
    assert all(0.6 * sum(seen.normal_forces.values()) > 0.02 * GRAVITY for seen in in_the_air)
    settled = controller.signal("force")[-5:]
    np.testing.assert_allclose(settled, controller.signals[-1]["set_point"], rtol=0.02)


def test_a_cube_that_slips_is_squeezed_harder_until_it_is_lifted() -> None:
    """10 g with a force that holds 3.7 g at most: 60 mN, friction 0.6. By another gripper, whose pads answer with four
    times the force of a finger: with half the gain, since with all of it they go to and fro from step to step."""
    settings = {"set_point": 60.0, "proportional_gain": 0.0025, **QUICK}
    controller, state = grasp(TINY_GRIPPER, 4.0, ("rigid_bodies.cube.mass=0.01",), **settings)
    assert controller.signals[-1]["phase"] == Phase.HELD
    assert lift_of_cube(state, controller, axis=2) == pytest.approx(10.0, abs=1.5)
    raised = controller.signal("set_point")
    assert (np.diff(raised) >= 0.0).all()
    assert 0.6 * raised[-1] > 0.01 * GRAVITY
    (slips,) = np.nonzero(np.diff(raised))
    assert (controller.signal("slip_speed")[slips + 1] > 1.0).all()


def test_the_controller_may_be_asked_less_often_than_every_step() -> None:
    """Every fourth step. The pads give some 180 mN/kPa, the fingers 40: a gain for both needs more calls than that."""
    overrides = ('controller={name="closed-loop", period=0.04}',)
    gains = {"proportional_gain": 0.0, "integral_gain": 0.05}
    controller, state = grasp(TINY_GRIPPER, 4.0, overrides, set_point=60.0, **gains, **QUICK)
    assert len(controller.seen) == 100
    assert controller.signals[-1]["phase"] == Phase.HELD
    assert lift_of_cube(state, controller, axis=2) == pytest.approx(10.0, abs=1.0)


def test_it_holds_a_force_through_a_slow_line() -> None:
    """Regulators with 0.2 s and tubes: a slow approach leaves little pressure on its way when the pads touch.

    As tuned for regulated air it comes to rest, too, but presses with several times the set point before.
    """
    line = "{conductance = 0.05, response_time = 0.2, tube_length = 300.0, tube_diameter = 2.0}"
    table = f'{{group = "cavity", air = "line", line = {line}}}'
    overrides = tuple(f"soft_bodies.{side}.cavities.cavity={table}" for side in ("left", "right"))
    settings = {"set_point": 60.0, "proportional_gain": 0.0025, **QUICK}
    tuned, state = grasp(TINY_GRIPPER, 5.0, overrides, approach_rate=3.0, **settings)
    assert tuned.signals[-1]["phase"] == Phase.HELD
    assert lift_of_cube(state, tuned, axis=2) == pytest.approx(10.0, abs=1.0)
    np.testing.assert_allclose(tuned.signal("force")[-20:], 60.0, rtol=0.01)
    untuned, _ = grasp(TINY_GRIPPER, 2.0, overrides, **settings)
    assert tuned.signal("force").max() < 2.0 * 60.0 < 4.0 * 60.0 < untuned.signal("force").max()


def test_two_runs_of_one_controller_are_equal_bit_for_bit() -> None:
    controller, simulation = ClosedLoopController(set_point=60.0), Simulation(load_scene(TINY_GRIPPER))
    start = simulation.state
    run(simulation, controller, [], 1.2)
    first = simulation.state
    simulation.restore(start)
    run(simulation, controller, [], 1.2)
    assert simulation.state == first


@pytest.mark.parametrize(
    ("overrides", "settings", "reason"),
    [
        ((), {"highest_pressure": 5.0}, "approach failed at .* no contact of left, right up to 5 kPa; "),
        (("limits.highest_pressure=4",), {}, "approach failed at .* no contact of left, right up to 4 kPa; "),
        (
            ("limits.highest_pressure=7.1",),
            {"set_point": 500.0, "patience": 0.5},
            "grip failed at .* the force does not settle within 0.5 s; .* of 500 mN at 7.1 kPa",
        ),
        (
            ("contact.friction=0.01", "rigid_bodies.cube.mass=0.05", "limits.highest_pressure=10"),
            {"set_point": 60.0, "longest_slip": 3.0},
            "lift failed at .* dropped 'cube', which sank by 3.0 mm; ",
        ),
        (
            ("contact.friction=0.01", "rigid_bodies.cube.mass=0.05", "limits.highest_pressure=10"),
            {"set_point": 60.0, "patience": 0.6},
            "lift failed at .* 'cube' is not lifted within 0.6 s; ",
        ),
    ],
)
def test_it_gives_up_with_the_reason(overrides: tuple[str, ...], settings: dict[str, float], reason: str) -> None:
    with pytest.raises(ControllerFailed, match=reason) as failed:
        grasp(TINY_GRIPPER, 6.0, overrides, **settings)
    assert "\n" not in str(failed.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"setpoint": 500.0}, "controller.settings.setpoint: unknown key; did you mean 'set_point'?"),
        ({"margin": 1.0}, "controller.settings.margin = 1.0: input should be greater than 1"),
        ({"integral_gain": -1.0}, "controller.settings.integral_gain = -1.0: input should be greater than 0"),
        ({"lift": "high"}, "controller.settings.lift = 'high': input should be a valid number"),
        ({"hold": float("nan")}, "controller.settings.hold = nan: input should be a finite number"),
        ({"grasps": 1.5}, "controller.settings.grasps = 1.5: input should be a valid integer"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as refused:
        ClosedLoopController(**settings)
    assert str(refused.value) == message


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("gravity=[0.0, 0.0, 0.0]",), "gravity = .* lifts against it"),
        (("rigid_bodies={}",), "no rigid body"),
        (("limits.highest_pressure=-1.0", "limits.lowest_pressure=-5.0"), "leaves pressures from 0 to -1 kPa"),
    ],
)
def test_scenes_in_which_nothing_can_be_grasped_are_refused(overrides: tuple[str, ...], message: str) -> None:
    simulation, controller = Simulation(load_scene(TINY_GRIPPER, overrides)), ClosedLoopController()
    with pytest.raises(SceneError, match=message):
        controller.reset(simulation.model)
    assert controller.summary() == {}
