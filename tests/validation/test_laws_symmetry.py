"""What is symmetric is loaded symmetrically, though a rigid body on many corners leaves the forces undetermined."""

import numpy as np
from conftest import Figures
from scenes import FLOOR, GRAVITY, advance, simulate

from taichisoft import StepReport


def test_a_cube_at_rest_stands_on_all_corners_and_shows_no_friction(figures: Figures) -> None:
    """1 g on the floor: a quarter of 9.81 mN at each corner, and no friction that cancels itself.

    Tolerance 1e-6 of the weight: the tolerance of 1e-5 mm/s beside the 98 mm/s that gravity gives in a step.
    """
    cube = {"box": [42, 42, 42], "mass": 0.001, "position": [0, 0, 22.5]}
    simulation = simulate(gravity=(0.0, 0.0, -GRAVITY), rigid_bodies={"cube": cube}, obstacles={"floor": FLOOR})
    forces = advance(simulation, 0.6).contact_forces
    weight = 0.001 * GRAVITY
    assert len(forces) == 4
    figures.at_most("friction at a corner over the weight", np.abs(forces[:, :2]).max() / weight, 1e-6)
    figures.at_most("normal force less a quarter", np.abs(np.abs(forces[:, 2]) / weight - 0.25).max(), 1e-6)


def thrown(side: float) -> StepReport:
    """A box that slides over the floor and turns, in a mirror for -1."""
    box = {
        "box": [20, 14, 10],
        "mass": 0.01,
        "position": [0, 0, 6.0],
        "velocity": [300.0, 200.0 * side, 0],
        "angular_velocity": [0, 0, 3.0 * side],
    }
    simulation = simulate(gravity=(0.0, 0.0, -GRAVITY), rigid_bodies={"box": box}, obstacles={"floor": FLOOR})
    return advance(simulation, 0.03)


def test_mirrored_scenes_have_mirrored_forces(figures: Figures) -> None:
    """A box that slides and turns, and its mirror image: the same forces but for the sign of y, to 1e-6 of the largest.

    After 0.03 s it still slides, with mu times its weight in all; contacts are compared corner by corner.
    """
    mirror = np.array([1.0, -1.0, 1.0])
    left, right = thrown(1.0), thrown(-1.0)
    ours, theirs = left.contact_forces, right.contact_forces * mirror
    place = np.linalg.norm(left.contact_points[:, None] - right.contact_points * mirror, axis=2).argmin(axis=1)
    assert sorted(place) == [0, 1, 2, 3]
    friction = np.linalg.norm(ours[:, :2].sum(axis=0))
    figures.at_most("difference of the forces", np.abs(ours - theirs[place]).max() / np.abs(ours).max(), 1e-6)
    assert friction > 0.5 * 0.01 * GRAVITY * 0.6
