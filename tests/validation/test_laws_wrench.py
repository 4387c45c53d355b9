"""The wrench on the base is what weight, inertia and contacts leave: the momentum of everything that hangs on it."""

from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation, State
from taichisoft.scene import scene_from_dict

STEP = 0.01
GRAVITY = np.array([-9810.0, 0.0, 0.0])
DRAG = 0.1
BOUND = 1e-6
"""Of the largest part of a balance."""


def gripper(time: dict[str, Any] | None = None, tables: dict[str, Any] | None = None, **body: Any) -> Simulation:
    """The shipped finger, which hangs down from its base."""
    table = {
        "mesh": "tutorial-coarse",
        "element": "linear",
        "mass": 0.04,
        "young_modulus": 500,
        "poisson_ratio": 0.3,
        "rayleigh_mass": DRAG,
        "rayleigh_stiffness": 0.02,
        "anchors": [{"box": [[-10, 0, -20], [0, 30, 20]]}],
        "cavities": {"cavity": {"group": "cavity"}},
        **body,
    }
    scene = {"gravity": GRAVITY.tolist(), "time": {"step": STEP, **(time or {})}, "soft_bodies": {"finger": table}}
    return Simulation(scene_from_dict({**scene, **(tables or {})}))


def node_forces(simulation: Simulation, before: State) -> np.ndarray:
    """Weight less inertia and drag of each node in the last step [mN], which other forces must balance, (.., 3)."""
    assert simulation.model.elasticity is not None
    mass, after = simulation.model.elasticity.node_mass[:, None], simulation.state
    return mass * (simulation.state.gravity - (after.velocity - before.velocity) / STEP - DRAG * after.velocity)


def test_at_rest_it_is_the_weight(figures: Figures) -> None:
    """Force m g, and its torque about the pivot, of a finger that hangs bent by its pressure."""
    simulation = gripper(rayleigh_mass=20.0)
    for _ in range(400):
        report = simulation.step(Control(pressure={"finger.cavity": 20.0}))
    seen, model = report.observation, simulation.model
    assert model.elasticity is not None
    weight = model.elasticity.node_mass[:, None] * GRAVITY
    torque = np.cross(simulation.state.position - model.base_pivot, weight).sum(axis=0)
    largest = 0.04 * 9810.0
    figures.at_most("force against m g", float(np.abs(seen.base_force - weight.sum(axis=0)).max()), BOUND * largest)
    figures.at_most(
        "torque against the weight's", np.abs(seen.base_torque - torque).max(), BOUND * np.abs(torque).max()
    )


@pytest.mark.parametrize("kind", ["Hooke", "several linearisations", "rubber", "overdamped"])
def test_in_motion_it_balances_weight_inertia_and_contacts(figures: Figures, kind: str) -> None:
    """The force of every step in which the base moves and turns, and the finger is inflated against a wall and a cube.

    sum m (g - dv/dt - a v) + contact forces on the finger = force on the base.
    """
    box = {"box": [20.0, 20.0, 20.0], "mass": 0.01, "position": [-105.0, -12.0, 0.0]}
    tables: dict[str, Any] = {"obstacles": {"wall": {"plane": {"point": [0, -25, 0], "normal": [0, 1, 0]}}}}
    time: dict[str, Any] = {}
    body: dict[str, Any] = {"rubber": {"law": "neo-hookean", "poisson_ratio": 0.45}}.get(kind, {})
    if kind == "several linearisations":
        time = {"newton": 30, "newton_tolerance": 1e-7}
    if kind == "overdamped":
        time = {"dynamics": "overdamped"}
    else:
        tables["rigid_bodies"] = {"cube": box}
    simulation = gripper(time, tables, **body)
    worst = touched = 0.0
    for number in range(40):
        before = simulation.state
        move = np.array([20.0, -150.0, 10.0]) if number < 20 else np.array([-30.0, 100.0, 0.0])
        simulation.step(
            Control(
                pressure={"finger.cavity": 1.0 * number},
                base_velocity=move,
                base_angular_velocity=np.array([0.3, 0.2, -0.5]),
            )
        )
        state = simulation.state
        finger = simulation.model.body_names.index("finger")
        sign = (state.contact_body_pair == finger) @ np.array([-1.0, 1.0])
        contact = (sign[:, None] * state.contact_impulse).sum(axis=0) / STEP
        if kind == "overdamped":
            assert simulation.model.elasticity is not None
            parts = simulation.model.elasticity.node_mass[:, None] * (GRAVITY - state.velocity)
        else:
            parts = node_forces(simulation, before)
        largest = max(np.abs(parts).sum(axis=0).max(), np.abs(contact).max())
        missed = np.abs(parts.sum(axis=0) + contact - simulation.observe().base_force).max() / largest
        worst, touched = max(worst, float(missed)), max(touched, float(np.abs(contact).max()))
    assert touched > 10.0
    figures.at_most(f"force on the base against the rest, {kind} [of the largest]", worst, BOUND)


def test_its_torque_balances_what_turns(figures: Figures) -> None:
    """Converged implicit Euler: sum (x - pivot) x m (g - dv/dt - a v) = torque on the base, in every step of a turn.

    Without damping by stiffness, which is that of the first linearisation and has a moment of its own.
    """
    simulation = gripper({"newton": 40, "newton_tolerance": 1e-9}, rayleigh_stiffness=0.0)
    worst = 0.0
    for number in range(25):
        before = simulation.state
        turn = np.array([1.0, 0.5, -2.0]) * (1.0 if number < 12 else -1.0)
        simulation.step(
            Control(pressure={"finger.cavity": 1.0 * number}, base_angular_velocity=turn, base_velocity=50.0 * turn)
        )
        pivot = simulation.model.base_pivot + simulation.state.base_translation
        moments = np.cross(simulation.state.position - pivot, node_forces(simulation, before))
        missed = np.abs(moments.sum(axis=0) - simulation.observe().base_torque).max()
        worst = max(worst, float(missed / np.abs(moments).sum(axis=0).max()))
    figures.at_most("torque on the base against the rest [of the largest]", worst, BOUND)


def test_axes_of_the_base(figures: Figures) -> None:
    """A finger that is turned as a whole has the wrench of one that hangs under gravity turned the other way."""
    turn = Rotation.from_rotvec([0.4, -0.7, 0.2])
    turned, straight = gripper(rayleigh_mass=20.0), gripper(rayleigh_mass=20.0)
    for number in range(300):
        share = min(1.0, (number + 1) / 100)
        turned.step(Control(base_rotation=share * turn.as_rotvec()))
        straight.step(Control(gravity=turn.inv().apply(GRAVITY)))
    seen, expected = turned.observe(), straight.observe()
    for name in ("force", "torque"):
        ours, theirs = getattr(seen, f"base_{name}_in_base"), getattr(expected, f"base_{name}")
        figures.at_most(f"{name} in axes of the base", np.abs(ours - theirs).max() / np.abs(theirs).max(), 1e-6)
        assert getattr(seen, f"base_{name}") == pytest.approx(turn.apply(ours), rel=1e-12, abs=1e-6)


def test_a_cable_that_the_base_pulls_pulls_the_base(figures: Figures) -> None:
    """A cable from a pull point that moves with the base: its pull is in the balance; one from space is not."""
    for moves in (True, False):
        cable = {
            "points": [[-60.0, 25.0, 0.0], [-110.0, 25.0, 0.0]],
            "pull_point": [40.0, 60.0, 10.0],
            "pull_point_moves": moves,
        }
        simulation = gripper(cables={"cable": cable}, cavities={})
        for _ in range(20):
            before = simulation.state
            simulation.step(Control(cable_tension={"finger.cable": 900.0}, base_velocity=np.array([10.0, 0.0, 5.0])))
        rest, force = node_forces(simulation, before).sum(axis=0), simulation.observe().base_force
        if moves:
            figures.at_most("force on the base with a cable [mN]", np.abs(rest - force).max(), BOUND * 900.0)
        else:
            pull = np.linalg.norm(force - rest)
            figures.close("pull from space that the base feels nothing of [mN]", float(pull), 900.0, 1e-3)


def test_what_finger_and_palm_do_to_each_other_is_not_on_the_base(figures: Figures) -> None:
    """A finger that bends against a palm on the same base: their contact cancels in the wrench of the step."""
    palm = {"box": [40.0, 10.0, 40.0], "position": [-95.0, 45.0, 0.0], "follows": "base"}
    simulation = gripper(tables={"rigid_bodies": {"palm": palm}})
    worst = pressed = 0.0
    for number in range(50):
        before = simulation.state
        turning = np.array([0.5, 0.2, -1.0])
        seen = simulation.step(
            Control(pressure={"finger.cavity": 1.0 * number}, base_angular_velocity=turning)
        ).observation
        rest = node_forces(simulation, before)
        worst = max(worst, float(np.abs(rest.sum(axis=0) - seen.base_force).max() / np.abs(rest).sum(axis=0).max()))
        pressed = max(pressed, seen.normal_forces.get(("finger", "palm"), 0.0))
    assert pressed > 50.0
    figures.at_most("force on the base of finger and palm [of the largest]", worst, BOUND)
