"""What overlaps at the start of a step is moved apart without being thrown."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, silicone, simulate

STEP = 0.01
DEPTH = 1.4


@pytest.mark.parametrize("tilt", [0.0, 20.0], ids=["flat", "on an edge"])
def test_a_sunken_box_comes_out_and_rests(figures: Figures, tilt: float) -> None:
    """In one step it stands where it should, and its velocity is 0: at 140 mm/s it would be thrown 1 mm high.

    Tolerances: the solver's 1e-5 mm/s, and the turn of a tilted box in the shift, which is linear, (depth / size)^2.
    """
    half = np.array([10.0, 10.0, 10.0])
    lowest = half @ np.abs([np.sin(np.radians(tilt)), 0.0, np.cos(np.radians(tilt))])
    box = {"box": [20] * 3, "mass": 0.01, "rotation": [0, tilt, 0], "position": [0, 0, lowest + CONTACT_DISTANCE]}
    simulation = simulate(STEP, rigid_bodies={"box": box}, obstacles={"floor": FLOOR})
    sunk = np.array([[0.0, 0.0, lowest + CONTACT_DISTANCE - DEPTH]])
    simulation.restore(replace(simulation.state, rigid_position=sunk))
    report = simulation.step()
    assert report.max_penetration == pytest.approx(DEPTH)
    assert report.deepest == ("box", "floor")
    figures.at_most("speed afterwards [mm/s]", np.abs(simulation.state.rigid_velocity).max(), 1e-4)
    figures.at_most("depth left [mm]", simulation.step().max_penetration, 1e-9 if tilt == 0.0 else DEPTH**2 / 20)


def test_with_depth_by_velocity_it_is_thrown_as_in_sofa() -> None:
    """depth / h, and the speed stays."""
    box = {"box": [20] * 3, "mass": 0.01, "position": [0, 0, 10 + CONTACT_DISTANCE]}
    simulation = simulate(STEP, rigid_bodies={"box": box}, obstacles={"floor": FLOOR}, contact={"depth": "velocity"})
    sunk = np.array([[0.0, 0.0, 10 + CONTACT_DISTANCE - DEPTH]])
    simulation.restore(replace(simulation.state, rigid_position=sunk))
    for _ in range(3):
        simulation.step()
        assert simulation.state.rigid_velocity[0, 2] == pytest.approx(DEPTH / STEP)


def test_a_stack_that_sank_comes_out_together() -> None:
    """Three boxes, each 0.4 mm into what is below: all gaps are right after one step, and nothing moves."""
    box = {"box": [20] * 3, "mass": 0.01}
    pitch = 20 + CONTACT_DISTANCE
    bodies = {name: {**box, "position": [0, 0, pitch * k + 11]} for k, name in enumerate(("low", "middle", "high"))}
    simulation = simulate(STEP, (0.0, 0.0, -GRAVITY), rigid_bodies=bodies, obstacles={"floor": FLOOR})
    simulation.restore(
        replace(simulation.state, rigid_position=simulation.state.rigid_position - [[0, 0, 0.4 * k] for k in (1, 2, 3)])
    )
    simulation.step()
    np.testing.assert_allclose(simulation.state.rigid_position[:, 2], pitch * np.arange(3) + 11, atol=1e-4)
    np.testing.assert_allclose(simulation.state.rigid_velocity, 0.0, atol=1e-3)


def test_a_soft_block_that_sank_comes_out(block: Callable[..., str], figures: Figures) -> None:
    """Its faces leave the floor at once; then it rests, and presses with its weight, to 1e-3."""
    body = silicone(block((2, 2, 2), (20.0, 20.0, 20.0)), translation=[0, 0, 10 + CONTACT_DISTANCE])
    simulation = simulate(STEP, (0.0, 0.0, -GRAVITY), soft_bodies={"block": body}, obstacles={"floor": FLOOR})
    advance(simulation, 0.5)
    simulation.restore(replace(simulation.state, position=simulation.state.position - [0, 0, 0.5]))
    assert simulation.step().max_penetration == pytest.approx(0.5, abs=1e-3)
    figures.at_most("depth left [mm]", simulation.step().max_penetration, 1e-3)
    speeds = [np.abs(simulation.state.velocity).max()]
    report = advance(simulation, 0.5)
    figures.at_most("speed after the shift [mm/s]", speeds[0], 5.0)
    weight = 8e-3 * GRAVITY
    figures.close("force [mN]", report.observation.normal_forces["block", "floor"], weight, 1e-3 * weight)
