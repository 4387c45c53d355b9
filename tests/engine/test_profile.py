"""Profiling: the phases add up to the step, nothing else changes, and nothing of it stays."""

import copy
from collections.abc import Callable

import pytest

from taichisoft import Simulation
from taichisoft.running import TOTAL, profiled
from taichisoft.running.profile import REST
from taichisoft.runtime import launch
from taichisoft.scene import scene_from_dict


@pytest.fixture
def simulation(block: Callable[..., str]) -> Simulation:
    """A soft block that falls on a plane."""
    body = {"mesh": block((2, 2, 2), (10.0, 10.0, 10.0)), "mass": 0.01, "young_modulus": 100, "poisson_ratio": 0.3}
    plane = {"plane": {"point": [0, 0, -6.5], "normal": [0, 0, 1]}}
    scene = {"gravity": [0, 0, -9810], "soft_bodies": {"block": body}, "obstacles": {"table": plane}}
    return Simulation(scene_from_dict(scene))


def test_phases_add_up_to_step(simulation: Simulation) -> None:
    with profiled(simulation) as profile:
        for _ in range(3):
            simulation.step()
    assert {"factorisation", "contact detection", "Gauss-Seidel", REST, TOTAL} <= profile.seconds.keys()
    assert all(len(times) == 3 for times in profile.seconds.values())
    for step in range(3):
        parts = sum(times[step] for phase, times in profile.seconds.items() if phase != TOTAL)
        assert parts == pytest.approx(profile.seconds[TOTAL][step])
    for phase, times in profile.seconds.items():
        assert all(0.0 <= python <= time for python, time in zip(profile.in_python[phase], times, strict=True))


def test_profiling_leaves_motion_and_no_trace(simulation: Simulation) -> None:
    start = simulation.state
    for _ in range(3):
        simulation.step()
    expected = simulation.state
    simulation.restore(start)
    with profiled(simulation) as profile:
        for _ in range(3):
            simulation.step()
    assert simulation.state == expected
    seen = copy.deepcopy((profile.seconds, profile.in_python))
    simulation.step()
    assert (profile.seconds, profile.in_python) == seen
    assert launch.TIMING == []
    assert "step" not in vars(simulation)
    assert "assemble" not in vars(simulation.model.elasticity)


def test_scene_without_soft_bodies_is_profiled_too() -> None:
    simulation = Simulation(scene_from_dict({"rigid_bodies": {"box": {"box": [1, 1, 1], "mass": 1}}}))
    with profiled(simulation) as profile:
        simulation.step()
    assert "factorisation" not in profile.seconds
    assert profile.seconds[TOTAL][0] > 0.0
