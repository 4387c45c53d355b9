"""Contact problems that Siconos and LMGC90 made (FCLIB's kind): the contact solver solves them from no impulses."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Figures

from taichisoft_benchmarks.friction_problems import FrictionProblem, project_on_cones, read_problem, solve

SOLVED = (
    "BoxesStack1-i100000-32",
    "Capsules-i100-1090",
    "Capsules-i100-889",
    "Confeti-ex13-Fc3D-SBM",
    "FC3D_Example1",
    "NESpheres_30_1",
    "OneObject-i100000-316",
    "Rover1039",
    "Rover1040",
)
"""Of those beside the project all but the pile of rocks, with 463 contacts and W of rank 743, which takes a minute."""


@pytest.mark.parametrize("name", SOLVED)
def test_a_problem_of_another_program_is_solved(shared: Path, figures: Figures, name: str) -> None:
    """r = P(r - u - mu |u_t| n) but for 1e-8 of |q|: the solver's tolerance is the same share of q's largest entry."""
    answer = solve(read_problem(shared / "reference" / "fclib" / f"{name}.npz"))
    figures.at_most(f"natural map of {name}", answer.natural_map, 1e-8)


def test_the_natural_map_measures_what_it_says() -> None:
    """One contact that is pressed with 2 and pushed aside with 1: it sticks with mu = 0.6 and slips with 0.3."""
    sticks = FrictionProblem("sticks", np.eye(3), np.array([-2.0, 1.0, 0.0]), np.array([0.6]))
    assert sticks.natural_map(np.array([2.0, -1.0, 0.0])) == pytest.approx(0.0, abs=1e-15)
    slips = FrictionProblem("slips", np.eye(3), np.array([-2.0, 1.0, 0.0]), np.array([0.3]))
    assert slips.natural_map(np.array([2.0, -0.6, 0.0])) == pytest.approx(0.0, abs=1e-15)
    assert slips.natural_map(np.array([2.0, -1.0, 0.0])) > 0.1


def test_the_projection_is_the_nearest_point_of_the_cone() -> None:
    random = np.random.default_rng(5)
    friction = random.uniform(0.1, 1.5, 200)
    points = random.normal(size=(200, 3))
    nearest = project_on_cones(points.reshape(-1), friction).reshape(-1, 3)
    assert (np.hypot(nearest[:, 1], nearest[:, 2]) <= friction * nearest[:, 0] + 1e-12).all()
    others = random.normal(size=(200, 50, 3))
    others[..., 0] = np.abs(others[..., 0])
    others[..., 1:] *= (friction[:, None] * others[..., 0] / np.hypot(others[..., 1], others[..., 2]))[..., None]
    distance = np.linalg.norm(points - nearest, axis=1)
    assert (distance[:, None] <= np.linalg.norm(points[:, None] - others, axis=2) + 1e-12).all()
