"""Gradients of runs: against derivatives of a step, and against differences of runs.

Differences over 1e-5 of a control's unit have relative errors of some 1e-7 here, once the contact solver stops at 1e-11
mm/s: gradients must agree with them to 1e-6 where contacts stay open, sticking or sliding.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from taichisoft import Control, LeastSquares, Observation, Simulation, gradient, load_scene
from taichisoft.errors import TaichisoftError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.step import asking

EXACT = ("contact.tolerance=1e-11", "limits={}")
FLOATING = (*EXACT, "gravity=[0.0, 0.0, 0.0]", "obstacles={}", "contact.friction=0.3")
Values = dict[str, np.ndarray]


class Weighted:
    """Objective: figures after each step, times weights."""

    def __init__(self, weights: Mapping[str, Any]):
        self.weights = {name: np.array(weight, dtype=float) for name, weight in weights.items()}

    def __call__(self, seen: Observation) -> tuple[float, Mapping[str, Any]]:
        total = 0.0
        for name, weight in self.weights.items():
            field, _, key = name.partition(".")
            values = getattr(seen, field)
            pair = tuple(key.split("|"))
            total += float((weight * (values.get(pair, 0.0) if len(pair) == 2 else values[key])).sum())
        return total, self.weights


def squeezed(*others: str, steps: int = 15) -> Simulation:
    """Two pads that hold a cube, moving it."""
    simulation = Simulation(load_scene(TINY_GRIPPER, others))
    for step in range(steps):
        pressures = {"left.cavity": min(9.0, 0.9 * step), "right.cavity": min(8.6, 0.9 * step)}
        simulation.step(Control(pressure=pressures, base_translation=np.array([0.0, 0.0, 0.2 * max(0, step - 12)])))
    return simulation


def value_of(simulation: Simulation, controls: Values, objective: Weighted) -> float:
    start, total = simulation.state, 0.0
    for row in zip(*controls.values(), strict=True):
        simulation.step(asking(simulation.state, dict(zip(controls, map(float, row), strict=True))))
        total += objective(simulation.observe())[0]
    simulation.restore(start)
    return total


CASES = {
    "inflated finger": (
        lambda: Simulation(load_scene("finger-inflated")),
        {"tip_positions.finger": [1.0, 2.0, 3.0], "bending_angles.finger": 5.0, "volumes.finger.cavity": 1e-3},
        {"pressure.finger.cavity": 12.0},
    ),
    "squeezed cube": (
        lambda: squeezed(*EXACT),
        {
            "object_positions.cube": [1.0, 2.0, 3.0],
            "object_angular_velocities.cube": [1.0, 0.5, 0.2],
            "normal_forces.left|cube": 1e-3,
            "friction_forces.right|cube": 1e-3,
        },
        {"pressure.left.cavity": 9.1, "base_translation.z": 0.7, "base_rotation.y": 0.0},
    ),
    "pulled cable": (
        lambda: Simulation(load_scene("cable-gripper", ("limits={}",))),
        {"tip_positions.finger1": [1.0, 2.0, 3.0], "cable_tensions.finger1.tendon": 1e-3},
        {"cable_pull.finger1.tendon": 0.2, "base_translation.x": 0.1, "base_rotation.z": 0.01},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient_of_one_step_transposes_linearise(case: str, figures: Figures) -> None:
    """The same equations are solved once for each control and once for the objective: alike but for round-off.

    What is observed by `linearise` is measured by differences; those are exact to 1e-8 of what is not linear.
    """
    make, weights, values = CASES[case]
    simulation = make()
    forces = [f"force.{name}.y" for name in simulation.observe().tip_positions]
    found = gradient(simulation, {name: [value] for name, value in values.items()}, Weighted(weights), [*values, *forces])
    linear = simulation.linearise(asking(simulation.state, values), [*values, *forces])
    expected = sum(np.tensordot(np.array(weight), linear[name], np.ndim(weight)) for name, weight in weights.items())
    error = np.abs([found[name].item() for name in found.names] - expected) / np.abs(expected).max()
    figures.at_most(f"gradient of a step, {case}", float(error.max()), 1e-7)
    assert found.step_count == 1 and found.shifted_share == 0.0


STEPS = 5
NAMES = ("pressure.left.cavity", "pressure.right.cavity", "base_translation.z", "base_rotation.y")


@pytest.fixture(scope="module")
def floating() -> Simulation:
    """A cube that two pads hold and slide along."""
    return squeezed(*FLOATING, steps=22)


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=some.integers(0, 1000))
def test_gradient_agrees_with_differences(floating: Simulation, figures: Figures, seed: int) -> None:
    """Along random changes of all controls, of a run with contacts that stick and slide and none that changes."""
    random = np.random.default_rng(seed)
    rest = np.array([9.0, 8.6, 1.8, 0.0])
    size = np.array([0.1, 0.1, 0.05, 0.002])
    controls = dict(zip(NAMES, (rest + size * random.standard_normal((STEPS, 4))).T, strict=True))
    weights = random.standard_normal((2, 3))
    objective = Weighted({"tip_positions.left": weights[0], "object_velocities.cube": 0.01 * weights[1]})
    found = gradient(floating, controls, objective, NAMES)
    along = dict(zip(NAMES, (size * random.standard_normal((STEPS, 4))).T, strict=True))
    half = 1e-3
    sides = [
        value_of(floating, {name: controls[name] + sign * along[name] for name in NAMES}, objective)
        for sign in (half, -half)
    ]
    expected, error = (sides[0] - sides[1]) / (2.0 * half), 0.0
    if found.edge_share == 0.0:
        error = abs(float(sum(found[name] @ along[name] for name in NAMES)) / expected - 1.0)
    figures.at_most("gradient of a run with contact", error, 1e-5)
    assert found.value == pytest.approx(value_of(floating, controls, objective), rel=1e-14)
