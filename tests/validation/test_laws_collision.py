"""Two bodies that collide: nothing passes through, and momentum is kept."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, rigid_momentum, silicone, simulate, soft_momentum

from taichisoft import Simulation

STEP = 0.005
SPEED = 200.0


def _collide(simulation: Simulation, steps: int = 60) -> tuple[float, float, float]:
    """Deepest reach into the contact distance [mm], largest change of momentum [mN s], most force [mN]."""
    soft = simulation.model.elasticity is not None

    def momentum() -> np.ndarray:
        return rigid_momentum(simulation) + (soft_momentum(simulation) if soft else 0.0)

    before = momentum()
    deepest = drift = force = 0.0
    for _ in range(steps):
        report = simulation.step()
        assert report.converged
        deepest = max(deepest, report.max_penetration)
        drift = max(drift, float(np.abs(momentum() - before).max()))
        force = max(force, sum(report.observation.normal_forces.values()))
    return deepest, drift, force


def _check(figures: Figures, outcome: tuple[float, float, float], momentum: float) -> None:
    """The surfaces never overlap; momentum to 1e-11 of one body's: round-off. And they did meet."""
    deepest, drift, force = outcome
    assert force > 0.0
    figures.at_most("reach into the contact distance [mm]", deepest, CONTACT_DISTANCE)
    figures.at_most("change of momentum, of one body's", drift / momentum, 1e-11)


def _rigid_pair(first: dict[str, Any], second: dict[str, Any]) -> Simulation:
    approaching = {
        "first": {**first, "velocity": [0, 0, SPEED]},
        "second": {**second, "velocity": [0, 0, -SPEED]},
    }
    return simulate(step=STEP, rigid_bodies=approaching)


def test_crossed_bars_meet_edge_to_edge(figures: Figures) -> None:
    """Two bars on edge, crossing at a right angle over their centres: their only contact is of two edges.

    The impulse passes through both centres, so that nothing turns and both of equal mass come to rest.
    """
    half_diagonal = 10 / np.sqrt(2)
    gap = 3.0
    low = {"box": [60, 10, 10], "mass": 0.01, "rotation": [45, 0, 0], "position": [0, 0, 0]}
    high = {"box": [10, 60, 10], "mass": 0.01, "rotation": [0, 45, 0], "position": [0, 0, 2 * half_diagonal + gap]}
    simulation = _rigid_pair(low, high)
    outcome = _collide(simulation)
    assert simulation.report is not None
    assert simulation.report.contact_count == 1
    _check(figures, outcome, 0.01 * SPEED)
    figures.at_most("speed afterwards [mm/s]", np.abs(simulation.state.rigid_velocity).max(), 1e-4)
    figures.at_most("spin afterwards [rad/s]", np.abs(simulation.state.rigid_angular_velocity).max(), 1e-6)
    distance = simulation.state.rigid_position[1, 2] - simulation.state.rigid_position[0, 2] - 2 * half_diagonal
    figures.close("distance of the edges afterwards [mm]", distance, CONTACT_DISTANCE, 1e-4)


@pytest.mark.parametrize(
    ("turn", "shift"), [([0, 0, 0], 0), ([0, 0, 45], 3), ([20, 30, 0], 2), ([45, 35.26, 0], 1)],
    ids=["face to face", "turned", "edge or corner to face", "corner to face"],
)  # fmt: skip
def test_box_against_box(figures: Figures, turn: list[float], shift: float) -> None:
    """Boxes that meet in faces, edges and corners."""
    low = {"box": [20, 20, 20], "mass": 0.01}
    high = {"box": [15, 15, 15], "mass": 0.02, "rotation": turn, "position": [shift, shift, 28]}
    simulation = _rigid_pair(low, high)
    _check(figures, _collide(simulation), 0.01 * SPEED)


def test_soft_against_soft(block: Callable[..., str], figures: Figures) -> None:
    """Two silicone blocks, one turned, so that corners, edges and faces of both touch."""
    mesh = block((3, 3, 3), (20.0, 20.0, 20.0))
    bodies = {
        "first": silicone(mesh, velocity=[0, 0, SPEED]),
        "second": silicone(mesh, velocity=[0, 0, -SPEED], translation=[4, 3, 24], rotation=[10, 5, 30]),
    }
    simulation = simulate(step=STEP, soft_bodies=bodies)
    _check(figures, _collide(simulation), 0.008 * SPEED)


def test_soft_against_rigid(block: Callable[..., str], figures: Figures) -> None:
    """A silicone block against the corner of a box."""
    body = silicone(block((3, 3, 3), (20.0, 20.0, 20.0)), velocity=[0, 0, SPEED])
    box = {"box": [15, 15, 15], "mass": 0.01, "rotation": [45, 35.26, 0], "position": [2, 1, 26]}
    simulation = simulate(
        step=STEP, soft_bodies={"block": body}, rigid_bodies={"box": {**box, "velocity": [0, 0, -SPEED]}}
    )
    _check(figures, _collide(simulation), 0.008 * SPEED)


DEPTH = 0.5


def test_a_corner_in_a_box_comes_out() -> None:
    """A small box whose lower corners are half a millimetre inside a large one."""
    bodies = {
        "large": {"box": [40, 40, 40], "mass": 0.05},
        "small": {"box": [10, 10, 10], "mass": 0.01, "position": [0, 0, 28], "rotation": [0, 0, 20]},
    }
    simulation = simulate(rigid_bodies=bodies)
    inside = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 25.0 - DEPTH]])
    simulation.state = replace(simulation.state, rigid_position=inside)
    report = simulation.step()
    assert report.max_penetration == pytest.approx(CONTACT_DISTANCE + DEPTH)
    assert simulation.step().max_penetration < 1e-3


def test_a_soft_corner_in_a_box_comes_out(block: Callable[..., str]) -> None:
    """One vertex of a silicone block half a millimetre inside a rigid box: linear in the step, so out within a few."""
    body = silicone(block((2, 2, 2), (20.0, 20.0, 20.0)), translation=[0, 0, 0])
    box = {"box": [40, 40, 10], "mass": 0.05, "position": [0, 0, 18]}
    simulation = simulate(soft_bodies={"block": body}, rigid_bodies={"box": box})
    position = simulation.state.position.copy()
    corner = int(np.argmax(position.sum(axis=1)))
    position[corner, 2] = 18 - 5 + DEPTH
    simulation.state = replace(simulation.state, position=position)
    assert simulation.step().max_penetration == pytest.approx(CONTACT_DISTANCE + DEPTH)
    assert simulation.step().max_penetration < 1e-3
