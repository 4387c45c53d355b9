"""The closed loop: what it senses, how it regulates the force, its phases and its lift."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import example, given
from hypothesis import strategies as st
from made_up import made_up_model
from toy_grasp import FRICTION, STIFFNESS, STRONGEST, ToyGrasp, failure, run_toy

from taichisoft import Observation, Simulation, State, load_scene, run
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene.scene import ExternalForce
from taichisoft_controllers.closed_loop import (
    ClosedLoopController,
    ForceRegulator,
    GripSetPoint,
    LiftProfile,
    Phase,
    by_pressure,
)
from taichisoft_controllers.grasp_sensing import GraspSensing, GraspSettings, SensedGrasp
from taichisoft_controllers.settings import PRESSURE, PULL

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


def test_gripper_holds_20_g_against_half_their_weight() -> None:
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


# The phases of a closed-loop grasp on a toy of known friction: what is held, with what force, and what fails why.

TUNING = GraspSettings()
AT_FIRST = FRICTION * TUNING.set_point
"""What friction holds before the set point is raised [mN]."""


@examples(15)
@given(weight=st.floats(1.0, 0.9 * STRONGEST), period=st.sampled_from([0.01, 0.02, 0.05]))
@example(weight=763.5, period=0.05)
def test_one_tuning_holds_whatever_friction_can_hold(weight: float, period: float) -> None:
    """An object that slipped is held with the margin, less what the force grows by in two periods.

    The object sticks some time within a period after slip was last seen, and in the one before that slip may have been
    slower than `slip_speed`, as while the lift waits, so that it was not seen.
    """
    toy = ToyGrasp(weight)
    sequence = run_toy(toy, TUNING, 12.0, period)
    assert toy.phases == [Phase.APPROACH, Phase.GRIP, Phase.LIFT, Phase.HOLD, Phase.HELD]
    assert toy.base == pytest.approx(TUNING.lift, abs=1e-9)
    assert toy.height > TUNING.lift - 10.0
    assert weight <= FRICTION * toy.force
    if weight < 0.9 * AT_FIRST:
        assert sequence.set_point.raised_count == 0
    if weight > 1.1 * AT_FIRST and TUNING.margin * weight < 0.9 * STRONGEST:
        grown = TUNING.pressure_rate * STIFFNESS * period
        assert FRICTION * sequence.set_point.force >= TUNING.margin * (weight - 2.0 * FRICTION * grown)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("weight", [10.0, AT_FIRST / 1.5, 1.2 * AT_FIRST, STRONGEST / 1.8])
def test_a_push_of_half_the_weight_moves_nothing(weight: float, direction: float) -> None:
    """A set point that holds 1.5 times the weight from the first, or was raised when the object slipped."""
    toy, undisturbed = ToyGrasp(weight), ToyGrasp(weight)
    run_toy(toy, TUNING, 12.0, pushes=[(10.0, 10.2, direction * 0.5 * weight)])
    run_toy(undisturbed, TUNING, 12.0)
    assert toy.phases[-1] is Phase.HELD
    assert toy.height == pytest.approx(undisturbed.height, abs=0.1)


def test_weight_beyond_friction_is_given_up_with_the_reason() -> None:
    message = failure(ToyGrasp(1.2 * STRONGEST), TUNING)
    assert message.startswith("lift failed at ")
    assert "'cube'" in message and "at 105.0 kPa" in message and "\n" not in message


def test_object_out_of_reach_names_the_missing_fingers() -> None:
    message = failure(ToyGrasp(10.0), GraspSettings(highest_pressure=20.0))
    assert message.startswith("approach failed at 0.") and "no contact of finger up to 20 kPa" in message


def test_a_force_that_no_pressure_gives_is_given_up() -> None:
    message = failure(ToyGrasp(10.0), GraspSettings(highest_pressure=40.0, patience=3.0))
    assert "grip failed" in message and "does not settle within 3 s" in message
    assert "press with 600 of 800 mN at 40.0 kPa" in message


def test_object_knocked_out_later_is_reported_as_dropped() -> None:
    toy = ToyGrasp(100.0)
    with pytest.raises(ControllerFailed, match=r"^held failed at 8\.\d+ s: dropped 'cube', which sank by \d\d\.\d mm"):
        run_toy(toy, TUNING, 9.0, pushes=[(8.0, 8.3, -700.0)])


def test_second_grasp_keeps_the_force_of_the_first() -> None:
    toy, once = ToyGrasp(800.0), ToyGrasp(800.0)
    sequence = run_toy(toy, GraspSettings(grasps=3), 45.0)
    grasp, open_again = [Phase.APPROACH, Phase.GRIP, Phase.LIFT, Phase.HOLD], [Phase.LOWER, Phase.RELEASE]
    assert toy.phases == [*grasp, *open_again, *grasp, *open_again, *grasp, Phase.HELD]
    assert sequence.set_point.force == run_toy(once, TUNING, 10.0).set_point.force > TUNING.set_point


def test_a_hold_in_which_the_object_slips_starts_anew() -> None:
    """Friction holds 480 mN; 650 mN for 0.01 s make 300 mN of weight slide by half a millimetre."""
    calm, pushed = ToyGrasp(300.0), ToyGrasp(300.0)
    run_toy(calm, TUNING, 6.0)
    run_toy(pushed, TUNING, 6.0, pushes=[(5.0, 5.01, -350.0)])
    assert (calm.phases[-1], pushed.phases[-1]) == (Phase.HELD, Phase.HOLD)
    run_toy(again := ToyGrasp(300.0), TUNING, 8.0, pushes=[(5.0, 5.01, -350.0)])
    assert again.phases[-1] is Phase.HELD


# What the closed-loop controller makes of an observation: forces, touch, slip, and heights against gravity.

FINGERS = ("left", "right", "third")


def sensing() -> GraspSensing:
    """Three fingers and a cube in a world whose gravity acts along -y."""
    model = made_up_model([f"{name}.air" for name in FINGERS], goal={"object": "cube"}, gravity=[0.0, -9810.0, 0.0])
    return GraspSensing(model, PRESSURE, touch_force=5.0)


def sense(
    made: GraspSensing, normal: list[float], friction: list[float], slip: list[float], **other: Any
) -> SensedGrasp:
    """Forces and slip by finger; what is far from the cube is not in an observation at all."""
    near = [index for index, force in enumerate(normal) if force > 0.0]
    by_pair = {
        name: {(FINGERS[index], "cube"): values[index] for index in near}
        | {("cube", "floor"): 7.0, ("left", "right"): 3.0}
        for name, values in (("normal_forces", normal), ("friction_forces", friction), ("slip_speeds", slip))
    }
    values: dict[str, Any] = {
        "pressures": {"left.air": 10.0, "right.air": 20.0, "third.air": 60.0},
        "object_positions": {"cube": np.array([1.0, 12.0, 3.0])},
        "object_velocities": {"cube": np.array([3.0, 0.0, 4.0])},
        **by_pair,
        **other,
    }
    return made.sense(Observation(2.5, 250, **values), asked=7.0)


def test_forces_are_those_of_the_fingers_on_the_object() -> None:
    grasp = sense(sensing(), [100.0, 200.0, 4.0], [0.0] * 3, [0.0] * 3)
    assert (grasp.force, grasp.missing, grasp.applied, grasp.time) == (304.0, ("third",), 30.0, 2.5)


def test_heights_are_counted_against_gravity() -> None:
    moved = np.array([5.0, 8.0, 0.0])
    grasp = sense(sensing(), [0.0] * 3, [0.0] * 3, [0.0] * 3, base_translation=moved, clipped=("base_translation",))
    assert (grasp.offset, grasp.object_speed) == (4.0, 5.0)
    assert grasp.base_held_back and grasp.missing == FINGERS and grasp.slip_speed == 0.0


@pytest.mark.parametrize("friction", [0.1, 0.6, 1.2])
def test_a_finger_slips_when_it_slides_as_a_whole(friction: float) -> None:
    """All fingers slide as they close: friction is the coefficient times the normal force. Later less is used."""
    made, normal = sensing(), [100.0, 200.0, 100.0]
    closing = sense(made, normal, [friction * force for force in normal], [2.0, 2.0, 2.0])
    assert closing.slip_speed == pytest.approx(2.0)
    swaying = sense(made, normal, [0.8 * friction * force for force in normal], [9.0, 0.0, 5.0])
    assert swaying.slip_speed == 0.0
    one_slides = sense(made, normal, [friction * 100.0, 0.5 * friction * 200.0, 0.0], [8.0, 1.0, 1.0])
    assert one_slides.slip_speed == pytest.approx(8.0 * 100.0 / 400.0)  # weighted by force


def test_a_slack_cable_counts_as_pulled_in_by_what_was_asked() -> None:
    """Friction may hold its finger further in: the regulator must not take that for a limit of the motor."""
    model = made_up_model((), cables={"left.tendon": {}, "right.tendon": {}}, goal={"object": "cube"})
    pulls, tensions = {"left.tendon": 9.0, "right.tendon": 6.0}, {"left.tendon": 0.0, "right.tendon": 400.0}
    place = {"object_positions": {"cube": np.zeros(3)}, "object_velocities": {"cube": np.zeros(3)}}
    seen = Observation(2.5, 250, cable_pulls=pulls, cable_tensions=tensions, **place)
    assert GraspSensing(model, PULL, touch_force=5.0).sense(seen, asked=7.0).applied == 6.5


# The force regulator against closed forms: on plants whose answer to a PI regulator can be written down.

GAIN = 40.0  # of the plants: force over pressure [mN/kPa], about that of the fingers
NEVER = 1e9  # [kPa/s] or [kPa]: a limit that is not met


def regulator(proportional: float, integral: float, rate: float = NEVER, highest: float = NEVER) -> ForceRegulator:
    settings = GraspSettings(proportional_gain=proportional, integral_gain=integral, pressure_rate=rate)
    return ForceRegulator(by_pressure(settings, 0.0, highest), settings.tracking_time)


def fingers(made: ForceRegulator, set_point: Callable[[float], float], period: float, duration: float, ceiling=NEVER):
    """Pressures and forces at every call, on a plant that answers within a call and cannot exceed `ceiling` [kPa]."""
    applied, pressures, forces = 0.0, [], []
    for call in range(round(duration / period)):
        force = GAIN * applied
        applied = min(made.command(set_point(call * period) - force, applied, period), ceiling)
        forces.append(force)
        pressures.append(applied)
    return np.array(pressures), np.array(forces)


def test_integral_action_removes_a_fixed_share_per_call() -> None:
    """Plant F(n+1) = k p(n), integral action alone: the error shrinks by the factor 1 - k K_i T at every call."""
    period, integral = 0.01, 0.25
    _, forces = fingers(regulator(0.0, integral), lambda time: 100.0, period, 0.5)
    shares = 1.0 - GAIN * integral * period
    np.testing.assert_allclose(100.0 - forces, 100.0 * shares ** np.arange(len(forces)), rtol=1e-9)


def test_step_response_has_the_designed_time_constant() -> None:
    """Plant T dF/dt = k p - F with K_p = T / (k T_c), K_i = 1 / (k T_c): F = S (1 - exp(-t / T_c)), no overshoot.

    The zero of the regulator cancels the plant's pole; sampling every 1 ms leaves an error of the order of 1 ms / T_c.
    """
    plant_time, wanted_time, period, set_point = 0.05, 0.2, 1e-3, 500.0
    made = regulator(plant_time / (GAIN * wanted_time), 1.0 / (GAIN * wanted_time))
    applied, force, largest = 0.0, 0.0, 0.0
    for call in range(2000):
        expected = set_point * (1.0 - math.exp(-call * period / wanted_time))
        largest = max(largest, abs(force - expected))
        applied = made.command(set_point - force, applied, period)
        force += (GAIN * applied - force) * (1.0 - math.exp(-period / plant_time))
    assert largest < 0.01 * set_point
    assert force == pytest.approx(set_point, rel=1e-3)


@pytest.mark.parametrize("of_scene", [False, True])
def test_it_leaves_a_limit_at_once_however_long_it_was_there(of_scene: bool) -> None:
    """Ten seconds at a limit of 50 kPa (2000 mN) with 4000 mN wanted, then 1000 mN: as fast as if nothing had been.

    Without back-calculation the integral would have grown by 0.16 * 2000 * 10 = 3200 kPa, and would need as long again.
    """
    settings = GraspSettings()
    made = regulator(settings.proportional_gain, settings.integral_gain, highest=NEVER if of_scene else 50.0)
    pressures, forces = fingers(made, lambda time: 4000.0 if time < 10.0 else 1000.0, 0.01, 11.5, ceiling=50.0)
    assert pressures[:1000].max() == 50.0 and forces[999] == 2000.0
    after = forces[1000:]
    assert after.min() > 0.9 * 1000.0  # it does not fall far below the set point
    assert (abs(after[80:] - 1000.0) < 20.0).all()  # and is there within 0.8 s, five time constants


def test_it_starts_from_the_pressure_that_it_takes_over() -> None:
    made = regulator(0.005, 0.16)
    made.start(30.0, 250.0)
    assert made.command(250.0, 30.0, 1e-6) == pytest.approx(30.0, abs=1e-4)


@given(
    errors=st.lists(st.floats(-5000.0, 5000.0), min_size=1, max_size=60),
    period=st.floats(0.001, 0.1),
    rate=st.floats(1.0, 500.0),
)
def test_pressure_keeps_its_range_and_rate(errors: list[float], period: float, rate: float) -> None:
    made, applied = regulator(0.005, 0.16, rate=rate, highest=105.0), 0.0
    for error in errors:
        asked = made.command(error, applied, period)
        assert 0.0 <= asked <= 105.0
        assert abs(asked - applied) <= rate * period * (1.0 + 1e-12)
        applied = asked


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02, 0.05])
@pytest.mark.parametrize("gain", [20.0, 40.0, 60.0, 90.0])
def test_tuning_settles_for_all_fingers_and_periods(gain: float, period: float) -> None:
    """20 to 50 mN/kPa with the coarse mesh, to 90 with the medium one; some 80 % of an answer come within a step."""
    settings = GraspSettings()
    made = regulator(settings.proportional_gain, settings.integral_gain, rate=settings.pressure_rate, highest=105.0)
    applied = pressed = highest = 0.0
    for _ in range(round(4.0 / period)):
        force = gain * pressed
        highest = max(highest, force)
        applied = made.command(800.0 - force, applied, period)
        pressed += (applied - pressed) * (1.0 - math.exp(-period / 0.01))
    assert force == pytest.approx(800.0, rel=0.01)
    assert highest < 1.35 * 800.0


# The lift's profile, and the set point that grows when the object slips, against their definitions.


def heights(profile: LiftProfile, period: float, count: int) -> np.ndarray:
    return np.array([profile.advance(period, waits=False) for _ in range(count)])


def test_the_lift_is_the_minimum_jerk_profile() -> None:
    """Half way at half time; fastest there, with 15/8 of the mean speed; no speed and no acceleration at both ends."""
    period = 1e-4
    way = heights(LiftProfile(5.0, 35.0, 2.0, 0.1), period, 25000)
    speed = np.diff(way) / period
    assert way[9999] == pytest.approx(20.0, abs=1e-9)
    assert speed.max() == pytest.approx(15.0 / 8.0 * 30.0 / 2.0, rel=1e-6)
    assert abs(np.argmax(speed) - 10000) <= 10  # the maximum is flat
    assert (way[20000:] == 35.0).all() and (speed >= -1e-9).all()
    for end in (slice(0, 20), slice(19970, 19999)):
        assert abs(speed[end]).max() < 1e-3
        assert abs(np.diff(speed[end]) / period).max() < 1.0  # against 43 mm/s^2 on the way


@given(periods=st.lists(st.floats(1e-3, 0.2), min_size=1, max_size=40))
def test_the_lift_does_not_depend_on_when_it_is_asked(periods: list[float]) -> None:
    asked, once = LiftProfile(0.0, 30.0, 2.0, 0.1), LiftProfile(0.0, 30.0, 2.0, 0.1)
    for period in periods:
        height = asked.advance(period, waits=False)
    assert height == pytest.approx(once.advance(sum(periods), waits=False), abs=1e-9)


def test_a_lift_that_waits_comes_to_rest_and_goes_on_from_there() -> None:
    """It stops within the time constant T of waiting: after v T more, with what is left of v falling by exp(-t/T)."""
    profile, period = LiftProfile(0.0, 30.0, 2.0, 0.1), 1e-3
    way = heights(profile, period, 1000)
    speed = (way[-1] - way[-2]) / period
    stopped = np.array([profile.advance(period, waits=True) for _ in range(2000)])
    assert stopped[-1] - way[-1] == pytest.approx(0.1 * speed, rel=0.02)
    assert stopped[-1] - stopped[1000] < 1e-3
    rest = heights(profile, period, 1500)
    assert not any(later < earlier for earlier, later in itertools.pairwise(rest))
    assert rest[-1] == 30.0 and profile.finished


def slipping(force: float, slip_speed: float) -> SensedGrasp:
    return SensedGrasp(0.0, 50.0, force, (), slip_speed, False, 0.0, 0.0)


def made(force: float) -> GripSetPoint:
    return GripSetPoint(force, margin=1.5, slip_speed=1.0)


def test_the_set_point_stays_while_nothing_slips() -> None:
    set_point = made(500.0)
    assert not any(set_point.watch(slipping(force, 0.9), can_follow=True) for force in (0.0, 500.0, 900.0))
    assert (set_point.force, set_point.raised_count) == (500.0, 0)


@examples(40)
@given(needed=st.floats(10.0, 5000.0), share=st.floats(0.02, 1.0))
def test_slipping_object_is_held_with_the_margin(needed: float, share: float) -> None:
    """The force follows by a share of the error at each call; the object slips whenever the force is below `needed`.

    The last force at which it slips lies below `needed`, by no more than the force grows from one call to the next.
    """
    set_point, force = made(400.0), 400.0
    for _ in range(1000):
        set_point.watch(slipping(force, 5.0 if force < needed else 0.0), can_follow=True)
        force += share * (set_point.force - force)
    least = 1.5 * needed / (1.0 + 0.5 * share) if needed > 400.0 else 0.0
    assert max(400.0, least * (1.0 - 1e-9)) <= set_point.force <= max(400.0, 1.5 * needed)
    assert set_point.raised_count == (needed > 400.0)  # once, however long it slipped


def test_force_that_cannot_follow_keeps_the_set_point() -> None:
    set_point = made(500.0)
    assert set_point.watch(slipping(490.0, 5.0), can_follow=False)
    assert set_point.force == 500.0
