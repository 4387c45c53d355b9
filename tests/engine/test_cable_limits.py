"""The limits of a scene and of a cable stand between the pull or tension asked for and what happens."""

from collections.abc import Callable
from typing import Any

import pytest

from taichisoft import Control, Simulation
from taichisoft.scene import scene_from_dict

STEP = 0.01
CABLE = "block.tendon"


@pytest.fixture
def limited(block: Callable[..., str]) -> Callable[..., Simulation]:
    """Makes a simulation of a block held at one end, with a cable of the given keys, and limits."""

    def make(limits: dict[str, float], **cable: Any) -> Simulation:
        body = {
            "mesh": block((4, 2, 2), (40.0, 10.0, 10.0)),
            "mass": 0.01,
            "young_modulus": 500,
            "poisson_ratio": 0.3,
            "anchors": [{"box": [[-20, -5, -5], [-20, 5, 5]]}],
            "cables": {"tendon": {"points": [[-15.0, 0.0, 4.0], [0.0, 0.0, 4.0], [18.0, 0.0, 4.0]], **cable}},
        }
        scene = {"gravity": [0, 0, 0], "time": {"step": STEP}, "soft_bodies": {"block": body}, "limits": limits}
        return Simulation(scene_from_dict(scene))

    return make


def targets(simulation: Simulation, controls: list[Control]) -> list[float]:
    """What is driven for after each step [mm] or [mN]."""
    values = []
    for control in controls:
        simulation.step(control)
        values.append(float(simulation.state.actuator_target[0]))
    return values


def test_a_pull_is_reached_at_its_speed_also_when_it_is_not_repeated(limited: Callable[..., Simulation]) -> None:
    """20 mm/s are 0.2 mm in a step; a cable is paid out no faster. So fast a step is linear to 0.01 mm."""
    simulation = limited({"pull_speed": 20.0})
    asked = [Control(cable_pull={CABLE: 0.5}), Control(), Control(), Control(), Control(cable_pull={CABLE: 0.0})]
    assert targets(simulation, asked) == pytest.approx([0.2, 0.4, 0.5, 0.5, 0.3])
    assert simulation.observe().clipped == (CABLE,)
    assert simulation.observe().cable_pulls[CABLE] == pytest.approx(0.3, abs=1e-2)


def test_a_tension_rises_and_falls_at_its_rate(limited: Callable[..., Simulation]) -> None:
    simulation = limited({"tension_rate": 10000.0})
    asked = [Control(cable_tension={CABLE: 250.0}), Control(), Control(), Control(cable_tension={CABLE: 0.0})]
    assert targets(simulation, asked) == pytest.approx([100.0, 200.0, 250.0, 150.0])
    assert simulation.observe().cable_tensions[CABLE] == pytest.approx(150.0)


def test_a_cable_s_own_range_clips_what_is_asked_for(limited: Callable[..., Simulation]) -> None:
    simulation = limited({}, lowest_pull=-1.0, highest_pull=2.0, highest_tension=300.0)
    asked = [Control(cable_pull={CABLE: pull}) for pull in (5.0, -5.0, 1.0)]
    assert targets(simulation, asked) == [2.0, -1.0, 1.0]
    assert simulation.observe().clipped == ()
    assert targets(simulation, [Control(cable_tension={CABLE: 500.0})]) == [300.0]
    assert simulation.observe().clipped == (CABLE,)


def test_one_way_to_drive_goes_on_from_where_the_other_has_led(limited: Callable[..., Simulation]) -> None:
    """From the pull that a tension gave, at the pull's speed; and from the tension that this takes, at its rate."""
    simulation = limited({"tension_rate": 10000.0, "pull_speed": 10.0})
    targets(simulation, [Control(cable_tension={CABLE: 200.0})] * 30)
    pull = simulation.observe().cable_pulls[CABLE]
    assert pull > 0.2
    assert targets(simulation, [Control(cable_pull={CABLE: 5.0})]) == pytest.approx([pull + 0.1])
    targets(simulation, [Control()] * 20)
    tension = simulation.observe().cable_tensions[CABLE]
    assert targets(simulation, [Control(cable_tension={CABLE: 0.0})]) == pytest.approx([tension - 100.0])
