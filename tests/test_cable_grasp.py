"""The shipped cable gripper: three fingers of our own that cables close on a cube, lift it and hold it in the air."""

from typing import Any

import numpy as np
import pytest

from taichisoft import Control, Simulation, load_scene, make_controller, run
from taichisoft_outputs.metrics import MetricsOutput

GRAVITY = 9810.0
LIFT, PULL = 40.0, 5.5
TENDONS = ("finger1.tendon", "finger2.tendon", "finger3.tendon")


@pytest.fixture(scope="module")
def grasp(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Simulation]:
    """Metrics and the simulation of a run as shipped."""
    scene = load_scene("cable-gripper")
    simulation, metrics = Simulation(scene), MetricsOutput(tmp_path_factory.mktemp("cable-gripper"))
    run(simulation, make_controller(scene), [metrics])
    return metrics.metrics, simulation


def test_cube_is_lifted_with_gripper_and_held(grasp: tuple[dict[str, Any], Simulation]) -> None:
    """Lifted by 40 mm to within 1 mm, then creep below 0.1 mm in 2 s: those of the scene's goal; every step solved."""
    metrics, _ = grasp
    assert metrics["held"] is True
    assert metrics["base_lift_mm"] == pytest.approx(LIFT, abs=1e-9)
    assert abs(metrics["object_lift_mm"] - LIFT) < 1.0
    assert metrics["object_creep_mm"] < 0.1
    assert metrics["unconverged_steps"] == 0
    assert metrics["max_penetration_mm"] < 1.0


def test_all_three_fingers_hold_it_by_friction(grasp: tuple[dict[str, Any], Simulation]) -> None:
    """Coulomb: sum(F_n) mu >= m g. And the cables are pulled in by what the script says, which takes tension."""
    seen = grasp[1].observe()
    forces = {pair: force for pair, force in seen.normal_forces.items() if "cube" in pair and force > 1.0}
    assert sorted(pair[0] for pair in forces) == ["finger1", "finger2", "finger3"]
    assert 0.7 * sum(forces.values()) > 0.08 * GRAVITY
    assert seen.cable_pulls == pytest.approx(dict.fromkeys(TENDONS, PULL), abs=1e-6)
    assert all(1000.0 < tension < 10000.0 for tension in seen.cable_tensions.values())


def test_open_fingers_lift_nothing() -> None:
    """Without tension the same motion of the base leaves the cube where it stands."""
    simulation = Simulation(load_scene("cable-gripper"))
    start = simulation.state.rigid_position[0]
    for step in range(60):
        shift = np.array([0.0, 0.0, min(step, 40.0)])
        simulation.step(Control(base_translation=shift))
    assert np.linalg.norm(simulation.state.rigid_position[0] - start) < 0.1
    assert not simulation.state.actuator_effort.any()


def test_grasp_by_tension_is_same(grasp: tuple[dict[str, Any], Simulation]) -> None:
    """The tensions that the pull took, imposed from that state on, keep the cube where it is: 0.01 mm in 0.2 s."""
    held = grasp[1]
    simulation = Simulation(held.model)
    simulation.restore(held.state)
    for _ in range(20):
        simulation.step(Control(cable_tension=held.observe().cable_tensions))
    assert np.linalg.norm(simulation.state.rigid_position[0] - held.state.rigid_position[0]) < 0.01


def test_gripper_has_its_materials_and_sizes() -> None:
    """Some 20 cm^3 of silicone a finger, and a mesh that a laptop simulates."""
    model = Simulation(load_scene("cable-gripper")).model
    assert 400 * 3 <= model.node_count <= 700 * 3
    assert model.elasticity is not None
    assert model.elasticity.node_mass.sum() == pytest.approx(3 * 22788.0 * 1.08e-6, rel=1e-4)
