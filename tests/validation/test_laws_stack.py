"""A stack of ten whose heaviest is on top, and what pushes pushes back."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, rigid_momentum, silicone, simulate, soft_momentum

DOWN = (0.0, 0.0, -GRAVITY)


@pytest.mark.parametrize("heaviest_on_top", [True, False])
def test_a_stack_of_ten_with_a_mass_ratio_of_100(figures: Figures, heaviest_on_top: bool) -> None:
    """Each interface carries what is above it, to 1e-4 of that; nothing moves by more than 1e-4 mm in half a second.

    The sweeps stop when none changes a velocity by more than 1e-5 mm/s of the 98 mm/s that gravity gives in a step;
    with ten bodies on each other the error left is some hundred times the last change.
    """
    side, count = 20.0, 10
    masses = np.geomspace(0.001, 0.1, count)
    masses = masses if heaviest_on_top else masses[::-1]
    height = CONTACT_DISTANCE + side / 2 + np.arange(count) * (side + CONTACT_DISTANCE)
    bodies = {
        f"box{index}": {"box": [side] * 3, "mass": float(mass), "position": [0, 0, float(z)]}
        for index, (mass, z) in enumerate(zip(masses, height, strict=True))
    }
    simulation = simulate(gravity=DOWN, rigid_bodies=bodies, obstacles={"floor": FLOOR})
    report = advance(simulation, 0.5)
    forces = report.observation.normal_forces
    for index in range(count):
        pair = (f"box{index - 1}", f"box{index}") if index else ("box0", "floor")
        above = float(masses[index:].sum()) * GRAVITY
        figures.close(f"force below box {index} [mN]", forces[pair], above, 1e-4 * above)
    moved = np.abs(simulation.state.rigid_position - np.column_stack([0 * height, 0 * height, height])).max()
    figures.at_most("motion [mm]", float(moved), 1e-4)


def test_what_bodies_give_each_other_is_what_obstacles_do_not_take(block: Callable[..., str], figures: Figures) -> None:
    """Newton's third law: in each step momentum changes by m g h and by the impulses of obstacles alone.

    Soft on rigid on soft, thrown together on a floor; and a rigid body's own momentum changes by the impulses of its
    contacts, each of which counts once for either body. Tolerance 1e-9 of the largest momentum: round-off.
    """
    mesh = block((2, 2, 2), (20.0, 20.0, 20.0))
    soft = {
        "lower": silicone(mesh, translation=[0, 0, 12.5]),
        "upper": silicone(mesh, translation=[3, 2, 60], velocity=[0, 100, -500], rotation=[10, 20, 0]),
    }
    rigid = {
        "box": {"box": [24, 24, 12], "mass": 0.02, "position": [1, 0, 33], "velocity": [200, 0, -300]},
        "tile": {"box": [10, 10, 4], "mass": 0.005, "position": [20, 16, 6], "velocity": [-300, -300, 0]},
    }
    simulation = simulate(step=0.005, gravity=DOWN, soft_bodies=soft, rigid_bodies=rigid, obstacles={"floor": FLOOR})
    names, step = simulation.model.body_names, 0.005
    mass = simulation.model.rigid_mass.sum() + simulation.model.elasticity.node_mass.sum()  # type: ignore[union-attr]
    largest, touched = 0.0, set()
    for _ in range(80):
        start = simulation.state
        before = rigid_momentum(simulation) + soft_momentum(simulation)
        simulation.step()
        end = simulation.state
        received = np.zeros((len(names), 3))
        np.add.at(received, end.contact_body_pair[:, 1], end.contact_impulse)
        np.subtract.at(received, end.contact_body_pair[:, 0], end.contact_impulse)
        touched |= {(names[a], names[b]) for a, b in end.contact_body_pair[np.any(end.contact_impulse, axis=1)]}
        gained = rigid_momentum(simulation) + soft_momentum(simulation) - before
        weight = step * mass * np.array(DOWN)
        largest = max(largest, float(np.abs(gained - weight + received[names.index("floor")]).max()))
        for index, own in enumerate(simulation.model.rigid_mass):
            change = own * (end.rigid_velocity[index] - start.rigid_velocity[index] - step * np.array(DOWN))
            largest = max(largest, float(np.abs(change - received[2 + index]).max()))
    assert {("lower", "box"), ("upper", "box"), ("lower", "floor")} <= touched
    figures.at_most("momentum that nothing gave, of the largest", largest / (0.02 * 500), 1e-9)
