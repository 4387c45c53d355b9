"""The grasp, the reason for all the rest: the shipped gripper lifts a cube by friction and holds it in the air."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command

from taichisoft import Simulation, load_scene, make_controller, run
from taichisoft.errors import GoalMissed
from taichisoft_outputs.metrics import MetricsOutput

GRAVITY = 9810.0
LIFT = 30.0
QUICK_SCRIPT = """
interpolation = "smooth"
keyframes = [
    { time = 0.2, pressure = 0.0 },
    { time = 1.2, pressure = 50.0 },
    { time = 1.4, pressure = 50.0 },
    { time = 1.9, pressure = 50.0, base_translation = [10.0, 0.0, 0.0] },
]
"""
"""Closes as gently as the shipped script, but lifts and holds for a shorter time."""


def grasp(folder: Path, *overrides: str) -> dict[str, Any]:
    """Metrics of a run of the shipped scene `gripper`."""
    scene = load_scene("gripper", overrides)
    output = MetricsOutput(folder)
    try:
        run(Simulation(scene), make_controller(scene), [output])
    except GoalMissed as missed:
        return {**output.metrics, "missed": str(missed)}
    return output.metrics


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """1 g at 50 kPa, as shipped."""
    return grasp(tmp_path_factory.mktemp("light"))


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """10 g at 80 kPa."""
    overrides = ("rigid_bodies.cube.mass=0.01", "controller.settings.pressure=80")
    return grasp(tmp_path_factory.mktemp("heavy"), *overrides)


@pytest.mark.parametrize("case", ["light", "heavy"])
def test_cube_is_lifted_with_gripper_and_held(case: str, request: pytest.FixtureRequest) -> None:
    """Lifted by 30 mm to within 1 mm; then, for 2 s, creep below 0.1 mm. Tolerances are those of the scene's goal."""
    metrics = request.getfixturevalue(case)
    assert metrics["held"] is True
    assert metrics["base_lift_mm"] == pytest.approx(LIFT, abs=1e-9)
    assert abs(metrics["object_lift_mm"] - LIFT) < 1.0
    assert metrics["object_creep_mm"] < 0.1


@pytest.mark.parametrize("case", ["light", "heavy"])
def test_nothing_overlaps_and_every_step_converges(case: str, request: pytest.FixtureRequest) -> None:
    """Surfaces overlap when a point goes deeper than the contact distance of 1 mm."""
    metrics = request.getfixturevalue(case)
    assert metrics["steps"] == 620
    assert metrics["unconverged_steps"] == 0
    assert metrics["max_penetration_mm"] < 1.0


def test_more_pressure_presses_harder(light: dict[str, Any], heavy: dict[str, Any]) -> None:
    assert heavy["mean_normal_force_mN"] > 1.2 * light["mean_normal_force_mN"]
    for metrics in (light, heavy):  # only the fingers touch a cube that is in the air
        assert all("floor" not in pair for pair, force in metrics["final_normal_forces_mN"].items() if force > 0.0)


@pytest.mark.parametrize(("friction", "held"), [(0.009, True), (0.007, False)])
def test_friction_holds_weight_if_it_can(tmp_path: Path, friction: float, held: bool) -> None:
    """Coulomb: sum(F_n) mu >= m g. 1 g weighs 9.81 mN and the fingers press with 1237 mN, so the threshold is 0.0079.

    The cases lie 12 % on either side of it; lifting by 10 mm in 0.5 s adds at most 2.4 % of g to the weight.
    """
    script = tmp_path / "quick.toml"
    script.write_text(QUICK_SCRIPT)
    metrics = grasp(
        tmp_path,
        f"contact.friction={friction}",
        f"controller.settings.script={script}",
        "time.duration=3.4",
        "goal.hold=0.5",
    )
    assert metrics["unconverged_steps"] == 0
    assert metrics["held"] is held
    force = metrics["mean_normal_force_mN"] if held else metrics["peak_normal_force_mN"]
    assert (friction * force >= 0.001 * GRAVITY) is held


def test_cube_that_is_not_lifted_fails_command_in_one_line(tmp_path: Path, command: Command) -> None:
    """The run ends before the fingers have closed."""
    arguments = ["run", "gripper", "--output", tmp_path, "--duration", "0.5", "--set", "goal.hold=0.2"]
    code, _, errors = command(*arguments)
    assert code == 1
    (line,) = errors.strip().splitlines()
    assert line.startswith("taichisoft: 'cube' is not held: the base rose by 0.00 mm")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["held"] is False
    assert np.allclose(metrics["final_object_position_mm"][0], -100.0, atol=0.5)  # it still stands on the floor
