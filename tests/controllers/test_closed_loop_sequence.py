"""The phases of a closed-loop grasp on a toy of known friction: what is held, with what force, and what fails why."""

import pytest
from conftest import examples
from hypothesis import example, given
from hypothesis import strategies as st
from toy_grasp import FRICTION, STIFFNESS, STRONGEST, ToyGrasp, failure, run_toy

from taichisoft.errors import ControllerFailed
from taichisoft_controllers.closed_loop import Phase
from taichisoft_controllers.grasp_sensing import GraspSettings

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
@pytest.mark.parametrize("weight", [10.0, 200.0, AT_FIRST / 1.5, 1.2 * AT_FIRST, 1000.0, STRONGEST / 1.8])
def test_a_push_of_half_the_weight_moves_nothing(weight: float, direction: float) -> None:
    """A set point that holds 1.5 times the weight from the first, or was raised when the object slipped."""
    toy, undisturbed = ToyGrasp(weight), ToyGrasp(weight)
    run_toy(toy, TUNING, 12.0, pushes=[(10.0, 10.2, direction * 0.5 * weight)])
    run_toy(undisturbed, TUNING, 12.0)
    assert toy.phases[-1] is Phase.HELD
    assert toy.height == pytest.approx(undisturbed.height, abs=0.1)


def test_a_weight_that_friction_cannot_hold_is_given_up_with_the_reason() -> None:
    message = failure(ToyGrasp(1.2 * STRONGEST), TUNING)
    assert message.startswith("lift failed at ")
    assert "'cube'" in message and "at 105.0 kPa" in message and "\n" not in message


def test_an_object_out_of_reach_is_given_up_with_the_fingers_that_miss_it() -> None:
    message = failure(ToyGrasp(10.0), GraspSettings(highest_pressure=20.0))
    assert message.startswith("approach failed at 0.") and "no contact of finger up to 20 kPa" in message


def test_a_force_that_no_pressure_gives_is_given_up() -> None:
    message = failure(ToyGrasp(10.0), GraspSettings(highest_pressure=40.0, patience=3.0))
    assert "grip failed" in message and "does not settle within 3 s" in message
    assert "press with 600 of 800 mN at 40.0 kPa" in message


def test_an_object_that_is_knocked_out_later_is_reported_as_dropped() -> None:
    toy = ToyGrasp(100.0)
    with pytest.raises(ControllerFailed, match=r"^held failed at 8\.\d+ s: dropped 'cube', which sank by \d\d\.\d mm"):
        run_toy(toy, TUNING, 9.0, pushes=[(8.0, 8.3, -700.0)])


def test_it_puts_the_object_down_and_grasps_again_as_hard_as_it_has_learnt() -> None:
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
