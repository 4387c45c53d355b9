"""What moves far in a step meets what is in its way, and nothing else."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scenes import CONTACT_DISTANCE, simulate


@pytest.mark.parametrize("surface", ["box", "ball"])
@pytest.mark.parametrize("speed", [200.0, 2000.0, 20000.0])
@pytest.mark.parametrize("beyond", [2.0, 5.0], ids=["past a corner's height", "higher"])
def test_what_flies_past_an_edge_is_not_deflected(tmp_path: Path, surface: str, speed: float, beyond: float) -> None:
    """2 mm above a fixed box, twice the contact distance, at 2 to 200 mm in a step of 10 ms.

    The path is a straight line to round-off. A half-space through the nearest corner, as a contact is to the solver,
    would stand in the way.
    """
    trimesh.creation.box(extents=[40, 40, 40]).export(tmp_path / "box.stl")
    trimesh.creation.icosphere(subdivisions=2, radius=5.0).export(tmp_path / "ball.stl")
    shape = {"box": [10, 10, 10]} if surface == "box" else {"surface": str(tmp_path / "ball.stl")}
    start, velocity = np.array([-33.0, 1.0, 25.0 + beyond]), np.array([speed, 0.0, 0.0])
    flying = {**shape, "mass": 0.01, "position": start.tolist(), "velocity": velocity.tolist()}
    obstacles = {"box": {"surface": str(tmp_path / "box.stl")}}
    simulation = simulate(rigid_bodies={"flying": flying}, obstacles=obstacles)
    steps = max(3, round(80.0 / (0.01 * speed)))
    for step in range(1, steps + 1):
        simulation.step()
        np.testing.assert_allclose(simulation.state.rigid_position[0], start + 0.01 * step * velocity, atol=1e-9)
    np.testing.assert_array_equal(simulation.state.rigid_velocity[0], velocity)


def test_a_body_that_is_struck_meets_the_next_one_in_the_same_step() -> None:
    """A fast box strikes one at rest, which is thrown at a third: all in one step, without overlap.

    Perfectly inelastic, all of one mass: a third of the speed for each.
    """
    box = {"box": [10, 10, 10], "mass": 0.01}
    places = {"first": 0.0, "second": 14.0, "third": 30.0}
    bodies = {name: {**box, "position": [place, 0, 0]} for name, place in places.items()}
    bodies["first"]["velocity"] = [3000.0, 0.0, 0.0]
    simulation = simulate(rigid_bodies=bodies)
    for _ in range(3):
        assert simulation.step().max_penetration < 1e-5
    np.testing.assert_allclose(simulation.state.rigid_velocity[:, 0], 1000.0, rtol=1e-6)
    gaps = np.diff(simulation.state.rigid_position[:, 0]) - 10.0
    assert (gaps > CONTACT_DISTANCE - 1e-5).all()
