"""Bodies at rest weigh what they weigh."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, silicone, simulate

DOWN = (0.0, 0.0, -GRAVITY)
EXACT = 1e-6
"""Share of the weight: ten times what the solver's 1e-5 mm/s is of g h = 98 mm/s."""


def _resting_on(below: float, side: float) -> float:
    """Height of the centre of a box that rests on something of height `below` [mm]."""
    return below + CONTACT_DISTANCE + side / 2


def test_a_rigid_block_weighs_its_weight(figures: Figures) -> None:
    """The sum of its contacts' normal forces is m g, and their moment is zero: it lies still."""
    block = {"box": [20, 20, 20], "mass": 0.01, "position": [1, 2, _resting_on(0, 20)]}
    simulation = simulate(gravity=DOWN, rigid_bodies={"block": block}, obstacles={"floor": FLOOR})
    report = advance(simulation, 0.5)
    weight = 0.01 * GRAVITY
    figures.close("normal force [mN]", report.observation.normal_forces["block", "floor"], weight, EXACT * weight)
    assert report.contact_count == 4
    assert np.abs(simulation.state.rigid_position[0] - [1, 2, _resting_on(0, 20)]).max() < 1e-4


@pytest.mark.parametrize(("side", "turn"), [(20, 0), (16, 0), (16, 30), (30, 10)])
def test_a_stack_weighs_floor_by_floor(figures: Figures, side: float, turn: float) -> None:
    """Upper on lower block: m2 g; lower on the floor: (m1 + m2) g. Equal, smaller, turned and overhanging blocks,
    so that corners meet faces, edges cross edges, or both coincide."""
    lower = {"box": [20, 20, 20], "mass": 0.02, "position": [0, 0, _resting_on(0, 20)]}
    above = _resting_on(20 + CONTACT_DISTANCE, side)
    upper = {"box": [side] * 3, "mass": 0.01, "position": [0, 0, above], "rotation": [0, 0, turn]}
    bodies = {"lower": lower, "upper": upper}
    simulation = simulate(gravity=DOWN, rigid_bodies=bodies, obstacles={"floor": FLOOR})
    report = advance(simulation, 0.5)
    for pair, mass in ((("lower", "upper"), 0.01), (("lower", "floor"), 0.03)):
        figures.close(
            f"force of {pair} [mN]", report.observation.normal_forces[pair], mass * GRAVITY, EXACT * mass * GRAVITY
        )
    figures.at_most("motion of the upper block [mm]", abs(simulation.state.rigid_position[1, 2] - above), 1e-4)


@pytest.mark.parametrize("corotation", ["edges", "polar"])
def test_a_soft_block_weighs_its_weight(block: Callable[..., str], figures: Figures, corotation: str) -> None:
    """After half a second, 25 times its longest relaxation; 1e-5 of the weight remains of the motion."""
    mesh, place = block((3, 3, 3), (20.0, 20.0, 20.0)), [0, 0, _resting_on(0, 20)]
    body = silicone(mesh, translation=place, element="linear", corotation=corotation)
    simulation = simulate(gravity=DOWN, soft_bodies={"block": body}, obstacles={"floor": FLOOR})
    report = advance(simulation, 0.5)
    weight = 1e-6 * 20**3 * GRAVITY
    figures.close("normal force [mN]", report.observation.normal_forces["block", "floor"], weight, 1e-5 * weight)
    lowest = simulation.state.position[:, 2].min()
    figures.close("lowest point [mm]", lowest, CONTACT_DISTANCE, 1e-4)


def test_a_rigid_block_on_a_soft_one_on_the_floor(block: Callable[..., str], figures: Figures) -> None:
    """m2 g between them, (m1 + m2) g below; every contact is kept (spacing 0).

    Tolerance 1e-4: the solver stops when a sweep changes no velocity by more than 1e-5 mm/s, and with 45 contacts on
    soft ground the error left may be a hundred times the last change.
    """
    body = silicone(block((3, 3, 2), (20.0, 20.0, 10.0)), translation=[0, 0, _resting_on(0, 10)])
    cube = {"box": [12, 12, 12], "mass": 0.004, "position": [0, 0, _resting_on(10 + CONTACT_DISTANCE, 12)]}
    simulation = simulate(
        gravity=DOWN,
        soft_bodies={"mat": body},
        rigid_bodies={"cube": cube},
        obstacles={"floor": FLOOR},
        contact={"spacing": 0},
    )
    report = advance(simulation, 0.5)
    for pair, mass in ((("mat", "cube"), 0.004), (("mat", "floor"), 0.008)):
        figures.close(
            f"force of {pair} [mN]", report.observation.normal_forces[pair], mass * GRAVITY, 1e-4 * mass * GRAVITY
        )
