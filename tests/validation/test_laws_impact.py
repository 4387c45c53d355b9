"""An impact beside the centre of mass turns a body: impulse and moment go together."""

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, simulate

from taichisoft.base.rotations import rotation_from_degrees

SIZE = np.array([30.0, 20.0, 10.0])
MASS = 0.01
SPEED = 100.0


@pytest.mark.parametrize("degrees", [20.0, 40.0, 60.0])
def test_an_edge_that_strikes_the_floor_stops_and_turns_the_box(figures: Figures, degrees: float) -> None:
    """A box turned about y falls on its lower edge, whose horizontal distance from the centre is a, without friction.

    The edge stops (no restitution): j (1 / m + a^2 / I) = v, so the centre goes on with v - j / m and the box turns
    with a j / I, where I = m (x^2 + z^2) / 12. Tolerance 1e-6 of v: the solver's 1e-5 mm/s of 100 and round-off.
    """
    turn = rotation_from_degrees((0.0, degrees, 0.0))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2 * SIZE @ turn.T
    lowest = corners[corners[:, 2].argmin()]
    box = {
        "box": SIZE.tolist(),
        "mass": MASS,
        "rotation": [0, degrees, 0],
        "position": [0, 0, CONTACT_DISTANCE - lowest[2]],
        "velocity": [0, 0, -SPEED],
    }
    contact = {"friction": 0.0, "tolerance": 1e-9}
    simulation = simulate(step=1e-4, rigid_bodies={"box": box}, obstacles={"floor": FLOOR}, contact=contact)
    report = simulation.step()
    inertia = MASS * (SIZE[0] ** 2 + SIZE[2] ** 2) / 12
    impulse = SPEED / (1 / MASS + lowest[0] ** 2 / inertia)
    velocity, spin = simulation.state.rigid_velocity[0], simulation.state.rigid_angular_velocity[0]
    figures.close("impulse [mN s]", report.observation.normal_forces["box", "floor"] * 1e-4, impulse, 1e-6 * impulse)
    figures.close("velocity of the centre [mm/s]", velocity[2], impulse / MASS - SPEED, 1e-6 * SPEED)
    expected = -lowest[0] * impulse / inertia
    figures.close("spin [rad/s]", spin[1], expected, 1e-6 * abs(expected))
