"""What stands stands, up to its angle: a box on an incline, cards that lean on each other, and a house of them."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import FLOOR, GRAVITY, simulate

from taichisoft import Simulation

CLOSE = {"contact_distance": 0.1, "alarm_distance": 1.0}


@pytest.mark.parametrize(("excess", "falls"), [(-0.05, False), (0.05, True)])
@pytest.mark.parametrize("step", [0.01, 0.002])
def test_a_box_topples_at_its_angle(figures: Figures, excess: float, falls: bool, step: float) -> None:
    """It tips over its lower edge if tan t > width / height; 0.05 degrees on either side of it, with friction enough.

    Beyond, its tilt grows by e in sqrt(I / (m g r)) = 0.06 s, and a thousandth of it is a degree after 0.6 s.
    """
    width, height = 20.0, 40.0
    angle = math.degrees(math.atan(width / height)) + excess
    radians = math.radians(angle)
    box = {"box": [width, 30.0, height], "mass": 0.05, "position": [0, 0, height / 2 + CLOSE["contact_distance"]]}
    simulation = simulate(
        step=step,
        gravity=(GRAVITY * math.sin(radians), 0.0, -GRAVITY * math.cos(radians)),
        rigid_bodies={"box": box},
        obstacles={"floor": FLOOR},
        contact={**CLOSE, "friction": 2.0},
    )
    _advance(simulation, 1.0)
    tilt = 2 * math.degrees(math.acos(min(abs(simulation.state.rigid_rotation[0, 0]), 1.0)))
    if falls:
        assert tilt > 1.0
    else:
        figures.at_most("tilt after a second [degrees]", tilt, 0.001)


LENGTH, THICKNESS, LEAN = 60.0, 1.0, 25.0
"""Of the cards [mm], and their angle with the vertical [degrees]."""


@pytest.mark.parametrize(("share", "stand"), [(1.06, True), (0.94, False)])
def test_two_cards_lean_on_each_other_if_the_floor_is_rough_enough(share: float, stand: bool) -> None:
    """Moments about a card's foot: they press on each other with H = m g tan(t) / 2, and the floor holds H = mu m g.

    So they stand if mu > tan(t) / 2. A card's thickness moves its weight and its foot by up to its half: 1 mm of the
    lever of 25 mm, 4 % of the friction, is the reason for 6 % on either side.
    """
    friction = share * math.tan(math.radians(LEAN)) / 2
    bodies = {"left": _card(LEAN, 0.0, 0.0), "right": _card(-LEAN, 0.0, 0.0, 36.0)}
    simulation = _house(bodies, friction)
    before = simulation.state.rigid_position[:, 2].copy()
    _advance(simulation, 1.0)
    sunk = (before - simulation.state.rigid_position[:, 2]).max()
    assert sunk < 0.2 if stand else sunk > 2.0


def test_a_house_of_cards_stands(figures: Figures) -> None:
    """Two pairs, a card across their tops, and a pair on that: seven cards that all lean on friction.

    They settle by what the gaps between them leave, and move no more: below 0.01 mm in the last half second.
    """
    top = LENGTH * math.cos(math.radians(LEAN)) + THICKNESS * math.sin(math.radians(LEAN)) + 0.3
    across = 2 * LENGTH * math.sin(math.radians(LEAN)) + 4.0
    bodies = {}
    for name, x, z in (("first", 0.0, 0.0), ("second", across, 0.0), ("upper", across / 2, top + THICKNESS + 0.3)):
        bodies[f"{name}_left"] = _card(LEAN, x, z)
        bodies[f"{name}_right"] = _card(-LEAN, x, z, 36.0)
    ceiling = {"box": [across + 60.0, 40.0, THICKNESS], "mass": 0.004}
    bodies["ceiling"] = {**ceiling, "position": [across / 2, 0, top + THICKNESS / 2]}
    simulation = _house(bodies, 0.6)
    _advance(simulation, 1.0)
    before = simulation.state.rigid_position.copy()
    _advance(simulation, 0.5)
    figures.at_most("motion [mm]", float(np.abs(simulation.state.rigid_position - before).max()), 0.01)
    assert simulation.state.rigid_position[-1, 2] > top - 1.0


def _card(lean: float, x: float, z: float, width: float = 40.0) -> dict[str, Any]:
    """A card whose upper inner edge is 0.05 mm beside the plane x, and whose lowest edge is 0.1 mm above z."""
    radians = math.radians(lean)
    turn = np.array([[math.cos(radians), math.sin(radians)], [-math.sin(radians), math.cos(radians)]])
    corners = np.array([[s * THICKNESS, t * LENGTH] for s in (-1, 1) for t in (-1, 1)]) / 2 @ turn.T
    inner = corners[:, 0].max() if lean > 0 else corners[:, 0].min()
    place = [x - math.copysign(0.05, lean) - inner, 0.0, z + 0.1 - corners[:, 1].min()]
    return {"box": [THICKNESS, width, LENGTH], "mass": 0.002, "rotation": [0, lean, 0], "position": place}


def _house(bodies: dict[str, dict[str, Any]], friction: float) -> Simulation:
    return simulate(
        step=0.005,
        gravity=(0.0, 0.0, -GRAVITY),
        rigid_bodies=bodies,
        obstacles={"floor": FLOOR},
        contact={**CLOSE, "friction": friction},
    )


def _advance(simulation: Simulation, seconds: float) -> None:
    for _ in range(round(seconds / simulation.model.scene.time.step)):
        assert simulation.step().converged
