"""What turns about corners and edges goes on arcs: it stays on the ground, gains no energy, and does not overlap."""

from typing import Any

import numpy as np
import pytest
from conftest import Figures
from energy import total_energy
from scenes import FLOOR, GRAVITY, simulate

from taichisoft import Simulation
from taichisoft.base import matrices_from_quaternions

DISTANCE = 0.1
CLOSE = {"contact_distance": DISTANCE, "alarm_distance": 1.0}
CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
LEFT_OUT = 2e-5
"""Twice the gap for which the row of a contact between rigid bodies stays as it is [mm]."""


def tumbling_box(seed: int, step: float) -> Simulation:
    """A box of 50 g, of 15 to 40 mm, that falls on the floor with up to 300 mm/s and 15 rad/s along each axis."""
    random = np.random.default_rng(seed)
    box = {
        "box": random.uniform(15, 40, 3).tolist(),
        "mass": 0.05,
        "position": [0.0, 0.0, 40.0],
        "rotation": random.uniform(-180, 180, 3).tolist(),
        "velocity": random.uniform(-300, 300, 3).tolist(),
        "angular_velocity": random.uniform(-15, 15, 3).tolist(),
    }
    contact = {**CLOSE, "friction": float(random.uniform(0, 1))}
    return on_the_floor(box, contact, step)


def on_the_floor(box: dict[str, Any], contact: dict[str, Any], step: float) -> Simulation:
    return simulate(step, (0.0, 0.0, -GRAVITY), rigid_bodies={"box": box}, obstacles={"floor": FLOOR}, contact=contact)


def corners_of(simulation: Simulation) -> np.ndarray:
    """Corners of the box [mm], shape (8, 3)."""
    (box,), state = simulation.model.rigid_bodies, simulation.state
    size = np.ptp(box.vertices, axis=0)
    (turn,) = matrices_from_quaternions(state.rigid_rotation)
    return np.asarray(state.rigid_position[0] + CORNERS * size @ turn.T)


@pytest.mark.parametrize("step", [0.01, 0.0025])
def test_corners_that_press_are_on_the_ground_and_energy_never_grows(step: float, figures: Figures) -> None:
    """Neither lifted by the arc (h w)^2 r / 2 = 0.3 mm at 15 rad/s and 10 ms, nor below the floor; in every step.

    A row that is left as it is may give m g 1e-5 mm = 5e-3 mN mm.
    """
    lifts, depths, gains = [], [], []
    for seed in (2, 8, 11):
        simulation = tumbling_box(seed, step)
        before = total_energy(simulation)
        for _ in range(round(0.3 / step)):
            assert simulation.step().converged
            state, corners = simulation.state, corners_of(simulation)
            depths.append(DISTANCE - corners[:, 2].min())
            for point in state.contact_point[np.linalg.norm(state.contact_impulse, axis=1) > 1e-6]:
                pressing = np.linalg.norm(corners - point, axis=1).argmin()
                lifts.append(corners[pressing, 2] - DISTANCE)
            after = total_energy(simulation)
            gains.append(after - before)
            before = after
    figures.at_most("lift [mm]", max(lifts), LEFT_OUT)
    figures.at_most("depth [mm]", max(depths), LEFT_OUT)
    figures.at_most("gain of energy in a step [mN mm]", max(gains), 5e-3)


def test_what_overlaps_and_turns_fast_does_not_sink(figures: Figures) -> None:
    """A cube on its corners 0.01 mm too low turns by 0.9 rad in a step: its corners come down to where they should be.

    What moves the overlap out is found by velocities, and turns it a little further: a tenth of the overlap.
    """
    cube = {"box": [20.0] * 3, "mass": 0.05, "position": [0, 0, 10.09], "angular_velocity": [0.0, 90.0, 0.0]}
    simulation = on_the_floor(cube, CLOSE, 0.01)
    simulation.step()
    figures.at_most("depth [mm]", DISTANCE - corners_of(simulation)[:, 2].min(), 1e-3)


def test_tumbling_dice_that_collide_do_not_overlap(figures: Figures) -> None:
    """Corners against faces and edges against edges, both of which turn."""
    depths = []
    for seed in range(6):
        random = np.random.default_rng(seed)
        dice = {
            name: {
                "box": [20.0] * 3,
                "mass": 0.02,
                "position": [-20.0 * towards, *random.uniform(-8, 8, 2)],
                "rotation": random.uniform(-180, 180, 3).tolist(),
                "velocity": [200.0 * towards, 0.0, 0.0],
                "angular_velocity": random.uniform(-10, 10, 3).tolist(),
            }
            for name, towards in (("one", 1), ("other", -1))
        }
        simulation = simulate(0.005, rigid_bodies=dice, contact={**CLOSE, "friction": float(random.uniform(0, 1))})
        depths += [simulation.step().max_penetration for _ in range(40)]
    figures.at_most("depth [mm]", max(depths), LEFT_OUT)
