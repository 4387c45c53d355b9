"""Inverse statics: what known equilibria were made with is found again, and what is out of reach is said."""

import re
from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Simulation, equilibrium, inverse, load_scene
from taichisoft.errors import ControlError, EquilibriumNotFound, TaichisoftError
from taichisoft.pytest_fixtures import TINY_GRIPPER

WALL = (
    "rigid_bodies={}",
    "limits={highest_pressure=1000.0}",
    "obstacles={wall={box=[10.0, 40.0, 40.0], translation=[0.0, 0.0, 20.0]}}",
)
LEFT = {"pressure.left.cavity": (0.0, 20.0)}
BOTH = {**LEFT, "pressure.right.cavity": (0.0, 20.0)}


@pytest.fixture(scope="module")
def pads() -> Simulation:
    """Two pads on both sides of a wall, which they touch at 7 kPa, without friction."""
    return Simulation(load_scene(TINY_GRIPPER, (*WALL, "contact.friction=0.0")))


def test_pressures_and_pose_are_found_again(pads: Simulation) -> None:
    """From positions, to 1e-4 mm; the simulation stays where it is."""
    start = pads.state
    asked = Control(pressure={"left.cavity": 5.0}, base_translation=np.array([0.3, 0.0, -0.4]))
    tip = equilibrium(pads, asked).observation.tip_positions["left"]
    bounds = {"pressure.left.cavity": (0.0, 6.0), "base_translation.z": (-1.0, 1.0)}
    pads.restore(equilibrium(pads, Control(base_translation=np.array([0.3, 0.0, 0.0]))).state)
    found = inverse(pads, {"tip_positions.left": tip}, bounds)
    assert found.reached and found.message == "reached" and not found.at_bounds and found.trials < 15
    assert found.values == pytest.approx({"pressure.left.cavity": 5.0, "base_translation.z": -0.4}, abs=1e-4)
    assert found.control.base_translation is not None and found.control.base_translation[0] == 0.3
    again = equilibrium(pads, found.control).observation.tip_positions["left"]
    np.testing.assert_allclose(again, tip, atol=1e-4)
    assert np.abs(found.residuals["tip_positions.left"]).max() < 1e-4
    pads.restore(start)


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_contact_forces_are_reached_from_where_nothing_touches(pads: Simulation, friction: float) -> None:
    """At rest no force depends on a pressure, so the search begins elsewhere."""
    simulation = Simulation(pads.model.varied(friction=friction))
    wanted = {"normal_forces.left|wall": 200.0, "normal_forces.wall|right": 300.0}
    found = inverse(simulation, wanted, BOTH)
    assert found.reached
    forces = equilibrium(simulation, found.control).observation.normal_forces
    assert forces["left", "wall"] == pytest.approx(200.0, abs=0.01)
    assert forces["right", "wall"] == pytest.approx(300.0, abs=0.01)


def test_targets_out_of_reach_are_approached(pads: Simulation) -> None:
    """Most that the left pad can press is what it presses with at the highest pressure."""
    most = equilibrium(pads, Control(pressure={"left.cavity": 20.0})).observation.normal_forces["left", "wall"]
    found = inverse(pads, {"normal_forces.left|wall": 1e5}, LEFT)
    assert not found.reached and found.at_bounds == ("pressure.left.cavity",)
    assert found.residuals["normal_forces.left|wall"] == pytest.approx(most - 1e5, abs=0.01)
    said = r"not reached, .* normal_forces\.left\|wall is off by .*; at the end of its range: pressure\.left\.cavity"
    assert re.match(said, found.message)


def test_scales_weigh_targets_that_contradict_each_other(pads: Simulation) -> None:
    """One pressure cannot give both forces: sum of ((f - a) / s)^2 is least at a mean weighted by 1 / s^2."""
    both = {"normal_forces.left|wall": 100.0, "base_force": [np.nan, 0.0, np.nan]}
    assert inverse(pads, both, LEFT).reached, "NaN leaves entries free"
    tip = equilibrium(pads, Control(pressure={"left.cavity": 3.0})).observation.tip_positions["left"]
    wanted = {"tip_positions.left": tip, "volumes.left.cavity": pads.observe().volumes["left.cavity"]}
    by_volume = inverse(pads, wanted, LEFT, {"volumes.left.cavity": 1e-3}).values
    by_place = inverse(pads, wanted, LEFT, {"volumes.left.cavity": 1e6}).values
    assert by_volume["pressure.left.cavity"] == pytest.approx(0.0, abs=0.01)
    assert by_place["pressure.left.cavity"] == pytest.approx(3.0, abs=0.01)


def test_pressure_that_nothing_carries_makes_steps_shorter() -> None:
    simulation = Simulation(load_scene(TINY_GRIPPER, ("rigid_bodies={}", "obstacles={}", "limits={}")))
    with pytest.raises(EquilibriumNotFound):
        equilibrium(simulation, Control(pressure={"left.cavity": 1e6}))
    tip = equilibrium(simulation, Control(pressure={"left.cavity": 6.0})).observation.tip_positions["left"]
    found = inverse(simulation, {"tip_positions.left": tip}, {"pressure.left.cavity": (0.0, 1e6)})
    assert found.reached and found.values["pressure.left.cavity"] == pytest.approx(6.0, abs=1e-3)


@pytest.mark.parametrize(
    ("targets", "bounds", "scales", "error", "message"),
    [
        ({}, LEFT, {}, TaichisoftError, "targets: must be a dictionary with a figure or more"),
        ({"volumes.middle": 1.0}, LEFT, {}, TaichisoftError, "volumes has no 'middle'"),
        ({"volumes.left.cavity": [1.0, 2.0]}, LEFT, {}, TaichisoftError, "must be a number, finite or NaN"),
        ({"volumes.left.cavity": np.nan}, LEFT, {}, TaichisoftError, "must be a number, finite or NaN"),
        ({"tip_positions.left": "up"}, LEFT, {}, TaichisoftError, "must be an array of shape (3,), finite or NaN"),
        ({"volumes.left.cavity": 1.0}, {}, {}, ControlError, "bounds: must be a dictionary with a control or more"),
        ({"volumes.left.cavity": 1.0}, {"pressure.left.cavity": (3, 2)}, {}, ControlError, "must be a lowest and a"),
        ({"volumes.left.cavity": 1.0}, {"pressure.left.cavity": 3}, {}, ControlError, "must be a lowest and a higher"),
        ({"volumes.left.cavity": 1.0}, {"pressure.middle": (0, 1)}, {}, ControlError, "no cavity is called 'middle'"),
        ({"volumes.left.cavity": 1.0}, {"force.left.x": (0, 1)}, {}, ControlError, "'force.left.x' is not the name of"),
        ({"volumes.left.cavity": 1.0}, {"base_rotation.w": (0, 1)}, {}, ControlError, "must end with .x, .y or .z"),
        ({"volumes.left.cavity": 1.0}, LEFT, {"volumes.left.cavity": 0}, TaichisoftError, "must be above 0"),
        ({"volumes.left.cavity": 1.0}, LEFT, {"volumes": 1.0}, TaichisoftError, "'volumes' is not a target"),
    ],
)
def test_wrong_arguments_are_refused(
    pads: Simulation, targets: Any, bounds: Any, scales: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=re.escape(message)) as refused:
        inverse(pads, targets, bounds, scales)
    assert "\n" not in str(refused.value)


def test_cube_is_pressed_as_hard_as_it_should_be() -> None:
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    simulation.restore(equilibrium(simulation, Control(pressure={"left.cavity": 9.0, "right.cavity": 9.0})).state)
    wanted = {"normal_forces.left|cube": 150.0, "normal_forces.right|cube": 150.0}
    found = inverse(simulation, wanted, BOTH)
    assert found.reached and abs(found.values["pressure.left.cavity"] - found.values["pressure.right.cavity"]) < 0.01


def test_forces_found_by_motion_are_those_of_steps() -> None:
    """Friction depends on the way: statics go a straight one, and their message says so; steps go another."""
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    wanted = {"normal_forces.left|cube": 200.0, "normal_forces.right|cube": 200.0}
    by_statics, by_motion = (inverse(simulation, wanted, BOTH, by=by) for by in ("statics", "motion"))
    assert by_statics.message.startswith("reached; friction depends on the way") and by_motion.message == "reached"
    assert simulation.observe().time == 0.0
    for _ in range(600):
        simulation.step(by_motion.control)
    forces = simulation.observe().normal_forces
    assert [forces["left", "cube"], forces["right", "cube"]] == pytest.approx([200.0, 200.0], abs=0.05)
    with pytest.raises(TaichisoftError, match="by = 'way': must be 'statics' or 'motion'"):
        inverse(simulation, wanted, BOTH, by="way")  # type: ignore[arg-type]
