"""Cables: limits between what is requested and what happens, and their paths without kernels."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cable_block import LINK, TENDON, run_cables

from taichisoft import Control, Simulation
from taichisoft.mechanics import segment_efforts
from taichisoft.scene import scene_from_dict

# The limits of a scene and of a cable stand between the pull or tension asked for and what happens.

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


def test_pull_is_reached_at_its_speed_without_repetition(limited: Callable[..., Simulation]) -> None:
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


# Paths of cables without kernels: where their points are, and how friction shares out the tension between them.


def test_points_have_the_length_that_the_engine_found(tmp_path: Path) -> None:
    """With a base that has turned, a cube that has moved and a pull point that was moved along."""
    simulation = run_cables(tmp_path)
    model, state = simulation.model, simulation.state
    paths = model.cables.lines
    assert [path.name for path in paths] == list(model.cables.names) == [TENDON, LINK]
    points = [path.points(state, model.frames) for path in paths]
    lengths = [np.linalg.norm(np.diff(one, axis=0), axis=1).sum() for one in points]
    assert lengths == pytest.approx(state.actuator_value.tolist(), rel=1e-12)
    np.testing.assert_array_equal(points[0][0], model.placed_pull_points(state)[0])
    assert np.linalg.norm(points[0][0] - model.cables.rest_pull_point[0]) > 1.0, "the base has moved it"
    on_cube = points[1][1] - state.rigid_position[0]
    assert np.linalg.norm(on_cube) == pytest.approx(np.hypot(5.0, 2.0))
    assert np.linalg.norm(on_cube - [-5.0, 0.0, 2.0]) > 0.01, "the cube has turned"


def test_points_at_the_start_are_those_of_the_scene(tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    model = simulation.model
    for path, cable in zip(model.cables.lines, model.cables.all, strict=True):
        np.testing.assert_allclose(path.points(model.initial_state(), model.frames), cable.rest_point, atol=1e-12)
        assert path.rest_length == cable.rest_length


def test_the_tension_beyond_a_point_is_what_friction_leaves(tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    state, paths = simulation.state, simulation.model.cables.lines
    rubbing, smooth = segment_efforts(paths, state.actuator_effort, state.actuator_loss)
    assert rubbing.tolist() == pytest.approx(
        [state.actuator_effort[0] - state.actuator_loss[:count].sum() for count in range(4)]
    )
    assert rubbing[-1] < 0.95 * rubbing[0]
    assert smooth.tolist() == pytest.approx([60.0])
    twice = segment_efforts(paths, np.stack([state.actuator_effort] * 2), np.stack([state.actuator_loss] * 2))
    np.testing.assert_array_equal(twice[0], [rubbing, rubbing])
