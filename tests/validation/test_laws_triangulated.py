"""Finely triangulated round bodies roll as well as their resolution allows, and gain no energy."""

from pathlib import Path
from typing import Any

import pytest
import trimesh
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, simulate

from taichisoft import Simulation
from taichisoft.base import matrices_from_quaternions

RADIUS, SPEED, MASS = 20.0, 100.0, 0.01


def _rolling(folder: Path, surface: trimesh.Trimesh, step: float, **changes: Any) -> Simulation:
    surface.export(folder / "body.stl")
    body = {
        "surface": str(folder / "body.stl"),
        "mass": MASS,
        "position": [0, 0, RADIUS + CONTACT_DISTANCE],
        "velocity": [SPEED, 0, 0],
        "angular_velocity": [0, SPEED / RADIUS, 0],
    }
    return simulate(step, (0.0, 0.0, -GRAVITY), rigid_bodies={"body": {**body, **changes}}, obstacles={"floor": FLOOR})


def _energy(simulation: Simulation) -> float:
    """Kinetic and potential energy [mN mm]."""
    state, model = simulation.state, simulation.model
    turn = matrices_from_quaternions(state.rigid_rotation)[0]
    spin, moved = state.rigid_angular_velocity[0], state.rigid_velocity[0]
    turning = spin @ turn @ model.rigid_inertia[0] @ turn.T @ spin
    return float(0.5 * turning + 0.5 * MASS * moved @ moved - MASS * state.gravity @ state.rigid_position[0])


@pytest.mark.parametrize(("step", "seconds"), [(0.01, 1.0), (0.002, 1.0), (0.0005, 0.3)])
def test_a_ball_of_ten_thousand_vertices_rolls_on(
    figures: Figures, tmp_path: Path, step: float, seconds: float
) -> None:
    """A polyhedron of ten thousand vertices falls on each that it rolls over, and loses a share of 1 / (1 + k) d^2 / 2
    of its speed, with k = 2/5 and d the angle between them, about 0.03: some 5 % in the 160 of a second.

    Tolerance 10 % of the speed, twice that, for the different spacings along the way; the energy grows by 1 % at most,
    of which the gap tolerance explains 0.4 % (see contact/surfaces.py).
    """
    simulation = _rolling(tmp_path, trimesh.creation.icosphere(subdivisions=5, radius=RADIUS), step)
    start, energies = _energy(simulation), []
    for _ in range(round(seconds / step)):
        simulation.step()
        energies.append(_energy(simulation))
    figures.close("speed [mm/s]", simulation.state.rigid_velocity[0, 0], SPEED, 0.1 * SPEED)
    figures.at_most("energy gained, of the kinetic", (max(energies) - start) / (0.7 * MASS * SPEED**2), 0.01)
