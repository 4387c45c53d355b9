"""The base carries the anchored nodes: they are where its pose is, however fast it moves and turns."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation
from taichisoft.scene import scene_from_dict

STEP = 0.01
BOUND = 1e-6
"""What an unloaded node may be off [mm]: its mass and damping pull with some 1e4 mN at a spring of 1e12 mN/mm."""
DAMPING = 0.1

KINDS: dict[str, dict[str, Any]] = {
    "linear": {"body": {"element": "linear"}},
    "smoothed": {"body": {"element": "smoothed"}},
    "rubber": {"body": {"element": "smoothed", "law": "neo-hookean", "poisson_ratio": 0.49}},
    "several linearisations": {"body": {"law": "neo-hookean"}, "time": {"newton": 20}},
    "overdamped": {"time": {"dynamics": "overdamped"}},
}


def finger(body: dict[str, Any] | None = None, time: dict[str, Any] | None = None) -> Simulation:
    """The shipped finger without gravity, held at its base."""
    table = {
        "mesh": "tutorial-coarse",
        "element": "linear",
        "mass": 0.04,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_mass": 0.1,
        "rayleigh_stiffness": DAMPING,
        "anchors": [{"box": [[-10, 0, -20], [0, 30, 20]]}],
        **(body or {}),
    }
    scene = {"gravity": [0, 0, 0], "time": {"step": STEP, **(time or {})}, "soft_bodies": {"finger": table}}
    return Simulation(scene_from_dict(scene))


def lag(simulation: Simulation) -> float:
    """How far anchored nodes are from where the observed pose of the base has them, the largest component [mm]."""
    model, seen = simulation.model, simulation.observe()
    turn = Rotation.from_rotvec(seen.base_rotation)
    held = model.rest_position[model.anchored_nodes] - model.base_pivot
    target = turn.apply(held) + model.base_pivot + seen.base_translation
    return float(np.abs(simulation.state.position[model.anchored_nodes] - target).max())


@pytest.mark.parametrize("speed", [10.0, 30.0, 80.0, 200.0, 500.0])
def test_the_anchored_nodes_are_where_the_base_is(figures: Figures, speed: float) -> None:
    """A path in all six degrees of freedom at some speed and turning up to 3 rad/s, then a turn in the other direction.

    The way itself is speed times time: the pose is not led behind its command either.
    """
    simulation = finger()
    way = np.array([2.0, -1.0, 2.0]) / 3.0
    turning = speed / 500.0 * np.array([2.0, 2.0, -1.0])
    worst = 0.0
    for _ in range(12):
        simulation.step(Control(base_velocity=speed * way, base_angular_velocity=turning))
        worst = max(worst, lag(simulation))
    travelled = 12 * STEP * speed * way
    figures.at_most("way of the base [mm]", np.abs(simulation.observe().base_translation - travelled).max(), 1e-9)
    angle = np.linalg.norm(simulation.observe().base_rotation)
    figures.close("its turn [rad]", float(angle), 12 * STEP * float(np.linalg.norm(turning)), 1e-12)
    for _ in range(6):
        simulation.step(Control(base_velocity=-speed * way[::-1], base_angular_velocity=-turning[::-1]))
        worst = max(worst, lag(simulation))
    figures.at_most("anchored nodes against the base, worst step [mm]", worst, BOUND)
    simulation.step(Control(base_velocity=np.zeros(3), base_angular_velocity=np.zeros(3)))
    figures.at_most("left in the step of the stop [mm]", lag(simulation), BOUND)


@pytest.mark.parametrize("kind", KINDS)
def test_they_are_there_with_any_element_and_law(figures: Figures, kind: str) -> None:
    """As above, 80 mm/s and 1 rad/s, then a pose that is asked for 2 mm away, which a step reaches."""
    simulation = finger(**KINDS[kind])
    control = Control(base_velocity=np.array([80.0, 0.0, 0.0]), base_angular_velocity=np.array([0.0, 0.0, 1.0]))
    worst = 0.0
    for _ in range(5):
        simulation.step(control)
        worst = max(worst, lag(simulation))
    simulation.step(Control(base_translation=np.array([2.0, 0.0, 0.0]), base_rotation=np.zeros(3)))
    figures.at_most("anchored nodes against the base, worst step [mm]", max(worst, lag(simulation)), BOUND)


def test_soft_springs_are_stretched_by_their_load_alone(figures: Figures) -> None:
    """A soft spring shows its load: under gravity g a node of mass m hangs m g / k below the base, moving or not."""
    stiffness = 1e3
    held_everywhere = {"anchors": [{"box": [[-200, -50, -50], [50, 50, 50]], "stiffness": stiffness}]}
    simulation = finger(body=held_everywhere)
    gravity, speed = 9810.0, 80.0
    for _ in range(150):
        simulation.step(Control(gravity=np.array([-gravity, 0.0, 0.0]), base_velocity=np.array([0.0, speed, 0.0])))
    assert simulation.model.elasticity is not None
    (mass,) = set(simulation.model.elasticity.node_mass)
    figures.close("sag on springs of 1000 mN/mm [mm]", lag(simulation), mass * gravity / stiffness, 1e-9)


def test_damped_anchors_lag_as_in_sofa(figures: Figures) -> None:
    """With `damped_anchors` a base that moves at v drags its nodes b v behind; this is how SOFA's scenes are read.

    From rest the lag d of implicit Euler becomes (d + h v) b / (h + b): a step leaves b / (h + b) of the way.
    """
    simulation = finger(body={"damped_anchors": True})
    speed, expected = 20.0, 0.0
    for _ in range(30):
        simulation.step(Control(base_velocity=np.array([speed, 0.0, 0.0])))
        expected = (expected + STEP * speed) * DAMPING / (STEP + DAMPING)
    figures.close("lag [mm]", lag(simulation), expected, 1e-6)
    assert expected == pytest.approx(DAMPING * speed * (1.0 - math.exp(-30 * math.log(1 + STEP / DAMPING))))
