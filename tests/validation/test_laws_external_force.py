"""Forces from outside, by the scene and by a controller: F / m, compliance, work, and what carries them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures, examples
from energy import total_energy
from hypothesis import given
from hypothesis import strategies as st
from scenes import silicone, simulate
from test_laws_reduced import chamber, write_modes

from taichisoft import Control, Controller, Force, KeyEvent, Session, Simulation, equilibrium, inverse
from taichisoft.base import matrices_from_quaternions
from taichisoft.errors import SceneError, SimulationDiverged, TaichisoftError
from taichisoft.running.loop import run_session
from taichisoft.scene import scene_from_dict

SCENE = {
    "gravity": [0, 0, 0],
    "time": {"step": 0.01},
    "rigid_bodies": {"cube": {"box": [10, 10, 10], "mass": 0.02}, "other": {"box": [10, 10, 10], "mass": 1.0,
                                                                           "position": [0, 50, 0]}},
}  # fmt: skip


def test_a_push_gives_its_impulse_and_no_more():
    """m dv = F t: 0.02 kg and 30 mN for 0.2 s give 300 mm/s; another body, and times outside, are not touched."""
    push = {"body": "cube", "force": [0.0, 0.0, 30.0], "start": 0.1, "duration": 0.2}
    simulation = Simulation(scene_from_dict({**SCENE, "external_forces": [push]}))
    speeds = []
    for _ in range(50):
        simulation.step()
        speeds.append(simulation.state.rigid_velocity[0, 2])
    expected = np.clip(np.arange(1, 51) - 10, 0, 20) * 0.01 * 30.0 / 0.02
    np.testing.assert_allclose(speeds, expected, rtol=1e-12)
    assert not simulation.state.rigid_velocity[1].any()


def test_a_push_on_nothing_is_refused():
    push = {"body": "cub", "force": [0.0, 0.0, 1.0], "start": 0.0, "duration": 1.0}
    with pytest.raises(
        SceneError, match=r"external_forces\.0\.body is 'cub', which is not a rigid body; there are: cube"
    ):
        scene_from_dict({**SCENE, "external_forces": [push]})


# Forces by `Control`.

BALL = {"sphere": {"radius": 5.0}, "mass": 0.002, "position": [1.0, 2.0, 3.0]}
vectors = st.tuples(*3 * [st.floats(-1e3, 1e3)])


@examples(20)
@given(vectors, st.integers(1, 6), st.none() | st.just([1.0, 2.0, 3.0]))
def test_controlled_push_moves_a_ball_by_its_impulse(force: Any, steps: int, point: Any) -> None:
    """m dv = F t, whether its centre of mass is named or not, for as many steps as it was asked for."""
    simulation = simulate(rigid_bodies={"ball": BALL})
    for number in range(8):
        push = {"ball": Force(force, point=point, steps=steps)}
        simulation.step(Control(forces=push) if number == 0 else None)
        done = min(number + 1, steps)
        np.testing.assert_allclose(simulation.state.rigid_velocity[0], 0.01 * done / 0.002 * np.array(force), 1e-12)
        seen = simulation.observe().external_forces["ball"]
        np.testing.assert_array_equal(seen, force if number < steps else np.zeros(3))
    assert np.abs(simulation.state.rigid_angular_velocity).max() < 1e-12


def test_torque_turns_a_ball_by_its_moment_of_inertia() -> None:
    """dw/dt = T / (2/5 m r^2), of a torque and of a force beside the centre of mass alike."""
    torque, seconds = np.array([3.0, -2.0, 5.0]), 1e-3
    expected = seconds * torque / (0.4 * 0.002 * 5.0**2)
    arm = np.cross(torque, [0.0, 0.0, 1.0])
    beside = Force(np.cross(torque, arm) / (arm @ arm), point=arm + BALL["position"])
    for force in (Force(torque=torque), beside):
        simulation = simulate(rigid_bodies={"ball": BALL}, step=1e-5)
        for _ in range(100):
            simulation.step(Control(forces={"ball": force}))
        np.testing.assert_allclose(simulation.state.rigid_angular_velocity[0], expected, atol=1e-3)


@pytest.mark.parametrize("push", [Force([1e9, 0.0, 0.0]), Force(torque=[0.0, 0.0, 1e9]), Force([1e15, 0.0, 0.0])])
def test_absurd_push_is_one_line(push: Force) -> None:
    simulation = simulate(rigid_bodies={"ball": BALL})
    with pytest.raises(SimulationDiverged, match="'ball' exploded: it would "):
        for _ in range(3):
            simulation.step(Control(forces={"ball": push}))


def test_force_in_own_axes_turns_with_the_body() -> None:
    """The force of a step is that at rest, turned as the body is at the step's start; placed turned, it is at rest."""
    box = {"box": [10, 20, 30], "mass": 0.02, "rotation": [10, 20, 30], "angular_velocity": [8.0, -4.0, 2.0]}
    simulation = simulate(rigid_bodies={"box": box})
    force, first = np.array([1.0, 2.0, 3.0]), simulation.state.rigid_rotation
    for _ in range(20):
        before = simulation.state
        simulation.step(Control(forces={"box": Force(force, axes="own")}))
        now, rest = matrices_from_quaternions(np.vstack([before.rigid_rotation, first]))
        gained = 0.02 / 0.01 * (simulation.state.rigid_velocity - before.rigid_velocity)[0]
        np.testing.assert_allclose(gained, now @ rest.T @ force, rtol=1e-9)
        np.testing.assert_allclose(simulation.observe().external_forces["box"], gained, rtol=1e-9)
    assert np.linalg.norm(now @ rest.T @ force - force) > 1.0


def test_work_of_a_push_is_kinetic_energy() -> None:
    """With the midpoint rule, F . dx and T . w h are the gain of energy of a body, to round-off."""
    simulation = simulate(rigid_bodies={"ball": BALL}, time={"step": 0.01, "theta": 0.5})
    force, torque = np.array([5.0, -3.0, 2.0]), np.array([1.0, 4.0, -2.0])
    work = 0.0
    for _ in range(30):
        before = simulation.state
        simulation.step(Control(forces={"ball": Force(force, torque)}))
        after = simulation.state
        work += float(force @ (after.rigid_position - before.rigid_position)[0])
        work += 0.005 * float(torque @ (after.rigid_angular_velocity + before.rigid_angular_velocity)[0])
    assert total_energy(simulation) == pytest.approx(work, rel=1e-9) and work > 1.0


def held_block(block: Callable[..., str], **changes: Any) -> dict[str, Any]:
    anchors = [{"box": [[-20, -20, -20], [-9.9, 20, 20]]}]
    return silicone(block((4, 2, 2), (20.0, 10.0, 10.0)), anchors=anchors, element="linear", **changes)


@pytest.mark.parametrize("newton", [1, 20])
def test_force_at_a_node_is_a_force_of_the_scene(block: Callable[..., str], newton: int) -> None:
    """In motion and at rest; one that is spread over nodes is the sum of those on the nodes."""
    force, time = np.array([0.0, 30.0, -80.0]), {"step": 0.01, "newton": newton, "newton_tolerance": 1e-9}
    corner = [10.0, 5.0, 5.0]
    loaded = held_block(block, forces=[{"box": [corner, corner], "force": force.tolist()}])
    planned = simulate(soft_bodies={"block": loaded}, time=time)
    pushed = simulate(soft_bodies={"block": held_block(block)}, time=time)
    push = Control(forces={"block": Force(force, point=corner)})
    for _ in range(5):
        planned.step()
        pushed.step(push)
    moved = np.abs(planned.state.position - planned.model.rest_position).max()
    np.testing.assert_allclose(pushed.state.position, planned.state.position, atol=1e-8 * moved)
    np.testing.assert_allclose(pushed.state.frame_wrench, planned.state.frame_wrench, atol=1e-6)
    at_rest = equilibrium(pushed, push).state.position
    np.testing.assert_allclose(at_rest, equilibrium(planned).state.position, atol=1e-6 * moved)
    np.testing.assert_allclose(equilibrium(pushed, push).observation.base_force, force, atol=1e-3)
    freed = equilibrium(pushed, Control(forces={"block": None}))
    np.testing.assert_allclose(freed.state.position, pushed.model.rest_position, atol=1e-4)


def test_compliances_of_two_points_are_each_others(block: Callable[..., str]) -> None:
    """Maxwell: what a force at one point moves another, inside elements, is what one there moves the first."""
    simulation = simulate(soft_bodies={"block": held_block(block)})
    points, directions = np.array([[7.3, 1.2, -3.1], [1.7, -4.0, 2.2]]), ([0.0, 1.0, 0.5], [1.0, -1.0, 0.0])
    places = [simulation.model.external_forces.place(0, point) for point in points]
    moved = np.zeros((2, 2))
    for cause in range(2):
        push = Force(1e-3 * np.array(directions[cause]), point=points[cause])
        rest = equilibrium(simulation, Control(forces={"block": push})).state.position - simulation.model.rest_position
        moved[:, cause] = [w @ rest[node] @ to for (node, w), to in zip(places, directions, strict=True)]
    assert moved[0, 1] == pytest.approx(moved[1, 0], rel=1e-4) and np.abs(moved).min() > 0.0


def test_work_at_a_point_of_a_soft_body_is_its_energy(block: Callable[..., str], figures: Figures) -> None:
    """Undamped, by the midpoint rule: sum F . dx of the point is kinetic and elastic energy, to second order.

    In own axes the force turns with the element around its point.
    """
    undamped = {"rayleigh_stiffness": 0.0}
    body = held_block(block, **undamped)
    point, force = np.array([8.0, 2.0, 1.0]), np.array([0.0, 40.0, 20.0])
    for axes in ("world", "own"):
        time = {"step": 5e-4, "theta": 0.5, "newton": 20, "newton_tolerance": 1e-9}
        simulation = simulate(soft_bodies={"block": body}, time=time)
        node, weight = simulation.model.external_forces.place(0, point)
        work, control = 0.0, Control(forces={"block": Force(force, point=point, axes=axes)})
        for _ in range(60):
            before = weight @ simulation.state.position[node]
            simulation.step(control)
            seen = simulation.observe().external_forces["block"]
            work += float(seen @ (weight @ simulation.state.position[node] - before))
        assert work > 1.0
        share = abs(total_energy(simulation) / work - 1.0)
        figures.at_most(f"work of a force in {axes} axes against energy", share, 0.01)


def test_free_soft_body_gains_momentum_and_spin(block: Callable[..., str]) -> None:
    """m dv = F t of the centre of mass; d(x cross m v) = sum of r cross F t about the origin."""
    table = silicone(block((3, 2, 2), (20.0, 10.0, 10.0)), element="linear", rayleigh_stiffness=0.0)
    simulation = simulate(soft_bodies={"block": table}, step=1e-4)
    assert simulation.model.elasticity is not None
    mass, force, point = simulation.model.elasticity.node_mass[:, None], np.array([1.0, -2.0, 3.0]), [9.0, 4.0, -3.0]
    for _ in range(20):
        simulation.step(Control(forces={"block": Force(force, point=point)}))
    state = simulation.state
    np.testing.assert_allclose((mass * state.velocity).sum(axis=0), 20 * 1e-4 * force, rtol=1e-6)
    spin = np.cross(state.position, mass * state.velocity).sum(axis=0)
    np.testing.assert_allclose(spin, 20 * 1e-4 * np.cross(point, force), rtol=1e-3)


@pytest.mark.parametrize("newton", [1, 20])
def test_observed_force_in_own_axes_changes_the_momentum(block: Callable[..., str], newton: int) -> None:
    """Of a free soft body, whose tetrahedron around the point turns by more than 0.05 in a step."""
    body = silicone(block((3, 2, 2), (20.0, 10.0, 10.0)), element="linear")
    time = {"step": 0.005, "newton": newton, "newton_tolerance": 1e-12}
    simulation = simulate(soft_bodies={"block": body}, time=time)
    assert simulation.model.elasticity is not None
    mass, push = simulation.model.elasticity.node_mass, Force([0.0, 60.0, 0.0], point=[9.0, 0.0, 0.0], axes="own")
    directions = []
    for _ in range(12):
        before = mass @ simulation.state.velocity
        simulation.step(Control(forces={"block": push}))
        gained = (mass @ simulation.state.velocity - before) / 0.005
        np.testing.assert_allclose(simulation.observe().external_forces["block"], gained, atol=0.01)
        directions.append(gained / 60.0)
    assert np.linalg.norm(np.diff(directions, axis=0), axis=1).max() > 0.05


def test_force_on_modes_is_that_on_the_full_body(tmp_path: Path) -> None:
    """With all modes, while it acts and after it; so is the equilibrium."""
    full = simulate(soft_bodies={"chamber": chamber(tmp_path)})
    modes = write_modes(tmp_path / "all.npz", full)
    reduced = simulate(soft_bodies={"chamber": chamber(tmp_path, reduced=modes)})
    node = full.model.rest_position[:, 0].argmax()
    push = Control(forces={"chamber": Force([0.0, 20.0, -60.0], point=full.model.rest_position[node], steps=4)})
    for number in range(8):
        for simulation in (full, reduced):
            simulation.step(push if number == 0 else None)
        np.testing.assert_allclose(reduced.state.position, full.state.position, atol=1e-9)
        np.testing.assert_allclose(reduced.state.frame_wrench, full.state.frame_wrench, atol=1e-4)
        assert reduced.report is not None and reduced.report.imbalance["chamber"] < 1e-6
    rest = [equilibrium(simulation, push).state.position for simulation in (full, reduced)]
    assert np.abs(rest[0] - full.model.rest_position).max() > 0.05
    np.testing.assert_allclose(rest[1], rest[0], atol=1e-6)


def test_what_drives_a_frame_holds_against_a_push() -> None:
    """It moves as without, and feels force and r cross F more: on itself, and on what it carries."""
    palm = {"box": [10, 10, 10], "follows": "arm", "position": [0, 30, 0]}
    tables = {"frames": {"arm": {"pivot": [0, 10, 0], "follows": "base"}}, "rigid_bodies": {"palm": palm}}
    force, point, turn = np.array([1.0, 2.0, 3.0]), np.array([4.0, 25.0, 0.0]), np.array([0.0, 0.0, np.pi / 2])
    rotated = Control(frame_rotation={"arm": turn})
    bare = simulate(**tables)
    bare.step(rotated)
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for name, own in (("arm", False), ("palm", True)):
        push = Force(force, [7.0, 0.0, 0.0] if own else np.zeros(3), point, "own" if own else "world")
        simulation = simulate(**tables)
        simulation.step(Control(frame_rotation={"arm": turn}, forces={name: push}))
        state = simulation.state
        np.testing.assert_array_equal(state.rigid_position, bare.state.rigid_position)
        np.testing.assert_array_equal(state.rigid_velocity, bare.state.rigid_velocity)
        acting = turned @ force if own else force
        torque = np.cross(turned @ (point - [0, 10, 0]), acting) + (turned @ [7.0, 0.0, 0.0] if own else 0.0)
        more = state.frame_wrench - bare.state.frame_wrench
        np.testing.assert_allclose(more[1], [acting, torque], atol=1e-9)
        np.testing.assert_allclose(more[0, 0], acting, atol=1e-9)
        np.testing.assert_allclose(simulation.observe().external_forces[name], acting)


def test_drive_does_the_work_of_a_push_on_what_it_turns() -> None:
    """By the midpoint rule: its torque times the turn is F . dx, to the second order of the turn, on frame and body."""
    palm, turn, point = {"box": [10, 10, 10], "follows": "arm"}, 0.1, np.array([[4.0, 25.0, 0.0]])
    for name in ("arm", "palm"):
        simulation = simulate(
            frames={"arm": {"pivot": [0, 10, 0]}}, rigid_bodies={"palm": palm}, time={"step": 0.01, "theta": 0.5}
        )
        places, work = [], []
        for number in range(9):
            push = {name: Force([1.0, 2.0, 0.0], point=point[0])}
            simulation.step(Control(frame_rotation={"arm": [0.0, 0.0, turn * number]}, forces=push))
            places.append(simulation.model.places(simulation.state).moved(point, 1)[0])
            work.append(simulation.state.frame_wrench[1, 1, 2] * turn)
        np.testing.assert_allclose(np.diff(places, axis=0) @ [1.0, 2.0, 0.0], work[1:], rtol=turn**2 / 10)


def test_inverse_statics_finds_a_force(block: Callable[..., str]) -> None:
    """The one that bends a block so: what acts from the start on has a place, and may vary."""
    simulation = simulate(soft_bodies={"block": held_block(block, tip={"box": [[9.9, -9, -9], [11, 9, 9]]})})
    point = [10.0, 5.0, 5.0]
    bent = equilibrium(simulation, Control(forces={"block": Force([0.0, 0.0, 42.0], point=point)})).observation
    simulation.step(Control(forces={"block": Force(point=point)}))
    bounds = {"forces.block.force.z": (-100.0, 100.0)}
    found = inverse(simulation, {"tip_positions.block": bent.tip_positions["block"]}, bounds)
    assert found.values["forces.block.force.z"] == pytest.approx(42.0, abs=0.05)


class Idle(Controller):
    def control(self, observation: Any) -> Control:
        return Control()


def test_pointer_holds_a_body_by_a_spring() -> None:
    """Of 400 / s^2 times its mass: it hangs 9810 / 400 mm below, under the point where it was picked, and not longer.

    Later places move the spring's end; a body of another name cannot be pulled.
    """
    cube = {"box": [10, 10, 10], "mass": 0.002, "position": [1.0, 2.0, 3.0], "rotation": [0, 0, 20]}
    simulation = simulate(
        gravity=(0.0, 0.0, -9810.0), rigid_bodies={"cube": cube, "other": {**cube, "position": [50, 0, 0]}}
    )
    session = Session(simulation, Idle(), duration=6.0)
    picked, last = np.array([2.0, 3.0, 8.0]), np.array([2.0, 23.0, 18.0])
    for place in (picked, 0.5 * (picked + last), last):
        session.keys.put(KeyEvent("cube", pointer=tuple(place.tolist())))
    run_session(session)
    state = simulation.state
    turned = matrices_from_quaternions(
        np.vstack([state.rigid_rotation[0], simulation.model.rigid_bodies[0].start_rotation])
    )
    held = state.rigid_position[0] + turned[0] @ turned[1].T @ (picked - cube["position"])
    np.testing.assert_allclose(held, last - np.array([0.0, 0.0, 9810.0 / 400.0]), atol=0.05)
    assert state.rigid_position[0, :2] == pytest.approx(held[:2], abs=0.2)
    after = Session(simulation, Idle(), duration=0.1)
    after.keys.put(KeyEvent("cub", pointer=(0.0, 0.0, 0.0)))
    with pytest.raises(TaichisoftError, match="no body that can be pulled is called 'cub'; did you mean 'cube'"):
        run_session(after)


def test_equilibrium_takes_no_step_of_a_push(block: Callable[..., str]) -> None:
    """Steps that go on from it have all of the push before them."""
    simulation = simulate(soft_bodies={"block": held_block(block)})
    push = Force([0.0, 9.0, 0.0], point=[10.0, 0.0, 0.0], steps=2)
    simulation.restore(equilibrium(simulation, Control(forces={"block": push})).state)
    seen = []
    for _ in range(3):
        simulation.step()
        seen.append(float(simulation.observe().external_forces["block"][1]))
    assert seen == [9.0, 9.0, 0.0]
