"""Bodies in free space keep their momentum."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import Figures
from scenes import advance, silicone, simulate, soft_momentum

from taichisoft import Simulation
from taichisoft.base import matrices_from_quaternions

SPIN = np.array([3.0, 1.0, 2.0])


def _spinning_block(block: Callable[..., str], step: float, corotation: str = "polar") -> Simulation:
    """A soft block that turns and flies; no gravity, no Rayleigh damping."""
    mesh = block((3, 2, 2), (30.0, 20.0, 20.0))
    table = silicone(mesh, element="linear", corotation=corotation, rayleigh_stiffness=0.0)
    simulation = simulate(step=step, soft_bodies={"block": table})
    state = simulation.state
    velocity = np.array([100.0, 0.0, -50.0]) + np.cross(SPIN, state.position)
    simulation.state = replace(state, velocity=velocity)
    return simulation


def _angular_momentum(simulation: Simulation) -> np.ndarray:
    """Of the soft nodes about their centre of mass [mN mm s]."""
    assert simulation.model.elasticity is not None
    mass = simulation.model.elasticity.node_mass[:, None]
    arm = simulation.state.position - (mass * simulation.state.position).sum(axis=0) / mass.sum()
    return np.cross(arm, mass * simulation.state.velocity).sum(axis=0)


@pytest.mark.parametrize("corotation", ["edges", "polar"])
def test_a_free_soft_body_keeps_its_linear_momentum(block: Callable[..., str], corotation: str) -> None:
    """sum m v is kept exactly by implicit Euler: the forces and the rows of K sum to zero.

    Tolerance 1e-11 of the momentum: round-off of 50 solves.
    """
    simulation = _spinning_block(block, 0.01, corotation)
    before = soft_momentum(simulation)
    advance(simulation, 0.5)
    assert np.abs(soft_momentum(simulation) - before).max() < 1e-11 * np.linalg.norm(before)


def test_a_free_soft_body_keeps_its_angular_momentum_in_second_order(
    block: Callable[..., str], figures: Figures
) -> None:
    """Polar forces have no moment, but K v has: in a step a turning body looks like one stretched by (w h)^2 / 2.

    Measured, not derived: the loss falls by four with half the step (global order 2), and stays below (w h)^2.
    """
    loss = {}
    for step in (0.004, 0.002):
        simulation = _spinning_block(block, step)
        before = _angular_momentum(simulation)
        advance(simulation, 0.2)
        loss[step] = float(np.linalg.norm(_angular_momentum(simulation) - before) / np.linalg.norm(before))
        what = f"angular momentum lost in 0.2 s with steps of {step * 1e3:g} ms"
        figures.at_most(what, loss[step], SPIN @ SPIN * step**2)
    figures.close("loss with a step over loss with half of it", loss[0.004] / loss[0.002], 4.0, 0.2)


def _tumble(step: float, seconds: float) -> tuple[float, float]:
    """Angle [rad] by which the angular momentum of a tumbling asymmetric box turns, and its share that is lost."""
    box = {"box": [30, 20, 10], "mass": 0.01, "angular_velocity": SPIN.tolist(), "velocity": [5, 6, 7]}
    simulation = simulate(step=step, rigid_bodies={"box": box})
    before = _rigid_angular_momentum(simulation)
    advance(simulation, seconds)
    after = _rigid_angular_momentum(simulation)
    cosine = before @ after / (np.linalg.norm(before) * np.linalg.norm(after))
    travelled = simulation.state.rigid_position[0]
    np.testing.assert_allclose(travelled, np.array([5, 6, 7]) * seconds, rtol=1e-12)
    return float(np.arccos(min(cosine, 1.0))), float(1 - np.linalg.norm(after) / np.linalg.norm(before))


def _rigid_angular_momentum(simulation: Simulation) -> np.ndarray:
    turn = matrices_from_quaternions(simulation.state.rigid_rotation)[0]
    inertia = turn @ simulation.model.rigid_inertia[0] @ turn.T
    return inertia @ simulation.state.rigid_angular_velocity[0]


def test_a_tumbling_rigid_body_keeps_the_direction_of_its_angular_momentum(figures: Figures) -> None:
    """No torque: L is constant. A step of backward Euler misses h^2/2 |d2L/dt2| <= h^2/2 w^2 |L| in the body's
    frame, so that after a time T the direction is off by at most T h w^2 / 2 rad, and half of it at half the step."""
    seconds = 0.5
    angle = {}
    for step in (0.002, 0.001):
        angle[step], lost = _tumble(step, seconds)
        bound = seconds * step * SPIN @ SPIN / 2
        figures.at_most(f"turn of L in {seconds} s with steps of {step * 1e3:g} ms [rad]", angle[step], bound)
        figures.at_most("share of |L| lost", abs(lost), bound)
    figures.close("turn with a step and with half of it", angle[0.002] / angle[0.001], 2.0, 0.1)
