"""Equilibria: closed forms, the ends of motions, and what has none."""

from typing import Any

import numpy as np
import pytest
from conftest import Figures

from taichisoft import Control, Simulation, equilibrium, load_scene, scene_from_dict
from taichisoft.errors import ControlError, EquilibriumNotFound, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER

WALL = (
    "rigid_bodies={}",
    "limits={highest_pressure=1000.0, pressure_rate=1.0}",
    "obstacles={wall={box=[10.0, 40.0, 40.0], translation=[0.0, 0.0, 20.0]}}",
)
"""In place of the cube; the limit of the rate is one of motion, not of equilibria."""


@pytest.fixture(scope="module")
def pads() -> Simulation:
    return Simulation(load_scene(TINY_GRIPPER, WALL))


def squeeze(pressure: float, **others: Any) -> Control:
    return Control(pressure={"left.cavity": pressure, "right.cavity": pressure}, **others)


@pytest.mark.parametrize("element", ["linear", "smoothed"])
def test_a_bar_stretches_under_its_weight(block: Any, figures: Figures, element: str) -> None:
    """u = rho g L^2 / (2 E) at its end, without lateral contraction: linear elements have it exactly at
    their nodes, but for a strain of 0.4 %, by which the rotation of a tetrahedron is not quite 0."""
    length, modulus, density, gravity = 40.0, 100.0, 1e-6, 9810.0
    finger = {
        "mesh": block((2, 2, 16), (5.0, 5.0, length)),
        "element": element,
        "young_modulus": modulus,
        "poisson_ratio": 0.0,
        "density": density,
        "anchors": [{"box": [[-3.0, -3.0, 0.499 * length], [3.0, 3.0, length]]}],
    }
    scene = {"soft_bodies": {"bar": finger}, "gravity": [0.0, 0.0, -gravity], "time": {"dynamics": "static"}}
    simulation = Simulation(scene_from_dict(scene))
    simulation.step()
    low = simulation.model.rest_position[:, 2] == simulation.model.rest_position[:, 2].min()
    sunk = -(simulation.state.position - simulation.model.rest_position)[low, 2].mean()
    figures.close("extension of a hanging bar, mm", sunk, density * gravity * length**2 / (2.0 * modulus), 2e-5)
    assert not simulation.state.velocity.any()


@pytest.mark.parametrize("friction", [0.0, 0.6])
def test_an_equilibrium_is_where_a_motion_comes_to_rest(pads: Simulation, figures: Figures, friction: float) -> None:
    """Two pads that air presses on a wall, from the same start. With friction the way matters, so the motion begins
    where the equilibrium has ended and must stay there."""
    simulation = Simulation(pads.model.varied(friction=friction))
    found = equilibrium(simulation, squeeze(10.0))
    forces = found.observation.normal_forces
    assert forces["left", "wall"] > 100.0 and found.state.time == simulation.state.time == 0.0
    if friction:
        simulation.restore(found.state)
    for _ in range(100 if friction else 1500):
        simulation.step(squeeze(10.0))
    moved = float(np.abs(simulation.state.position - found.state.position).max())
    figures.at_most(f"from the end of a motion, friction {friction:g}, mm", moved, 1e-4)
    settled = simulation.observe().normal_forces["left", "wall"]
    assert forces["left", "wall"] == pytest.approx(settled, rel=1e-4)


def test_bodies_that_a_large_load_drives_together_do_not_pass_each_other(figures: Figures) -> None:
    """Two pads without anything between them, which a single step would drive through each other."""
    free = ("rigid_bodies={}", "obstacles={}", "limits={}")
    simulation = Simulation(load_scene(TINY_GRIPPER, free))
    found = equilibrium(simulation, squeeze(40.0))
    assert found.increments > 3 and found.observation.normal_forces["left", "right"] > 10.0
    simulation.restore(found.state)
    for _ in range(100):
        simulation.step(squeeze(40.0))
    moved = float(np.abs(simulation.state.position - found.state.position).max())
    figures.at_most("pads driven together, from the end of a motion, mm", moved, 1e-4)


def test_the_time_step_and_the_way_do_not_matter_without_friction(pads: Simulation) -> None:
    """From rest at once, and by way of another pressure; with steps of 1 ms and 0.1 s."""
    ends = []
    for step, way in ((0.001, (8.0,)), (0.1, (8.0,)), (0.01, (3.0, 12.0, 8.0))):
        simulation = Simulation(load_scene(TINY_GRIPPER, [*WALL, f"time.step={step}", "contact.friction=0.0"]))
        for pressure in way:
            found = equilibrium(simulation, squeeze(pressure))
            simulation.restore(found.state)
        ends.append(found.state.position)
    assert np.abs(ends[1] - ends[0]).max() < 1e-5
    assert np.abs(ends[2] - ends[0]).max() < 1e-5


def test_a_base_takes_its_fingers_along(pads: Simulation) -> None:
    """An equilibrium far from the wall is the same elsewhere; the limits of the base's speed have no say."""
    shift = np.array([0.0, 100.0, 20.0])
    here = equilibrium(pads, squeeze(2.0))
    there = equilibrium(pads, squeeze(2.0, base_translation=shift))
    np.testing.assert_allclose(
        there.state.position - here.state.position, np.tile(shift, (pads.model.node_count, 1)), atol=1e-6
    )
    assert there.state.base_translation.tolist() == shift.tolist()
    pads_there = Simulation(pads.model)
    pads_there.restore(there.state)
    pads_there.step()
    assert np.abs(pads_there.state.position - there.state.position).max() < 1e-6


def test_a_volume_that_is_imposed_is_reached(pads: Simulation) -> None:
    rest = pads.model.cavities.rest_value[0]
    found = equilibrium(pads, Control(volume_growth={"left.cavity": 150.0}))
    assert found.observation.volumes["left.cavity"] == pytest.approx(rest + 150.0, abs=1e-4)
    again = equilibrium(pads, Control(pressure={"left.cavity": found.observation.pressures["left.cavity"]}))
    assert again.observation.volumes["left.cavity"] == pytest.approx(rest + 150.0, abs=1e-3)


def test_a_run_in_statics_goes_from_one_equilibrium_to_the_next() -> None:
    simulation = Simulation(load_scene(TINY_GRIPPER, [*WALL, 'time.dynamics="static"', "limits.pressure_rate=300.0"]))
    dynamic = Simulation(load_scene(TINY_GRIPPER, WALL))
    for pressure in (3.0, 6.0, 9.0):
        report = simulation.step(squeeze(pressure))
        found = equilibrium(dynamic, squeeze(pressure))
        dynamic.restore(found.state)
        assert report.converged and report.newton_residual <= 1e-7
        np.testing.assert_allclose(simulation.state.position, found.state.position, atol=1e-6)


def test_loads_that_nothing_carries_are_said(pads: Simulation) -> None:
    with pytest.raises(EquilibriumNotFound, match=r"'left' has no equilibrium at 0 s, beyond 0\.0% of the change"):
        equilibrium(Simulation(load_scene(TINY_GRIPPER, [*WALL, "limits.highest_pressure=1e9"])), squeeze(1e7))
    with pytest.raises(ControlError, match="middle"):
        equilibrium(pads, Control(pressure={"middle": 1.0}))


def test_a_cube_is_grasped_and_lifted_without_waiting(figures: Figures) -> None:
    """Friction of the pads carries its weight, and a motion that begins there stays there."""
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    for height in (0.0, 4.0):
        found = equilibrium(simulation, squeeze(9.0, base_translation=np.array([0.0, 0.0, height])))
        simulation.restore(found.state)
    state, step = found.state, simulation.model.scene.time.step
    assert not state.rigid_velocity.any() and not state.rigid_angular_velocity.any()
    assert state.rigid_position[0, 2] == pytest.approx(9.2, abs=0.2), "it rises with the base"
    cube = simulation.model.body_names.index("cube")
    side = (state.contact_body_pair[:, 1] == cube) * 1.0 - (state.contact_body_pair[:, 0] == cube)
    carried = (side[:, None] * state.contact_impulse).sum(axis=0) / step
    weight = simulation.model.rigid_mass[0] * simulation.model.gravity
    figures.at_most("forces and weight of a held cube, mN", float(np.abs(carried + weight).max()), 1e-3)
    for _ in range(50):
        simulation.step()
    moved = float(np.abs(simulation.state.rigid_position - state.rigid_position).max())
    figures.at_most("from the end of a motion, a held cube, mm", moved, 1e-4)


def test_a_tolerance_far_below_the_rest_of_rigid_bodies_is_reached() -> None:
    """Without friction a cube between pads, pressed a little more on one side, comes to rest slowly: its last moves
    are far below those that count as rest, and yet above a fine tolerance of Newton's method."""
    fine = ("contact.friction=0.0", "contact.tolerance=1e-10", "time.newton_tolerance=1e-11", "time.dynamics='static'")
    simulation = Simulation(load_scene(TINY_GRIPPER, (*fine, "time.step=0.5")))
    simulation.step(squeeze(9.0))
    report = simulation.step(Control(pressure={"left.cavity": 10.001, "right.cavity": 10.0}))
    assert report.newton_residual is not None and report.newton_residual <= 1e-11


def test_a_start_that_is_not_at_rest_is_left_in_short_moves() -> None:
    """At its own weight a pad sinks by more than half of the alarm distance; it may touch the cube on the way."""
    heavy = ("soft_bodies.left.density=2e-5", "contact.alarm_distance=0.3", "limits={}")
    simulation = Simulation(load_scene(TINY_GRIPPER, heavy))
    found = equilibrium(simulation)
    assert np.abs(found.state.position - simulation.state.position).max() > 0.2
    simulation.restore(found.state)
    simulation.step()
    assert np.abs(simulation.state.position - found.state.position).max() < 1e-5


def test_bodies_that_are_not_held_are_said() -> None:
    falling = ("obstacles={}", 'time.dynamics="static"', "time.step=0.1")
    simulation = Simulation(load_scene(TINY_GRIPPER, falling))
    before = simulation.state
    with pytest.raises(
        EquilibriumNotFound,
        match=r"body 'cube' does not come to rest at 0 s: after 300 moves it still goes 0\.9 mm at a time; nothing hol",
    ):
        simulation.step()
    assert simulation.state == before and simulation.observe().time == 0.0
    with pytest.raises(SceneError, match=r"take taichisoft\.equilibrium\(simulation, control\)\.linearise\(\)"):
        simulation.linearise(squeeze(1.0, base_translation=np.ones(3)))
    loose = (*WALL, "soft_bodies.left.anchors=[]")
    with pytest.raises(SceneError, match="an equilibrium needs anchors of every soft body; 'left' has none"):
        equilibrium(Simulation(load_scene(TINY_GRIPPER, loose)))
    with pytest.raises(SceneError, match=r"time\.dynamics = 'static' needs anchors of every soft body"):
        load_scene(TINY_GRIPPER, [*loose, 'time.dynamics="static"'])


@pytest.mark.parametrize("step", [0.001, 0.5])
def test_friction_holds_a_box_up_to_its_angle(figures: Figures, step: float) -> None:
    """Coulomb: a box rests on a slope as long as tan(angle) < friction, and the floor carries its weight, whatever the
    step. In the frame of the slope it is gravity that is inclined. The solver's tolerance of 1e-5 mm/s times m / h is
    1e-8 mN and less."""
    mass, friction, weight = 0.01, 0.5, 98.1
    scene = {
        "time": {"step": step, "dynamics": "static"},
        "contact": {"friction": friction},
        "rigid_bodies": {"box": {"box": [10.0, 10.0, 4.0], "mass": mass, "position": [0.0, 0.0, 2.2]}},
        "obstacles": {"floor": {"plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}},
    }
    simulation = Simulation(scene_from_dict(scene))

    def tilted(slope: float) -> Control:
        angle = np.arctan(slope)
        return Control(gravity=9810.0 * np.array([np.sin(angle), 0.0, -np.cos(angle)]))

    for slope in (0.0, 0.98 * friction):
        report = simulation.step(tilted(slope))
        missing = np.abs(report.contact_forces.sum(axis=0)) - mass * np.abs(simulation.state.gravity)
        figures.at_most(f"force and weight of a box, slope {slope:g}, mN", float(np.abs(missing).max()), 1e-6 * weight)
    figures.at_most(
        "way of a box that friction holds, mm", float(np.abs(simulation.state.rigid_position[0, :2]).max()), 1e-4
    )
    with pytest.raises(EquilibriumNotFound, match=f"'box' does not come to rest at {2 * step:g} s"):
        simulation.step(tilted(1.02 * friction))
    assert simulation.state.step == 2


def test_a_static_grasp_is_that_of_a_slow_motion(figures: Figures) -> None:
    """Close, lift by 4 mm, let go: on its support the floor carries the weight, lifted the friction of the pads, and
    the slow motion ends at the same heights and forces. Before friction sticks its way matters, by hundredths of mm."""
    static = Simulation(load_scene(TINY_GRIPPER, ('time.dynamics="static"', "time.step=0.1", "limits={}")))
    dynamic = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    weight = static.model.rigid_mass[0] * 9810.0
    cube = static.model.body_names.index("cube")
    pressure = height = 0.0
    for name, goal, up in (("stands", 0.0, 0.0), ("gripped", 9.0, 0.0), ("lifted", 9.0, 4.0), ("released", 0.0, 4.0)):
        report = static.step(squeeze(goal, base_translation=np.array([0.0, 0.0, up])))
        for share in np.linspace(0.0, 1.0, 40):
            lift = np.array([0.0, 0.0, height + share * (up - height)])
            moved = dynamic.step(squeeze(pressure + share * (goal - pressure), base_translation=lift))
        for _ in range(40):
            moved = dynamic.step()
        pressure, height = goal, up
        side = (report.contact_bodies[:, 1] == cube) * 1.0 - (report.contact_bodies[:, 0] == cube)
        carried = (side[:, None] * report.contact_forces).sum(axis=0)
        missing = float(np.abs(carried - [0.0, 0.0, weight]).max())
        figures.at_most(f"forces and weight of a cube that is {name}, mN", missing, 1e-3)
        seen, slow = report.observation, moved.observation
        assert seen.object_positions["cube"][2] == pytest.approx(slow.object_positions["cube"][2], abs=0.02)
        force = seen.normal_forces.get(("left", "cube"), 0.0)
        assert force == pytest.approx(slow.normal_forces.get(("left", "cube"), 0.0), rel=0.01, abs=0.01)
        assert report.converged and not static.state.rigid_velocity.any()
    assert seen.object_positions["cube"][2] == pytest.approx(5.2, abs=1e-3), "it has come down to the floor"


def test_a_model_that_was_changed_is_followed(pads: Simulation) -> None:
    simulation = Simulation(pads.model)
    sticking = equilibrium(simulation, squeeze(12.0))
    simulation.change_model(pads.model.varied(friction=0.0))
    sliding = equilibrium(simulation, squeeze(12.0))
    assert sticking.observation.friction_forces["left", "wall"] > 1.0
    assert sliding.observation.friction_forces["left", "wall"] < 1e-6
