"""Derivatives of steps and of equilibria: against differences of what they are derivatives of, and a closed form.

Differences over some 1e-3 of a control's unit have relative errors below 1e-7 here, once the contact solver stops at
1e-11 mm/s and not at 1e-5: derivatives must agree with them to 1e-6 of the largest entry of a figure.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cable_block
import numpy as np
import pytest
from conftest import Figures
from scenes import simulate
from test_laws_reduced import chamber, write_modes

from taichisoft import Control, Force, Observation, Simulation, equilibrium, load_scene, scene_from_dict
from taichisoft.control import find_figure
from taichisoft.errors import ControlError, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER

EXACT = "contact.tolerance=1e-11"
NONLINEAR = ("time.newton=30", "time.newton_tolerance=1e-12", "contact.depth='velocity'")
"""Without the shift of overlapping surfaces, whose own derivative is left out: 1e-5 of that of the tip here."""
WALL = (
    "rigid_bodies={}",
    "limits={highest_pressure=1000.0}",
    "obstacles={wall={box=[10.0, 40.0, 40.0], translation=[0.0, 0.0, 20.0]}}",
)


def squeeze(pressure: float, **others: Any) -> Control:
    return Control(pressure={"left.cavity": pressure, "right.cavity": pressure}, **others)


def shifted(control: Control, name: str, amount: float) -> Control:
    """With more of what a name of a linearisation means."""
    key, _, of = name.partition(".")
    value = getattr(control, key)
    if key == "forces":
        body, part, letter = of.split(".")
        row = np.array(getattr(value[body], part)) + amount * np.eye(3)["xyz".index(letter)]
        return replace(control, forces={**value, body: replace(value[body], **{part: row})})
    if isinstance(value, np.ndarray):
        return replace(control, **{key: value + amount * np.eye(3)["xyz".index(of)]})
    return replace(control, **{key: {**value, of: value[of] + amount}})


def differences(
    simulation: Simulation, see: Callable[[Control], Observation], control: Control, name: str, figures: Sequence[str]
) -> dict[str, Any]:
    """Of figures by a control, from the simulation's present state."""
    start, bodies, found = simulation.state, simulation.model.body_names, dict.fromkeys(figures, 0.0)
    half = 3e-4 if "rotation" in name else 1e-3
    for share, weight in ((-1.0, 1.0), (-0.5, -8.0), (0.5, 8.0), (1.0, -1.0)):  # exact up to the third power
        simulation.restore(start)
        seen = see(shifted(control, name, share * half))
        for figure in figures:
            found[figure] += weight / (6.0 * half) * find_figure(figure, seen, bodies).of(seen)
    simulation.restore(start)
    return found


def push_on_pad(simulation: Simulation) -> Force:
    """Inside an element, in axes that turn with it."""
    rest = simulation.model.soft_bodies[0].rest_position
    return Force([1.0, 2.0, 0.0], point=0.99 * rest[-1] + 0.01 * rest.mean(axis=0), axes="own")


def stepped(simulation: Simulation) -> Callable[[Control], Observation]:
    def see(control: Control) -> Observation:
        simulation.step(control)
        return simulation.observe()

    return see


def largest_error(
    simulation: Simulation, control: Control, names: Sequence[str], figures: Sequence[str], tolerance: float = 1e-6
) -> float:
    """Of a step's derivatives against differences, over the largest entry of each figure."""
    found = simulation.linearise(control, names)
    assert found.controls == tuple(names) and set(found.units) <= {"kPa", "mm", "rad", "mN", "mN mm", "1"}
    worst = 0.0
    for column, name in enumerate(names):
        for figure, expected in differences(simulation, stepped(simulation), control, name, figures).items():
            size = max(float(np.abs(expected).max()), 1e-4)
            error = float(np.abs(found[figure][..., column] - expected).max()) / size
            assert error < tolerance, (name, figure, error, size)
            worst = max(worst, error)
    return worst


@pytest.mark.parametrize("overrides", [(), NONLINEAR], ids=["one linearisation", "converged"])
def test_a_step_that_lifts_a_cube(figures: Figures, overrides: tuple[str, ...]) -> None:
    """Sticking contacts between soft pads and a rigid cube; nothing else of the simulation changes."""
    free = ("limits={}", EXACT, *overrides)
    simulation = Simulation(load_scene(TINY_GRIPPER, free))
    for pressure in np.linspace(0.0, 9.0, 15):
        simulation.step(squeeze(pressure))
    simulation.step(squeeze(9.0, base_translation=np.array([0.0, 0.0, 0.1])))
    control = squeeze(9.0, base_translation=np.array([0.0, 0.0, 0.3]), base_rotation=np.zeros(3))
    names = ("pressure.left.cavity", "base_translation.z", "base_rotation.y")
    seen = ("tip_positions.left", "object_positions.cube", "object_velocities.cube", "normal_forces.left|cube")
    every = (*seen, "friction_forces.left|cube", "base_force", "volumes", "state.position")
    start = simulation.state
    simulation.step(control)
    end = simulation.state
    simulation.restore(start)
    assert simulation.linearise(control, ()).observation.state == end
    tolerance = 5e-6 if overrides else 1e-6  # what Newton's method leaves, 1e-12 mm, is noise in differences of 1e-3
    error = largest_error(simulation, control, names, every, tolerance)
    figures.at_most(f"derivatives of a lift, {overrides}", error, tolerance)
    simulation.linearise(control)
    assert simulation.state is start
    simulation.step(control)
    assert simulation.state == end


@pytest.mark.parametrize("friction", [0.05, 0.6])
def test_a_static_step_in_which_contacts_slide_and_stick(figures: Figures, friction: float) -> None:
    """Pads on a wall: friction turns with the sliding and grows with the pressure.

    A step searches contacts again where it has ended, and its derivative does not: 1.2e-6 of a friction force."""
    settings = (*WALL, EXACT, 'time.dynamics="static"', "time.newton_tolerance=1e-11", f"contact.friction={friction}")
    simulation = Simulation(load_scene(TINY_GRIPPER, settings))
    simulation.step(squeeze(8.5))
    simulation.step(squeeze(9.0))
    control = squeeze(10.0, base_translation=np.zeros(3))
    slips = simulation.linearise(control, ()).observation.state.contact_slip
    assert slips.any()
    seen = ("tip_positions.left", "normal_forces.left|wall", "friction_forces.left|wall", "base_force", "volumes")
    error = largest_error(simulation, control, ("pressure.left.cavity", "base_translation.z"), seen, 3e-6)
    figures.at_most(f"derivatives of sliding pads, friction {friction:g}", error, 3e-6)


@pytest.mark.parametrize("newton", [1, 30])
def test_a_cable_that_rubs_and_one_that_pulls_a_cube(tmp_path: Path, figures: Figures, newton: int) -> None:
    """The tendon slides at its three points, whose grip changes with the pull point on the base and with the body."""
    tables = cable_block.cable_scene(tmp_path).model_dump(exclude_unset=True)
    tables["time"] |= {"newton": newton, "newton_tolerance": 1e-12}
    simulation = Simulation(scene_from_dict({**tables, "contact": {"tolerance": 1e-11}}))
    for step in range(3):
        simulation.step(cable_block.control(step))
    control = replace(cable_block.control(3), base_translation=np.zeros(3))
    names = (f"cable_pull.{cable_block.TENDON}", f"cable_tension.{cable_block.LINK}", "base_translation.y")
    seen = ("tip_positions.block", "object_positions.cube", "cable_tensions", "cable_lengths", "base_torque")
    figures.at_most(f"derivatives of cables, newton = {newton}", largest_error(simulation, control, names, seen), 1e-6)


@pytest.mark.parametrize("settings", [(), (*NONLINEAR, "rigid_bodies.cube.position=[0.0, 0.0, 80.0]")])
def test_pushes_have_columns(figures: Figures, settings: tuple[str, ...]) -> None:
    """On a pad inside an element and in its own axes, beside the centre of a cube that is lifted, and on the base."""
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}", EXACT, *settings)))
    for pressure in np.linspace(0.0, 9.0, 15):
        simulation.step(squeeze(pressure))
    simulation.step(squeeze(9.0, base_translation=np.array([0.0, 0.0, 0.1])))
    pushes = {"left": push_on_pad(simulation), "base": Force(torque=[0.0, 3.0, 0.0])}
    pushes["cube"] = Force([0.3, 0.0, 0.0], [0.0, 0.1, 0.0], point=[3.0, 0.0, 5.0], steps=3)
    names = ("forces.left.force.y", "forces.left.force.x", "forces.cube.force.x", "forces.cube.torque.y")
    names += ("forces.base.force.z", "forces.base.torque.y")
    seen = ("tip_positions.left", "object_positions.cube", "base_force", "base_torque", "external_forces.cube")
    control = squeeze(9.0, base_translation=np.array([0.0, 0.0, 0.3]), forces=pushes)
    error = largest_error(simulation, control, names, seen, 5e-6)
    figures.at_most(f"derivatives by pushes, {len(settings)} settings", error, 5e-6)
    assert "forces.right.force.x" not in simulation.linearise(control).controls


def test_a_valve_that_fills_a_cavity(figures: Figures) -> None:
    line = "{supply=20.0, conductance=0.001, critical_ratio=0.3, tube_length=100.0, tube_diameter=2.0}"
    cavity = f'soft_bodies.left.cavities.cavity={{group="cavity", air="line", line={line}}}'
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}", "rigid_bodies={}", cavity)))
    control = Control(valve={"left.cavity": 0.4, "right.cavity": 0.3})
    for _ in range(5):
        simulation.step(control)
    error = largest_error(simulation, control, ("valve.left.cavity",), ("tip_positions.left", "pressures", "volumes"))
    figures.at_most("derivatives of a valve", error, 1e-6)
    wide = simulation.linearise(Control(valve={"left.cavity": 1.0}), ("valve.left.cavity",))
    below = simulation.linearise(Control(valve={"left.cavity": 0.9999}), ("valve.left.cavity",))
    np.testing.assert_allclose(wide["pressures"], below["pressures"], rtol=1e-3, atol=1e-9)  # of the side that is free


def test_a_body_that_moves_by_modes(tmp_path: Path, figures: Figures) -> None:
    """Its derivatives come by the factor of the amplitudes; those by the base are left out."""
    full = simulate(soft_bodies={"chamber": chamber(tmp_path)})
    modes = write_modes(tmp_path / "modes.npz", full)
    simulation = simulate(soft_bodies={"chamber": chamber(tmp_path, reduced=modes)})
    pressure = ("pressure.chamber.air",)
    for _ in range(2):
        simulation.step(Control(pressure={"chamber.air": 1.0}))
    seen = ("tip_positions.chamber", "volumes", "state.position", "base_force")
    error = largest_error(simulation, Control(pressure={"chamber.air": 2.0}), pressure, seen)
    figures.at_most("derivatives of a reduced body", error, 1e-6)
    with pytest.raises(ControlError, match=r"'base_translation\.x' cannot be varied here"):
        simulation.linearise(controls=["base_translation.x"])


def test_what_limits_hold_back_has_no_derivative() -> None:
    """At the lowest pressure only more is possible; a rate that is reached allows neither more nor less."""
    simulation = Simulation(load_scene(TINY_GRIPPER))
    free = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    pressure = ("pressure.left.cavity",)
    at_rest, inside = simulation.linearise(squeeze(0.0), pressure), free.linearise(squeeze(0.0), pressure)
    np.testing.assert_allclose(at_rest["volumes"], inside["volumes"], rtol=1e-5, atol=1e-9)
    assert at_rest["volumes"][0, 0] > 1.0
    too_fast = simulation.linearise(squeeze(9.0), pressure)
    assert not too_fast["volumes"].any() and too_fast.observation.clipped


def test_a_bar_gives_way_to_a_force_by_hookes_law(block: Any, figures: Figures) -> None:
    """dz / dF = L / (E A) of the end of a bar without lateral contraction; its end face is the tip.

    By the nodes of the tip the force is spread evenly, and not by the areas around them: 1.2 % of the compliance.
    """
    length, width, modulus = 40.0, 5.0, 100.0
    bar = {
        "mesh": block((2, 2, 16), (width, width, length)),
        "element": "linear",
        "young_modulus": modulus,
        "poisson_ratio": 0.0,
        "density": 1e-6,
        "anchors": [{"box": [[-3.0, -3.0, 0.499 * length], [3.0, 3.0, length]]}],
        "tip": {"box": [[-3.0, -3.0, -length], [3.0, 3.0, -0.499 * length]]},
    }
    simulation = Simulation(scene_from_dict({"soft_bodies": {"bar": bar}, "gravity": [0.0, 0.0, 0.0]}))
    compliance = equilibrium(simulation).linearise(("force.bar.x", "force.bar.z"))["tip_positions.bar"]
    exact = length / (modulus * width**2)
    figures.close("compliance of a bar, mm/mN", compliance[2, 1], exact, 0.015 * exact)
    assert compliance[0, 0] > 20.0 * exact


def test_the_compliance_of_an_equilibrium(figures: Figures) -> None:
    """Without friction it is that of `equilibrium` itself, whose contacts are searched again and again; flat faces."""
    settings = (*WALL, "contact.tolerance=1e-10", "time.newton_tolerance=1e-11", "contact.friction=0.0")
    simulation = Simulation(load_scene(TINY_GRIPPER, settings))
    control = squeeze(10.0, base_rotation=np.zeros(3), forces={"left": push_on_pad(simulation)})
    names = "pressure.left.cavity", "base_rotation.z", "forces.left.force.y"
    rest = equilibrium(simulation, control)
    found = rest.linearise(names)
    simulation.restore(rest.state)
    seen = ("tip_positions.left", "normal_forces.left|wall", "base_torque", "state.position")
    for column, name in enumerate(names):
        see = lambda asked: equilibrium(simulation, asked).observation  # noqa: E731
        for figure, expected in differences(simulation, see, control, name, seen).items():
            error = np.abs(found[figure][..., column] - expected).max() / np.abs(expected).max()
            figures.at_most(f"compliance of pads on a wall: {figure} by {name}", float(error), 1e-6)


def test_at_the_limit_of_friction_the_derivative_is_that_of_going_on(figures: Figures) -> None:
    """Pads have slid to where they are: more pressure slides them on, less makes them stick: the derivative jumps."""
    settings = (*WALL, "contact.tolerance=1e-10", "time.newton_tolerance=1e-11", "contact.friction=0.05")
    simulation = Simulation(load_scene(TINY_GRIPPER, settings))
    rest = equilibrium(simulation, squeeze(10.0))
    friction, normal = (rest.observation.friction_forces, rest.observation.normal_forces)
    assert friction["left", "wall"] == pytest.approx(0.05 * normal["left", "wall"], rel=1e-6)
    both = rest.linearise(("pressure.left.cavity", "pressure.right.cavity"))
    change = both["friction_forces.left|wall"].sum()
    assert change == pytest.approx(0.05 * both["normal_forces.left|wall"].sum(), rel=1e-5)
    sides = []
    for sign in (1.0, -1.0):
        simulation.restore(rest.state)
        seen = equilibrium(simulation, squeeze(10.0 + sign * 1e-3)).observation
        sides.append((seen.friction_forces["left", "wall"] - friction["left", "wall"]) / (sign * 1e-3))
    assert sides[0] == pytest.approx(change, rel=1e-3)
    assert abs(sides[1] - change) > 0.5 * abs(change)


def test_what_cannot_be_linearised_is_said() -> None:
    simulation = Simulation(load_scene(TINY_GRIPPER))
    for names, message in (
        (("pressure.middle",), r"controls: 'pressure\.middle' cannot be varied here; did you mean 'pressure\."),
        (("volume_growth.left.cavity",), r"cannot be varied here; "),
        ("pressure.left.cavity", "must be a sequence of names"),
    ):
        with pytest.raises(ControlError, match=message):
            simulation.linearise(controls=names)
    with pytest.raises(ControlError, match="middle"):
        simulation.linearise(Control(pressure={"middle": 1.0}))
    bouncing = Simulation(load_scene(TINY_GRIPPER, ("contact.restitution=0.5", "contact.alarm_distance=1.0")))
    with pytest.raises(SceneError, match="contacts with restitution"):
        for _ in range(5):
            bouncing.step()
            bouncing.linearise()


def test_derivatives_hold_as_far_as_ranges_say(figures: Figures) -> None:
    """Of one linearisation the response is linear until a contact slides or sticks; then its slope jumps."""
    simulation = Simulation(load_scene(TINY_GRIPPER, (*WALL, EXACT)))
    for _ in range(20):
        simulation.step(squeeze(9.0))
    linear = simulation.linearise(squeeze(9.0), ["pressure.left.cavity"])
    low, high = linear.ranges[0]
    assert -0.1 < low < 0.0 < high and not linear.edges
    start, force = simulation.state, linear.observation.normal_forces["left", "wall"]
    errors = []
    for share in (0.9, 1.5):
        simulation.restore(start)
        simulation.step(Control(pressure={"left.cavity": 9.0 + share * low, "right.cavity": 9.0}))
        change = (simulation.observe().normal_forces["left", "wall"] - force) / (share * low)
        errors.append(abs(change / float(linear["normal_forces.left|wall"][0]) - 1.0))
    figures.at_most("difference within a range, over the derivative", errors[0], 2e-4)
    assert errors[1] > 100.0 * errors[0]


def test_contacts_at_an_edge_are_named() -> None:
    """At rest friction is at its limit and nothing slides: tolerances decide on the side, and no change is small."""
    simulation = Simulation(load_scene(TINY_GRIPPER, ("limits={}",)))
    for _ in range(300):
        simulation.step(squeeze(9.0))
    linear = simulation.linearise(controls=["pressure.left.cavity"])
    assert {edge.between for edge in linear.edges} == {"sticking and sliding"}
    assert ("left", "cube") in {edge.bodies for edge in linear.edges}
    assert np.abs(linear.ranges).max() < 1e-6
