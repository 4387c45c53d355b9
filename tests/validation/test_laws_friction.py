"""Coulomb's law for a rigid block on a plane."""

import math

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, simulate

from taichisoft import Simulation

FRICTION = 0.5
CRITICAL = math.degrees(math.atan(FRICTION))
SIDE = 20.0
HEIGHT = SIDE / 2 + CONTACT_DISTANCE
CREEP = 1e-4  # [mm/s]: ten times the solver's tolerance


def _on_incline(degrees: float, tilt_plane: bool) -> tuple[Simulation, np.ndarray]:
    """A block at rest on an incline, by a tilted plane or by tilted gravity; and the direction downhill."""
    angle = math.radians(degrees)
    box = {"box": [SIDE] * 3, "mass": 0.01}
    contact = {"friction": FRICTION}
    if not tilt_plane:
        gravity = (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))
        bodies = {"block": {**box, "position": [0, 0, HEIGHT]}}
        simulation = simulate(gravity=gravity, rigid_bodies=bodies, obstacles={"floor": FLOOR}, contact=contact)
        return simulation, np.array([1.0, 0.0, 0.0])
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    plane = {"plane": {"point": [3, 4, 5], "normal": (2 * normal).tolist()}}
    place = {"position": (np.array([3, 4, 5]) + HEIGHT * normal).tolist(), "rotation": [0, degrees, 0]}
    gravity = (0.0, 0.0, -GRAVITY)
    bodies = {"block": {**box, **place}}
    simulation = simulate(gravity=gravity, rigid_bodies=bodies, obstacles={"floor": plane}, contact=contact)
    return simulation, np.array([normal[2], 0.0, -normal[0]])


@pytest.mark.parametrize("tilt_plane", [False, True], ids=["tilted gravity", "tilted plane"])
def test_a_block_sticks_below_the_angle_of_friction(figures: Figures, tilt_plane: bool) -> None:
    """It sticks if tan t < mu: half a degree below, it creeps by less than 1e-4 mm/s, ten times the tolerance to
    which the solver knows any velocity."""
    simulation, _ = _on_incline(CRITICAL - 0.5, tilt_plane)
    advance(simulation, 0.1)
    start = simulation.state.rigid_position[0]
    report = advance(simulation, 1.0)
    figures.at_most("creep [mm/s]", np.abs(simulation.state.rigid_position[0] - start).max(), CREEP)
    weight = 0.01 * GRAVITY
    normal = weight * math.cos(math.radians(CRITICAL - 0.5))
    assert report.observation.normal_forces["block", "floor"] == pytest.approx(normal, rel=1e-6)


@pytest.mark.parametrize("tilt_plane", [False, True], ids=["tilted gravity", "tilted plane"])
def test_a_block_slides_above_the_angle_of_friction(figures: Figures, tilt_plane: bool) -> None:
    """It slides if tan t > mu: half a degree above, with a = g (sin t - mu cos t).

    Implicit Euler from rest gives v = a T to round-off; tolerance 1e-4: the solver's 1e-5 mm/s per step.
    """
    simulation, downhill = _on_incline(CRITICAL + 0.5, tilt_plane)
    advance(simulation, 0.5)
    angle = math.radians(CRITICAL + 0.5)
    expected = GRAVITY * (math.sin(angle) - FRICTION * math.cos(angle)) * 0.5
    velocity = simulation.state.rigid_velocity[0] @ downhill
    figures.close("velocity after 0.5 s [mm/s]", velocity, expected, 1e-4 * expected)


def test_a_sliding_block_stops_after_its_stopping_distance(figures: Figures) -> None:
    """v0^2 / (2 mu g); Euler's sum of h v after each step falls short by h v0 / 2 (and less than h^2 mu g more).

    The discrete sum itself must be met to 1e-4 mm, the solver's tolerance.
    """
    speed, step = 200.0, 0.001
    block = {"box": [SIDE] * 3, "mass": 0.01, "position": [0, 0, HEIGHT], "velocity": [0, speed, 0]}
    simulation = simulate(
        step=step,
        gravity=(0.0, 0.0, -GRAVITY),
        rigid_bodies={"block": block},
        obstacles={"floor": FLOOR},
        contact={"friction": FRICTION},
    )
    advance(simulation, 0.1)
    distance = simulation.state.rigid_position[0, 1]
    deceleration = FRICTION * GRAVITY
    law = speed**2 / (2 * deceleration)
    figures.close("stopping distance [mm]", distance, law, step * speed / 2 + step**2 * deceleration)
    speeds = np.maximum(speed - step * deceleration * np.arange(1, 100), 0.0)
    figures.close("the same, summed over the steps [mm]", distance, step * speeds.sum(), 1e-4)
    assert np.abs(simulation.state.rigid_velocity).max() < CREEP


def test_the_friction_of_a_pair_wins(figures: Figures) -> None:
    """Without friction between block and floor, the block keeps its velocity; tolerance: the solver's."""
    block = {"box": [SIDE] * 3, "mass": 0.01, "position": [0, 0, HEIGHT], "velocity": [0, 100, 0]}
    contact = {"friction": 0.9, "pairs": [{"bodies": ["floor", "block"], "friction": 0.0}]}
    gravity = (0.0, 0.0, -GRAVITY)
    simulation = simulate(gravity=gravity, rigid_bodies={"block": block}, obstacles={"floor": FLOOR}, contact=contact)
    advance(simulation, 0.5)
    figures.close("velocity after 0.5 s [mm/s]", simulation.state.rigid_velocity[0, 1], 100.0, 1e-3)
