"""What the closed-loop controller makes of an observation: forces, touch, slip, and heights against gravity."""

from typing import Any

import numpy as np
import pytest
from made_up import made_up_model

from taichisoft import Observation
from taichisoft_controllers.grasp_sensing import GraspSensing, SensedGrasp
from taichisoft_controllers.settings import PRESSURE, PULL

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
