"""Gradients of runs: against derivatives of a step, and against differences of runs.

Differences over 1e-5 of a control's unit have relative errors of some 1e-7 here, once the contact solver stops at 1e-11
mm/s: gradients must agree with them to 1e-6 where contacts stay open, sticking or sliding.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as some
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from taichisoft import (
    Control,
    Force,
    LeastSquares,
    Observation,
    Simulation,
    gradient,
    load_scene,
    scene_from_dict,
    write_volume_mesh,
)
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
        {"pressure.finger.cavity": 12.0, "base_rotation.z": 0.02},
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
    "squeezed cube of rubber": (
        lambda: squeezed(*EXACT, *(f"soft_bodies.{pad}.law='neo-hookean'" for pad in ("left", "right"))),
        {"object_positions.cube": [1.0, 2.0, 3.0], "volumes.left.cavity": 1e-3, "friction_forces.right|cube": 1e-3},
        {"pressure.left.cavity": 9.1, "base_translation.z": 0.7, "base_rotation.y": 0.0},
    ),
    "squeezed cube, converged": (
        lambda: squeezed(*EXACT, "time.newton=20", "time.newton_tolerance=1e-11"),
        {"object_positions.cube": [1.0, 2.0, 3.0], "volumes.left.cavity": 1e-3, "friction_forces.right|cube": 1e-3},
        {"pressure.left.cavity": 9.1, "base_translation.z": 0.7, "base_rotation.y": 0.0},
    ),
    "pulled cable": (
        lambda: Simulation(load_scene("cable-gripper", ("limits={}",))),
        {
            "tip_positions.finger1": [1.0, 2.0, 3.0],
            "tip_positions.finger2": [1.0, 2.0, 3.0],
            "cable_tensions.finger1.tendon": 1e-3,
            "cable_lengths.finger2.tendon": 0.1,
        },
        {
            "cable_pull.finger1.tendon": 0.2,
            "cable_tension.finger2.tendon": 500.0,
            "base_translation.x": 0.1,
            "base_rotation.z": 0.01,
        },
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_gradient_of_one_step_transposes_linearise(case: str, figures: Figures) -> None:
    """The same equations are solved once for each control and once for the objective: alike but for round-off."""
    make, weights, values = CASES[case]
    simulation = make()
    forces = [f"force.{name}.y" for name in simulation.observe().tip_positions]
    found = gradient(
        simulation, {name: [value] for name, value in values.items()}, Weighted(weights), [*values, *forces]
    )
    linear = simulation.linearise(asking(simulation.state, values), [*values, *forces])
    expected = sum(np.tensordot(np.array(weight), linear[name], np.ndim(weight)) for name, weight in weights.items())
    error = np.abs([found[name].item() for name in found.names] - expected) / np.abs(expected).max()
    figures.at_most(f"gradient of a step, {case}", float(error.max()), 1e-9)
    assert found.step_count == 1 and found.shifted_share == 0.0


STEPS = 4
SIZES = {
    "pressure.left.cavity": (9.0, 0.1),
    "pressure.right.cavity": (8.6, 0.1),
    "base_translation.z": (1.8, 0.05),
    "base_rotation.y": (0.0, 0.002),
}
"""Means and random parts of the controls, in their units."""
OBJECTIVE = Weighted({"tip_positions.left": [1.0, -0.5, 2.0], "object_velocities.cube": [0.01, 0.02, -0.01]})


@pytest.fixture(scope="module")
def floating() -> Simulation:
    """A cube that two pads hold and slide along."""
    return squeezed(*FLOATING, steps=22)


def drawn(random: np.random.Generator, around: float = 1.0) -> Values:
    return {name: around * mean + size * random.standard_normal(STEPS) for name, (mean, size) in SIZES.items()}


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=some.integers(0, 1000))
def test_gradient_of_a_run_agrees_with_differences(floating: Simulation, figures: Figures, seed: int) -> None:
    """Along random changes of all controls, while contacts stick and slide."""
    random = np.random.default_rng(seed)
    controls, along, start = drawn(random), drawn(random, 0.0), floating.state
    found = gradient(floating, controls, OBJECTIVE, list(SIZES))
    assert floating.state is start
    assert found.value == pytest.approx(value_of(floating, controls, OBJECTIVE), rel=1e-14)
    assume(found.edge_share == found.inexact_share == 0.0)
    sides = [
        value_of(floating, {name: controls[name] + half * along[name] for name in SIZES}, OBJECTIVE)
        for half in (1e-4, -1e-4)
    ]
    slope, expected = sum(found[name] @ along[name] for name in SIZES), (sides[0] - sides[1]) / 2e-4
    figures.at_most("gradient of a run with contact", abs(slope - expected) / max(abs(expected), 0.01), 1e-6)


@pytest.mark.parametrize("name", ["position", "velocity", "rigid_position", "rigid_velocity"])
def test_gradient_by_the_start_agrees_with_differences(figures: Figures, name: str) -> None:
    """Where gaps are closed in every step; else surfaces that just touch are at an edge, which a start can cross."""
    simulation = squeezed(*FLOATING, "contact.depth='velocity'", steps=22)
    start, random = simulation.state, np.random.default_rng(5)
    controls = {name: np.full(STEPS, mean) for name, (mean, _) in SIZES.items()}
    way = random.standard_normal(getattr(start, name).shape)
    found = gradient(simulation, controls, OBJECTIVE, [f"start.{name}"])
    assert found.inexact_share == 0.0
    sides = []
    for half in (1e-5, -1e-5):
        simulation.restore(start.changed(**{name: getattr(start, name) + half * way}))
        sides.append(value_of(simulation, controls, OBJECTIVE))
    expected, slope = (sides[0] - sides[1]) / 2e-5, float((found[f"start.{name}"].T[:3].T * way).sum())
    figures.at_most(f"gradient by the start's {name}", abs(slope / expected - 1.0), 1e-4)


def test_starts_with_surfaces_that_touch_are_at_an_edge(floating: Simulation) -> None:
    """Nearer ones keep their depth and others close; controls and materials do not change where a step has led."""
    controls = {name: np.full(STEPS, mean) for name, (mean, _) in SIZES.items()}
    closing = squeezed(*FLOATING, "contact.depth='velocity'", steps=22)
    for simulation, by, share in (
        (floating, ["start.velocity", "friction"], 1.0 / STEPS),
        (floating, ["friction"], 0.0),
        (closing, ["start.velocity"], 0.0),
    ):
        assert gradient(simulation, controls, OBJECTIVE, by).edge_share == share


PARAMETERS = {
    "young_modulus.left": ("soft_bodies.left.young_modulus", 100.0),
    "rayleigh_stiffness.left": ("soft_bodies.left.rayleigh_stiffness", 0.02),
    "rayleigh_mass.left": ("soft_bodies.left.rayleigh_mass", 0.1),
    "density.left": ("soft_bodies.left.density", 1e-6),
    "friction": ("contact.friction", 0.3),
    "mass.cube": ("rigid_bodies.cube.mass", 0.001),
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_gradient_by_what_holds_for_the_run(floating: Simulation, figures: Figures, name: str) -> None:
    """Against runs of scenes with a little more and a little less of it."""
    key, value = PARAMETERS[name]
    controls = drawn(np.random.default_rng(3))
    found = gradient(floating, controls, OBJECTIVE, [name])
    assert found.edge_share == found.inexact_share == 0.0
    others = [f"soft_bodies.right.{key.rpartition('.')[2]}={value}"] if key.startswith("soft") else []
    share = 1e-2 if name.startswith("rayleigh_mass") else 1e-4  # of little effect, near round-off
    sides = []
    for half in (share, -share):
        changed = Simulation(load_scene(TINY_GRIPPER, (*FLOATING, f"{key}={value * (1.0 + half)!r}", *others)))
        changed.restore(floating.state.changed(young_modulus=changed.state.young_modulus))
        sides.append(value_of(changed, controls, OBJECTIVE))
    expected = (sides[0] - sides[1]) / (2.0 * share * value)
    figures.at_most(f"gradient by {name}", float(abs(found[name] / expected - 1.0)), 1e-5)


LAWS: dict[str, dict[str, float]] = {
    "hooke": {"young_modulus": 100.0},
    "neo-hookean": {"young_modulus": 100.0},
    "mooney-rivlin": {"c10": 12.0, "c01": 5.0},
    "yeoh": {"c10": 15.0, "c20": 4.0, "c30": 2.0},
    "ogden": {"mu1": 10.0, "alpha1": 3.0, "mu2": -4.0, "alpha2": -2.0},
}
OF_BODY = {"rayleigh_stiffness": 0.01, "rayleigh_mass": 0.5, "density": 1e-6}


def hollow_block(path: str, law: str, element: str, newton: int, values: Mapping[str, float]) -> Simulation:
    given = {key: values[key] for key in LAWS[law]}
    body = {
        **{
            "mesh": path,
            "element": element,
            "law": law,
            "poisson_ratio": 0.3,
            "cavities": {"air": {"group": "cavity"}},
        },
        **(given if "young_modulus" in given else {"coefficients": given}),
        **{key: values[key] for key in OF_BODY},
        "anchors": [{"box": [[-20.0, -9.0, -9.0], [-9.5, 9.0, 9.0]]}],
    }
    time = {"step": 0.01, "newton": newton, "newton_tolerance": 1e-11}
    return Simulation(scene_from_dict({"time": time, "soft_bodies": {"block": body}}))


@settings(
    max_examples=10, deadline=None, phases=[Phase.generate], suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    law=some.sampled_from(list(LAWS)),
    element=some.sampled_from(["linear", "smoothed"]),
    newton=some.sampled_from([1, 40]),
    drive=some.sampled_from(["pressure", "volume_growth"]),
    seed=some.integers(0, 1000),
)
def test_gradient_by_laws_of_rubber_and_of_converged_steps(
    law: str,
    element: str,
    newton: int,
    drive: str,
    seed: int,
    figures: Figures,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """By controls, start, law, damping and density at once, of a hollow block that swings.

    A single linearisation leaves out negative stiffness, where rubber has kinks: differences are short.
    """
    path = tmp_path_factory.getbasetemp() / "hollow.msh"
    write_volume_mesh(make_block((3, 3, 3), (20.0, 10.0, 10.0), hollow=True), path)
    random, name, values = np.random.default_rng(seed), f"{drive}.block.air", LAWS[law] | OF_BODY
    simulation = hollow_block(str(path), law, element, newton, values)
    for _ in range(3):
        simulation.step(Control(pressure={"block.air": 3.0}))
    start, controls = simulation.state, {name: 4.0 + random.standard_normal(STEPS)}
    objective = Weighted({"tip_positions.block": [1.0, 2.0, 3.0], "volumes.block.air": 0.01})
    by = [name, "start.position", "start.velocity", *(f"{key}.block" for key in values)]
    found = gradient(simulation, controls, objective, by)
    ways = {key: 0.1 * value * random.standard_normal() for key, value in values.items()}
    asked, (moved, pushed) = random.standard_normal(STEPS), random.standard_normal((2, *start.position.shape))
    slope = float(
        found[name] @ asked + 0.01 * (found["start.position"] * moved + found["start.velocity"] * pushed).sum()
    )
    slope += sum(float(found[f"{key}.block"]) * way for key, way in ways.items())
    sides = []
    for half in (1e-4, -1e-4):
        changed = {key: value + half * ways[key] for key, value in values.items()}
        other = hollow_block(str(path), law, element, newton, changed)
        place, speed = start.position + 0.01 * half * moved, start.velocity + 0.01 * half * pushed
        other.restore(start.changed(position=place, velocity=speed, young_modulus=other.state.young_modulus))
        sides.append(value_of(other, {name: controls[name] + half * asked}, objective))
    error = abs(slope / ((sides[0] - sides[1]) / 2e-4) - 1.0)
    figures.at_most(f"gradient, {'converged' if newton > 1 else 'single'} steps", error, 1e-6 if newton > 1 else 1e-4)


def test_steps_that_do_not_converge_are_counted(floating: Simulation) -> None:
    """Three linearisations leave more than 1e-15 mm: the share says it, and the gradient is nearly that of all."""
    few, many = (
        squeezed(*FLOATING, f"time.newton={most}", "time.newton_tolerance=1e-10", steps=22) for most in (3, 30)
    )
    few.restore(many.state)
    controls = drawn(np.random.default_rng(1))
    rough, exact = (gradient(one, controls, OBJECTIVE, list(SIZES)) for one in (few, many))
    assert exact.unconverged_share == 0.0 < rough.unconverged_share
    assert rough["pressure.left.cavity"] == pytest.approx(exact["pressure.left.cavity"], rel=1e-3)
    assert gradient(floating, controls, OBJECTIVE, list(SIZES)).unconverged_share == 0.0


def test_states_are_made_again_with_the_same_bits(floating: Simulation) -> None:
    """A run that keeps few states has the same gradient to the last bit."""
    controls = drawn(np.random.default_rng(1))
    all_kept, few = (gradient(floating, controls, OBJECTIVE, list(SIZES), memory=memory) for memory in (200.0, 1e-6))
    assert all(np.array_equal(all_kept[name], few[name]) for name in SIZES)


def test_meetings_within_a_step_are_counted() -> None:
    """A tendon pulls a finger so fast that it meets the cube after 0.6 of the third step."""
    simulation, name = Simulation(load_scene("cable-gripper", ("limits={}",))), "cable_tension.finger2.tendon"
    objective = Weighted({"tip_positions.finger2": [1.0, 2.0, 3.0]})
    controls = np.array([0.0, 125.0, 250.0, 375.0, 500.0, 500.0, 500.0])
    assert gradient(simulation, {name: controls[:6]}, objective, [name]).inexact_share == 0.0
    assert gradient(simulation, {name: controls}, objective, [name]).inexact_share > 0.0


def test_requests_that_limits_hold_back_have_a_part_of_the_gradient() -> None:
    """A rate limit: the target of each step stands on the one before it; a request beyond reach changes nothing."""
    simulation = Simulation(load_scene("finger-inflated", ("limits.pressure_rate=100.0",)))
    objective = LeastSquares({"bending_angles.finger": np.full(3, 0.5)})
    name = "pressure.finger.cavity"
    found = gradient(simulation, {name: [0.5, 9.0, 1.2]}, objective, [name])
    assert found[name][1] == 0.0 and found[name][0] < 0.0 and found[name][2] < 0.0
    held = gradient(simulation, [Control(pressure={"finger.cavity": 0.5}), None, None], objective, [name])
    assert held[name][0] < found[name][0] and not held[name][1:].any()


def test_gradient_of_a_ball_that_rolls() -> None:
    """A ball that grips at once goes on with 5/7 of its speed, and turns with that over its radius."""
    tables = {
        "rigid_bodies": {
            "ball": {"sphere": {"radius": 10.0}, "mass": 0.01, "position": [0, 0, 10.2], "velocity": [100.0, 0, 0]}
        },
        "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
        "time": {"step": 0.01, "duration": 1.0},
        "contact": {"friction": 0.5, "contact_distance": 0.2, "tolerance": 1e-11},
    }
    objective = Weighted({"object_positions.ball": [1.0, 0.0, 0.0], "object_angular_velocities.ball": [0.0, 1.0, 0.0]})
    simulation, by = Simulation(scene_from_dict(tables)), ["start.rigid_velocity", "friction"]
    found = gradient(simulation, [None] * 10, objective, by)
    assert found["start.rigid_velocity"][0, 0] == pytest.approx(5.0 / 7.0 * (0.01 * 55 + 10 / 10.0), rel=1e-8)
    assert found["friction"] == pytest.approx(0.0, abs=1e-9)


def test_gradient_of_a_cube_that_is_thrown(figures: Figures) -> None:
    """Closed form without soft bodies: v after h is that before and g h, and friction has no say in the air."""
    tables = {
        "rigid_bodies": {"cube": {"box": [10.0, 10.0, 10.0], "mass": 0.01, "position": [0.0, 0.0, 30.0]}},
        "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
        "time": {"step": 0.01, "duration": 1.0},
    }
    simulation = Simulation(scene_from_dict(tables))
    by = ["start.rigid_velocity", "start.rigid_position", "force.cube.x", "friction"]
    found = gradient(simulation, [None] * 4, Weighted({"object_velocities.cube": [1.0, 0.0, 2.0]}), by)
    assert found["start.rigid_velocity"][0] == pytest.approx([4.0, 0.0, 8.0, 0.0, 0.0, 0.0], abs=1e-9)
    assert found["force.cube.x"] == pytest.approx([4.0, 3.0, 2.0, 1.0]) and found["friction"] == 0.0
    fallen = gradient(simulation, [None] * 12, Weighted({"object_positions.cube": [0.0, 0.0, 1.0]}), by)
    assert abs(fallen["start.rigid_position"][0, 2]) < 12.0 and fallen.observation.object_positions["cube"][2] < 6.0


@pytest.mark.parametrize("axes", ["world", "own"])
def test_gradient_by_the_turn_of_a_pushed_cube(figures: Figures, axes: Literal["world", "own"]) -> None:
    """A force from outside beside the centre of mass turns along with its point, one in own axes by itself."""
    simulation = Simulation(load_scene(TINY_GRIPPER, (*FLOATING, "rigid_bodies.cube.position=[0.0, 0.0, 100.0]")))
    push = Force([0.0, 5.0, 0.0], [1.0, 0.0, 2.0], point=[2.0, 0.0, 102.0], axes=axes)
    start, controls, way = simulation.state, [Control(forces={"cube": push}), *[None] * 9], np.array([0.6, -0.8, 0.5])
    objective = Weighted({"object_positions.cube": [3.0, 1.0, 2.0], "object_angular_velocities.cube": [1.0, 2.0, 3.0]})
    slope = gradient(simulation, controls, objective, ["start.rigid_rotation"])["start.rigid_rotation"][0] @ way
    sides = []
    for half in (1e-5, -1e-5):
        turned = Rotation.from_rotvec(half * way) * Rotation.from_quat(start.rigid_rotation[0], scalar_first=True)
        simulation.restore(start.changed(rigid_rotation=turned.as_quat(scalar_first=True)[None]))
        sides.append(sum(objective(simulation.step(control).observation)[0] for control in controls))
    figures.close("gradient by a turn", slope, (sides[0] - sides[1]) / 2e-5, 1e-5 * abs(slope))


def test_speeds_of_the_base_hand_on_the_pose_before(floating: Simulation) -> None:
    """A place that is asked for once moves all that follows at a speed."""
    start = floating.state
    speed = Control(base_velocity=np.array([0.0, 0.0, 20.0]))
    controls = [Control(base_translation=np.array([0.0, 0.0, 1.9])), speed, None, None]
    found = gradient(floating, controls, OBJECTIVE, ["base_translation.z"])["base_translation.z"]
    sides = []
    for half in (1e-4, -1e-4):
        for one in (Control(base_translation=np.array([0.0, 0.0, 1.9 + half])), *controls[1:]):
            floating.step(one)
            sides.append(OBJECTIVE(floating.observe())[0])
        floating.restore(start)
    assert found[0] == pytest.approx((sum(sides[:4]) - sum(sides[4:])) / 2e-4, rel=1e-4) and not found[1:].any()


def test_modulus_is_found_from_a_measured_curve() -> None:
    """L-BFGS on the logarithm of a modulus, from 0.7 of it; the second curve has gaps."""
    simulation = Simulation(load_scene("finger-inflated", ("soft_bodies.finger.regions=[]",)))
    start, curve, steps = simulation.state, [], 12
    controls = {"pressure.finger.cavity": np.linspace(1.0, 12.0, steps)}
    for pressure in controls["pressure.finger.cavity"]:
        simulation.step(Control(pressure={"finger.cavity": float(pressure)}))
        curve.append(simulation.observe().tip_positions["finger"])
    measured = np.array(curve)
    measured[::3, 1] = np.nan

    def misfit(share: np.ndarray) -> tuple[float, np.ndarray]:
        simulation.restore(start.changed(young_modulus=start.young_modulus * np.exp(share)))
        found = gradient(
            simulation, controls, LeastSquares({"tip_positions.finger": measured}), ["young_modulus.finger"]
        )
        return found.value, found["young_modulus.finger"] * simulation.state.young_modulus

    fit = minimize(misfit, np.log([0.7]), jac=True, method="L-BFGS-B")
    assert np.exp(fit.x) == pytest.approx(1.0, abs=1e-4) and fit.nfev < 12


SHAPED = [
    *(("hooke", 1, element, drive) for element in ("linear", "smoothed") for drive in ("pressure", "volume_growth")),
    *(("neo-hookean", 1, "linear", "pressure"), ("neo-hookean", 30, "smoothed", "volume_growth")),
]


@pytest.mark.parametrize(("law", "newton", "element", "drive"), SHAPED)
def test_gradient_by_a_dimension(
    law: str, newton: int, element: str, drive: str, figures: Figures, tmp_path: Path
) -> None:
    """A hollow block grows longer and thicker, each by a number that moves its nodes at rest."""
    mesh = make_block((4, 3, 3), (20.0, 10.0, 10.0), hollow=True)
    moves = {"length": mesh.nodes * [0.1, 0.0, 0.0], "thickness": mesh.nodes * [0.0, 0.1, 0.05]}
    value = {"pressure": 4.0, "volume_growth": 20.0}[drive]

    def grown(changes: Mapping[str, float]) -> Simulation:
        moved = mesh.nodes + sum(share * moves[name] for name, share in changes.items())
        write_volume_mesh(replace(mesh, nodes=moved), tmp_path / "block.msh")
        body = {
            **{"mesh": str(tmp_path / "block.msh"), "element": element, "law": law, "young_modulus": 100.0},
            **{"poisson_ratio": 0.3, "density": 1e-6, "rayleigh_mass": 0.5, "rayleigh_stiffness": 0.01},
            "rotation": [0.0, 20.0, 30.0],
            "anchors": [{"box": [[-20.0, -9.0, -9.0], [-9.5, 9.0, 9.0]]}],
            "cavities": {"cavity": {"group": "cavity"}},
        }
        time = {"step": 0.01, "newton": newton, "newton_tolerance": 1e-11}
        return Simulation(scene_from_dict({"time": time, "soft_bodies": {"block": body}}))

    objective = Weighted({"tip_positions.block": [1.0, 2.0, 3.0], "volumes.block.cavity": 0.01})
    controls = {f"{drive}.block.cavity": np.full(6, value)}
    simulation = grown({})
    turn = Rotation.from_euler("xyz", [0.0, 20.0, 30.0], degrees=True).as_matrix()
    turned = {name: move @ turn.T for name, move in moves.items()}
    found = gradient(simulation, controls, objective, [f"rest.{name}" for name in moves], turned)
    for name in moves:
        sides = [value_of(grown({name: half}), controls, objective) for half in (1e-4, -1e-4)]
        error = abs(float(found[f"rest.{name}"]) / ((sides[0] - sides[1]) / 2e-4) - 1.0)
        figures.at_most(f"gradient by {name}, {law}, {element}, {drive}", error, 2e-5)


def test_gradient_by_a_dimension_between_frames(figures: Figures, tmp_path: Path) -> None:
    """One of the two turns; where its pivot is not given it moves along with the nodes, which is refused."""
    mesh = make_block((4, 2, 2), (20.0, 10.0, 10.0))
    move = mesh.nodes * [0.1, 0.05, 0.0]

    def grown(share: float, **pivot: list[float]) -> Simulation:
        write_volume_mesh(replace(mesh, nodes=mesh.nodes + share * move), tmp_path / "block.msh")
        body = {
            **{"mesh": str(tmp_path / "block.msh"), "density": 1e-6, "young_modulus": 100.0, "poisson_ratio": 0.3},
            "anchors": [
                {"box": [[-20.0, -9.0, -9.0], [-9.5, 9.0, 9.0]], "follows": "left"},
                {"box": [[9.5, -9.0, -9.0], [20.0, 9.0, 9.0]], "follows": "right"},
            ],
        }
        frames = {"left": {}, "right": pivot}
        return Simulation(scene_from_dict({"time": {"step": 0.01}, "frames": frames, "soft_bodies": {"block": body}}))

    def objective(seen: Observation) -> tuple[float, dict[str, np.ndarray]]:
        return float((weight * seen.state.position).sum()), {"state.position": weight}

    weight = np.random.default_rng(3).standard_normal(mesh.nodes.shape)
    controls = [Control(frame_rotation={"right": [0.04 * step, 0.02 * step, 0.03 * step]}) for step in range(1, 5)]
    pivot = [10.0, 0.0, 0.0]
    slope = float(gradient(grown(0.0, pivot=pivot), controls, objective, ["rest.size"], {"size": move})["rest.size"])
    sides = []
    for half in (1e-4, -1e-4):
        simulation = grown(half, pivot=pivot)
        sides.append(sum(objective(simulation.step(control).observation)[0] for control in controls))
    figures.close("gradient by a size", slope, (sides[0] - sides[1]) / 2e-4, 1e-5 * abs(slope))
    with pytest.raises(TaichisoftError, match=r"'rest\.size' moves the pivot of 'right', which turns: give a pivot"):
        gradient(grown(0.0), controls, objective, ["rest.size"], {"size": move})


PUSH = Control(forces={"cube": Force([0.0, 5.0, 0.0])})
REFUSED = {
    "by: 'presure.left.cavity' is nothing": {"by": ["presure.left.cavity"]},
    "by = 'friction': must be a sequence": {"by": "friction"},
    "by: 'friction.left|wall': name two bodies": {"by": ["friction.left|wall"]},
    "objective = 3: must be a function": {"objective": 3},
    "objective gave 1.0: must be": {"objective": lambda seen: 1.0},
    "objective: its derivative by 'volumes' must be finite numbers of shape": {
        "objective": lambda seen: (1.0, {"volumes": [np.nan, 0.0]})
    },
    "figure 'base_force' has no derivative": {"objective": lambda seen: (1.0, {"base_force": [1.0, 0.0, 0.0]})},
    "objective = nan": {"objective": lambda seen: (np.nan, {})},
    r"controls\['pressure.left.cavity'\]: must be a finite number": {"controls": {"pressure.left.cavity": [np.inf]}},
    "controls: must have as many values of each": {"controls": {"a": [1.0], "b": [1.0, 2.0]}},
    r"controls\[0\] = 3: must be a taichisoft.Control": {"controls": [3]},
    r"controls = \[\]": {"controls": []},
    "memory = -1": {"memory": -1},
    "objective = '1' at": {"objective": lambda seen: ("1", {})},
    "its derivative by 'volumes' = 'x': must be a number": {"objective": lambda seen: (1.0, {"volumes": "x"})},
    "by: 'mass.cube' has no gradient in a run with a force on 'cube'": {"controls": [PUSH], "by": ["mass.cube"]},
    r"no gradient with forces\['left'\].axes = 'own'": {
        "controls": [Control(forces={"left": Force([0.0, 5.0, 0.0], point=[-23.0, -6.0, 4.0], axes="own")})]
    },
    r"controls\['base_translation.x'\] = 'x': must be": {"controls": {"base_translation.x": "x"}},
}


@pytest.mark.parametrize("line", REFUSED)
def test_odd_requests_are_refused_in_one_line(floating: Simulation, line: str) -> None:
    given: dict[str, Any] = {"controls": [None], "objective": OBJECTIVE, "by": [], **REFUSED[line]}
    with pytest.raises(TaichisoftError, match=line) as refusal:
        gradient(floating, **given)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("override", ["time.theta=0.5", "time.dynamics='static'"])
def test_scenes_without_gradient_are_refused(override: str) -> None:
    key = override.partition("=")[0]
    with pytest.raises(TaichisoftError, match=f"gradient: .*{key}"):
        gradient(Simulation(load_scene(TINY_GRIPPER, (override,))), [None], OBJECTIVE, [])
