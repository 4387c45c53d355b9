"""The shipped scenes of real silicone run within the range of their materials, and every step converges."""

import warnings
from collections.abc import Iterator

import numpy as np
import pytest

from taichisoft import Control, Simulation, load_scene
from taichisoft.mechanics import Stretches

WEIGHT = 0.02 * 9810.0
FRICTION = 0.6


@pytest.fixture(autouse=True)
def warned() -> Iterator[None]:
    """A warning fails the test; those of libraries do not count."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.filterwarnings("ignore", ".*walls of one element")  # the mesh, which is coarse
        yield


def inflate(simulation: Simulation, pressure: float, rise: float, duration: float) -> None:
    """Let the pressure rise evenly [kPa] in a time [s], and hold it; every step must converge."""
    step = simulation.model.scene.time.step
    for index in range(1, round(duration / step) + 1):
        now = pressure * min(1.0, index * step / rise)
        assert simulation.step(Control(pressure=dict.fromkeys(simulation.model.cavities.names, now))).converged


def within_range(simulation: Simulation) -> bool:
    """No element is stretched beyond the tests that its material was fitted to."""
    elasticity, body = simulation.model.elasticity, simulation.model.soft_bodies[0].settings
    assert elasticity is not None and body.material is not None
    largest = Stretches(elasticity.rest_position, elasticity.elements).largest(simulation.state.position)
    assert largest.max() > 1.2  # more than Hooke's law is good for
    return bool(largest.max() < body.material.highest_stretch)


def test_finger_bends_towards_its_stiff_back() -> None:
    """Smoothed elements follow the fitted law of the named material up to the scene's 40 kPa; the tip goes along +y."""
    simulation = Simulation(load_scene("finger-dragon-skin"))
    inflate(simulation, 40.0, 0.5, 1.0)
    tip = simulation.model.rest_position[:, 0].argmin()
    motion = simulation.state.position[tip] - simulation.model.rest_position[tip]
    assert motion[1] > 15.0
    assert motion[1] > 5.0 * np.abs(motion[2])
    assert within_range(simulation)


def test_gripper_presses_enough_to_lift_its_cube() -> None:
    """At 45 kPa, before the lift: all three fingers touch, and friction carries more than 20 g."""
    simulation = Simulation(load_scene("gripper-dragon-skin"))
    inflate(simulation, 45.0, 1.0, 1.5)
    forces = simulation.observe().normal_forces
    pressing = [force for pair, force in forces.items() if "cube" in pair and pair[0].startswith("finger")]
    assert len(pressing) == 3 and min(pressing) > 0.0
    assert FRICTION * sum(pressing) > 2.0 * WEIGHT
    assert within_range(simulation)
