"""What moves far in a step meets what is in its way, and nothing else."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, simulate

from taichisoft import Simulation

SIDE = 20.0
HEIGHT = SIDE / 2 + CONTACT_DISTANCE


def _dropped(height: float, step: float) -> Simulation:
    box = {"box": [SIDE] * 3, "mass": 0.01, "position": [0, 0, HEIGHT + height]}
    return simulate(step, (0.0, 0.0, -GRAVITY), rigid_bodies={"box": box}, obstacles={"floor": FLOOR})


@pytest.mark.parametrize("step", [0.01, 0.002])
@pytest.mark.parametrize("height", [30.0, 300.0, 2000.0])
def test_a_box_dropped_from_any_height_lands_and_stays(figures: Figures, height: float, step: float) -> None:
    """It never sinks in by more than 1e-6 mm, does not rise again, and lies still: there is no restitution.

    From 2000 mm it moves 63 mm in a step of 10 ms, three times its size. Tolerance: the solver's, 1e-5 mm/s.
    """
    simulation = _dropped(height, step)
    heights = []
    for _ in range(round((np.sqrt(2 * height / GRAVITY) + 0.2) / step)):
        assert simulation.step().converged
        heights.append(simulation.state.rigid_position[0, 2] - HEIGHT)
    landed = next(index for index, one in enumerate(heights) if one < 1e-6)
    figures.at_most("depth [mm]", -min(heights), 1e-6)
    figures.at_most("rebound [mm]", max(heights[landed:]), 1e-6)


@pytest.mark.parametrize("start", [7.0, 12.0, 16.5, 21.5])
@pytest.mark.parametrize("speed", [1000.0, 5000.0])
def test_a_box_does_not_pass_through_a_thin_plate(tmp_path: Path, start: float, speed: float) -> None:
    """A box of 10 mm at 1 and 5 m/s, 10 and 50 mm a step, onto a fixed plate of 2 mm, wherever the step begins.

    It stops at the contact distance, to 1e-6 mm: faces that meet flat are linear, and the solver knows velocities to
    1e-5 mm/s.
    """
    trimesh.creation.box(extents=[60, 60, 2]).export(tmp_path / "plate.stl")
    box = {"box": [10, 10, 10], "mass": 0.01, "position": [0, 0, start], "velocity": [0, 0, -speed]}
    obstacles = {"plate": {"surface": str(tmp_path / "plate.stl")}}
    simulation = simulate(rigid_bodies={"box": box}, obstacles=obstacles)
    for _ in range(6):
        assert simulation.step().max_penetration < 1e-6
    np.testing.assert_allclose(simulation.state.rigid_position[0], [0, 0, 1 + CONTACT_DISTANCE + 5], atol=1e-6)
    np.testing.assert_allclose(simulation.state.rigid_velocity[0], 0.0, atol=1e-4)


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
