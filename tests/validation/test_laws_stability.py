"""Stability of equilibria: Greenhill's and Euler's columns against their critical loads and against motion."""

import warnings
from typing import Any

import numpy as np
import pytest
from conftest import Figures

from taichisoft.building.scene_files import scene_from_dict
from taichisoft.building.simulation import Simulation
from taichisoft.control.control import Control
from taichisoft.statics import equilibrium

LENGTH, DEPTH, WIDTH, MODULUS = 100.0, 4.0, 6.0, 500.0  # wider than deep: it buckles along z
GREENHILL = 7.837 * MODULUS * DEPTH**2 / 12.0 / LENGTH**3 / 9810.0  # critical density: w L^3 = 7.837 E I [kg/mm^3]
EULER = np.pi**2 / 3.0 * (DEPTH / LENGTH) ** 2  # critical strain of a column clamped at both ends: 4 pi^2 I / (A L^2)


@pytest.fixture
def column(block: Any) -> Any:
    """A simulation of a column along x, clamped at its lower end or at both."""

    def make(density: float, side: float, both_ends: bool = False, **others: Any) -> Simulation:
        ends = [[[-51.0, -9.0, -9.0], [-49.999, 9.0, 9.0]], [[49.999, -9.0, -9.0], [51.0, 9.0, 9.0]]]
        body = {
            "mesh": block((40, 2, 2), (LENGTH, WIDTH, DEPTH)),
            "young_modulus": MODULUS,
            "poisson_ratio": 0.0,
            "density": density,
            "anchors": [{"box": box} for box in ends[: 1 + both_ends]],
        }
        gravity = [0.0 if both_ends else -9810.0, 0.0, side]
        return Simulation(scene_from_dict({"soft_bodies": {"column": body}, "gravity": gravity, **others}))

    return make


def tip(simulation: Simulation, position: np.ndarray) -> np.ndarray:
    rest = simulation.model.rest_position
    return np.asarray((position - rest)[rest[:, 0] > 0.4999 * LENGTH].mean(axis=0))


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_stiffness_of_a_column_falls_with_its_weight(column: Any, figures: Figures, share: float) -> None:
    """The lowest mode of a column under its weight has the stiffness 1 - w / w_c of the one without."""
    found = equilibrium(column(share * GREENHILL, -1.0))
    figures.close(f"stiffness at {share:g} of the critical weight", found.stiffness, 1.0 - share, 0.15)
    assert found.left is None and not found.warning


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_column_falls_to_the_side_of_its_load(column: Any, figures: Figures, side: float) -> None:
    """Beyond the critical weight the straight column is unstable. It is left on the side of the load, and a motion that
    begins at the end stays there."""
    simulation = column(1.2 * GREENHILL, side)
    straight = equilibrium(simulation, stable=False)
    assert (
        straight.stiffness == pytest.approx(-0.2, abs=0.05) and abs(tip(simulation, straight.state.position)[2]) < 1.0
    )
    with pytest.warns(UserWarning, match=r"near the start is unstable \(stiffness -0.*gone on to a stable one"):
        found = equilibrium(simulation)
    sideways = tip(simulation, found.state.position)[2]
    assert found.left == straight.stiffness and found.stiffness > 0.0
    # Large deflections: an inextensible column at 1.2 of its critical weight, by shooting.
    figures.close(
        "way to the side of a column at 1.2 of its critical weight, mm", side * sideways, heavy_elastica(1.2), 5.0
    )
    simulation.restore(found.state)
    for _ in range(50):
        simulation.step()
    figures.at_most(
        "from the end of a motion, mm", float(np.abs(simulation.state.position - found.state.position).max()), 1e-3
    )


def heavy_elastica(share: float) -> float:
    """Way to the side of the tip of an inextensible column, EI theta'' = -w (L - s) sin(theta) [mm]."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    def shot(curvature: float) -> Any:
        slope = lambda s, y: [y[1], -7.837 * share * (1.0 - s) * np.sin(y[0]), np.sin(y[0])]  # noqa: E731
        return solve_ivp(slope, (0.0, 1.0), [0.0, curvature, 0.0], rtol=1e-8, atol=1e-10).y[:, -1]

    return LENGTH * float(shot(brentq(lambda curvature: shot(curvature)[1], 0.3, 5.0))[2])


def test_static_steps_buckle_a_column_between_clamps(column: Any, figures: Figures) -> None:
    """A column that is shortened by e beyond Euler's strain bends to w = 2 L / pi sqrt(e - e_c) in the middle, or as
    far as a wall allows."""
    for wall, most in (
        ({}, None),
        ({"obstacles": {"wall": {"plane": {"point": [0, 0, -3.5], "normal": [0, 0, 1]}}}}, 0.5),
    ):
        simulation = column(1e-9, -1.0, True, time={"dynamics": "static"}, **wall)
        nodes = simulation.model.anchored_nodes
        places = simulation.model.rest_position[nodes].copy()
        strain = 1.5 * EULER
        places[places[:, 0] > 0.0, 0] -= strain * LENGTH
        with pytest.warns(UserWarning, match="unstable"):
            report = simulation.step(Control(anchor_positions={"column": places}))
        rest = simulation.model.rest_position
        middle = -(simulation.state.position - rest)[np.abs(rest[:, 0]) < 1e-6, 2].mean()
        assert report.converged and report.left is not None and report.stiffness > 0.0
        bow = 2.0 * LENGTH / np.pi * np.sqrt(strain - EULER)
        figures.close(f"bow of a column, wall {most}, mm", middle, bow if most is None else most, 0.15)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            again = simulation.step(Control(anchor_positions={"column": places}))
        assert again.left is None, "it stays"


BOX = {"box": [10.0, 10.0, 10.0], "density": 1e-6}
BALL = {"sphere": {"radius": 5.0}, "density": 1e-6}
FLOOR = {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}}
DOME = {"dome": {"sphere": {"radius": 10.0}}}


@pytest.mark.parametrize(
    ("bodies", "obstacles"),
    [
        ({"flat": {**BOX, "position": [0.0, 0.0, 5.1]}}, FLOOR),
        ({"edge": {**BOX, "position": [0.0, 0.0, 50.0**0.5 + 0.1], "rotation": [0.0, 45.0, 0.0]}}, FLOOR),
        ({"ball": {**BALL, "position": [0.0, 0.0, 15.1]}}, DOME),
        ({"low": {**BOX, "position": [0.0, 0.0, 5.1]}, "high": {**BOX, "position": [4.0, 0.0, 15.2]}}, FLOOR),
    ],
)
def test_stability_of_rigid_bodies_is_not_claimed(bodies: dict[str, Any], obstacles: dict[str, Any]) -> None:
    """Whether it lies flat or stands on an edge: what the check leaves out is named, and no stiffness given."""
    tables = {"gravity": [0.0, 0.0, -9810.0], "rigid_bodies": bodies, "obstacles": obstacles}
    contact = {"friction": 0.5, "contact_distance": 0.1, "alarm_distance": 2.0}
    found = equilibrium(Simulation(scene_from_dict({**tables, "contact": contact})))
    assert found.unchecked == tuple(bodies) and found.stiffness is None


def test_a_stack_that_must_topple_ends_on_the_floor() -> None:
    """A box whose centre is 1 mm beyond the edge of the one below it does not rest there."""
    bodies = {"low": {**BOX, "position": [0.0, 0.0, 5.1]}, "high": {**BOX, "position": [6.0, 0.0, 15.2]}}
    tables = {"gravity": [0.0, 0.0, -9810.0], "rigid_bodies": bodies, "obstacles": FLOOR}
    contact = {"friction": 0.5, "contact_distance": 0.1, "alarm_distance": 2.0}
    found = equilibrium(Simulation(scene_from_dict({**tables, "contact": contact})))
    assert found.state.rigid_position[:, 2] == pytest.approx(5.1, abs=1e-3)
