"""Steps of second order: `time.theta` of 0.5, with the laws of contacts at the end of the step (Moreau and Jean).

Names say what implicit Euler, theta 1, does with the same step where the two differ much.
"""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from energy import total_energy
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, rigid_momentum, silicone

from taichisoft import Control, Simulation
from taichisoft.base import matrices_from_quaternions
from taichisoft.errors import SceneError
from taichisoft.scene import scene_from_dict

DOWN = [0.0, 0.0, -GRAVITY]
STEPS = (0.01, 0.005, 0.0025, 0.00125, 0.000625)
BAR, SQUARE = (80.0, 10.0, 10.0), (20.0, 20.0, 20.0)
CLAMP = {"box": [[-40, -5, -5], [-40, 5, 5]]}


def simulate(time: dict[str, Any], gravity: list[float], **tables: Any) -> Simulation:
    return Simulation(scene_from_dict({"gravity": gravity, "time": {"step": 0.01, "theta": 0.5, **time}, **tables}))


def released(bar: dict[str, Any], time: dict[str, Any]) -> Simulation:
    """A cantilever of 2.8 Hz that a load has bent by 1.4 mm, at the moment when the load is gone."""
    loaded = simulate({"step": 1.0, "theta": 1.0, "dynamics": "static"}, [0.0, 0.0, -300.0], soft_bodies={"bar": bar})
    loaded.step()
    simulation = simulate(time, [0.0, 0.0, 0.0], soft_bodies={"bar": bar})
    simulation.restore(simulation.state.changed(position=loaded.state.position))
    return simulation


def orders(swings: list[np.ndarray]) -> list[float]:
    """By what the differences of runs fall, each with half the step of the one before, at the first run's times."""
    common = [swing[2**n - 1 :: 2**n] for n, swing in enumerate(swings)]
    apart = [np.abs(one - other).max() for one, other in pairwise(common)]
    return [coarse / fine for coarse, fine in pairwise(apart)]


@pytest.mark.parametrize("newton", [1, 30])
def test_a_cantilever_swings_to_second_order(block: Callable[..., str], figures: Figures, newton: int) -> None:
    """The end's motion over a period with steps of 10 to 0.625 ms: differences fall by 4, those of Euler by 1.6 to 1.9.

    3 ms of damping by stiffness leave nothing at the end that swings faster than a step. 4 % are what the next order is
    in the coarsest three.
    """
    bar = silicone(block((8, 1, 1), BAR), element="linear", young_modulus=30, rayleigh_stiffness=0.003, anchors=[CLAMP])
    swings = []
    for step in STEPS:
        simulation = released(bar, {"step": step, "newton": newton})
        tip = simulation.model.rest_position[:, 0] > 39
        swing = [(simulation.step(), simulation.state.position[tip, 2].mean())[1] for _ in range(round(0.36 / step))]
        swings.append(np.array(swing))
    assert np.ptp(swings[-1]) > 2.0
    for step, ratio in zip(STEPS, orders(swings), strict=False):
        figures.close(f"{newton} linearisations: differences from {step * 1e3:g} ms on", ratio, 4.0, 0.16)


def test_sealed_air_is_of_second_order(block: Callable[..., str], figures: Figures) -> None:
    """A hollow block of 50 kPa swings sideways under a sudden weight, and its volume with it, against the spring of its
    air: as above, with steps of 4 to 0.5 ms."""
    body = silicone(block((4, 4, 4), SQUARE, hollow=True), element="linear", young_modulus=50, rayleigh_stiffness=0.002)
    body |= {"anchors": [{"box": [[-10, -10, -10], [10, 10, -10]]}]}
    body["cavities"] = {"air": {"group": "cavity", "air": "sealed"}}
    swings = []
    for step in (0.004, 0.002, 0.001, 0.0005):
        simulation = simulate({"step": step, "newton": 20}, [3000.0, 0.0, -GRAVITY], soft_bodies={"block": body})
        steps = range(round(0.1 / step))
        swings.append(np.array([(simulation.step(), simulation.state.position[:, 0].max())[1] for _ in steps]))
    for ratio in orders(swings):
        figures.close("differences of the motion", ratio, 4.0, 0.2)


def test_the_method_damps_no_swing(block: Callable[..., str], figures: Figures) -> None:
    """Over eight periods at 10 ms: 1 % of the amplitude a period would be 15 % of the energy in all. Implicit Euler
    takes 42 % of the amplitude a period."""
    bar = silicone(block((8, 1, 1), BAR), element="linear", young_modulus=30, rayleigh_stiffness=0.0, anchors=[CLAMP])
    simulation = released(bar, {"newton": 30})
    before = total_energy(simulation)
    advance(simulation, 3.0)
    figures.close("energy after 3 s over that at the start", total_energy(simulation) / before, 1.0, 1e-3)


def test_springs_of_a_rigid_body_swing_on(figures: Figures) -> None:
    """10 g on springs of 10 mN/mm, 5 Hz: amplitude, and phase by tan(w h / 2) = w0 h / 2, after 100 steps of 10 ms."""
    springs = {"stiffness": 10.0, "angular_stiffness": 1e3, "rayleigh_stiffness": 0.0}
    body = {"box": [10, 10, 10], "mass": 0.01, "velocity": [100.0, 0.0, 0.0], "springs": springs}
    simulation = simulate({}, [0.0, 0.0, 0.0], rigid_bodies={"mass": body})
    advance(simulation, 1.0)
    angle = 100 * 2 * np.arctan(0.01 * np.sqrt(1e3) / 2)
    found = [simulation.state.rigid_velocity[0, 0], simulation.state.rigid_position[0, 0] * np.sqrt(1e3)]
    figures.close("velocity [mm/s]", found[0], 100 * np.cos(angle), 1e-8)
    figures.close("place times frequency [mm/s]", found[1], 100 * np.sin(angle), 1e-8)


def test_a_tumbling_body_keeps_its_energy(figures: Figures) -> None:
    """The midpoint rule in the body's axes keeps the energy of any turning, and the momentum to second order."""
    swings = []
    for step in (0.02, 0.01, 0.005):
        body = {"box": [10, 20, 40], "density": 1e-6, "angular_velocity": [1.0, 20.0, 2.0]}
        simulation = simulate({"step": step}, [0.0, 0.0, 0.0], rigid_bodies={"body": body})
        before, inertia, path = total_energy(simulation), simulation.model.rigid_inertia[0], []
        for _ in range(round(0.6 / step)):
            simulation.step()
            turn = matrices_from_quaternions(simulation.state.rigid_rotation)[0]
            path.append(turn @ inertia @ turn.T @ simulation.state.rigid_angular_velocity[0])
        swings.append(np.array(path))
        figures.close(f"energy at {step * 1e3:g} ms", total_energy(simulation) / before, 1.0, 1e-9)
    figures.close("differences of the angular momentum", orders(swings)[0], 4.0, 0.4)


def test_what_slides_stops_where_it_should(figures: Figures) -> None:
    """v^2 / (2 mu g), to h^2 mu g; steps of implicit Euler stop it h v / 2 = 1 mm early."""
    block = {"box": [10, 10, 10], "mass": 0.01, "position": [0, 0, 5 + CONTACT_DISTANCE], "velocity": [0, 200.0, 0]}
    tables = {"rigid_bodies": {"block": block}, "obstacles": {"floor": FLOOR}, "contact": {"friction": 0.5}}
    simulation = simulate({}, DOWN, **tables)
    advance(simulation, 0.2)
    law = 200.0**2 / (2 * 0.5 * GRAVITY)
    figures.close("stopping distance [mm]", simulation.state.rigid_position[0, 1], law, 0.01**2 * 0.5 * GRAVITY)
    assert np.abs(simulation.state.rigid_velocity).max() < 1e-4


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_a_ball_falls_and_bounces_by_its_restitution(figures: Figures, restitution: float) -> None:
    """The fall keeps its energy; the rebound has e times the speed before the step of the impact, less its g h."""
    ball = {"sphere": {"radius": 10.0}, "mass": 0.01, "position": [0, 0, 10 + CONTACT_DISTANCE + 44.0]}
    contact = {"pairs": [{"bodies": ["ball", "floor"], "restitution": restitution}]}
    simulation = simulate({}, DOWN, rigid_bodies={"ball": ball}, obstacles={"floor": FLOOR}, contact=contact)
    levels, speeds = [total_energy(simulation)], [0.0]
    for _ in range(100):
        assert simulation.step().converged
        levels.append(total_energy(simulation))
        speeds.append(simulation.state.rigid_velocity[0, 2])
    struck = int(np.argmax(np.diff(speeds) > 0))
    figures.close("energy of the fall", levels[struck] / levels[0], 1.0, 1e-12)
    rebound = max(-restitution * speeds[struck] - 0.01 * GRAVITY, 0.0)
    figures.close("rebound [mm/s]", max(speeds[struck + 1], 0.0), rebound, 1e-6)
    assert max(levels) <= levels[0] * (1 + 1e-12)


@pytest.mark.parametrize("theta", [0.5, 0.55])
def test_a_dropped_soft_block_gains_nothing(block: Callable[..., str], figures: Figures, theta: float) -> None:
    """It falls and strikes with friction, damped by 0.5 ms: the energy is never above that at the start, and it ends at
    rest under its weight."""
    body = silicone(block((3, 2, 2), (20.0, 15.0, 15.0)), element="linear", rayleigh_stiffness=0.0005)
    body |= {"translation": [0, 0, 30], "velocity": [200.0, 0.0, 0.0]}
    simulation = simulate({"theta": theta}, DOWN, soft_bodies={"block": body}, obstacles={"floor": FLOOR})
    levels = [total_energy(simulation)]
    for _ in range(80):
        report = simulation.step()
        assert report.converged
        levels.append(total_energy(simulation))
    figures.at_most("largest energy over that at the start", max(levels) / levels[0], 1 + 1e-9)
    figures.at_most("largest gain in a step, of the first energy", np.diff(levels).max() / levels[0], 1e-3)
    figures.at_most("speed at the end [mm/s]", np.abs(simulation.state.velocity).max(), 3.0)


def anchor_places(simulation: Simulation) -> dict[str, np.ndarray]:
    """Of each body's anchors at rest [mm]."""
    bodies = simulation.model.soft_bodies
    return {body.name: body.rest_position[body.anchored] for body in bodies}


@pytest.mark.parametrize("theta", [0.5, 0.55])
def test_a_pinch_lifts_and_holds(block: Callable[..., str], figures: Figures, theta: float) -> None:
    """Two pads press a cube of 5 g by 1 mm each and lift it at once at 100 mm/s: it goes along, and does not creep."""
    pad = silicone(block((3, 2, 2), (15.0, 15.0, 15.0)), element="linear", young_modulus=200)
    pads = {
        "left": {**pad, "translation": [-18.5, 0, 0], "anchors": [{"box": [[-7.5, -8, -8], [-7.5, 8, 8]]}]},
        "right": {**pad, "translation": [18.5, 0, 0], "anchors": [{"box": [[7.5, -8, -8], [7.5, 8, 8]]}]},
    }
    cube = {"cube": {"box": [20, 20, 20], "mass": 0.005}}
    weightless = np.zeros(3)
    simulation = simulate({"theta": theta}, DOWN, soft_bodies=pads, rigid_bodies=cube, contact={"friction": 0.8})
    places, inwards = anchor_places(simulation), {"left": np.array([1.0, 0, 0]), "right": np.array([-1.0, 0, 0])}
    for share in np.linspace(0.1, 1.0, 10):
        asked = {name: places[name] + share * inwards[name] for name in pads}
        simulation.step(Control(anchor_positions=asked, gravity=weightless))
    for step in range(120):
        still = 0.0 if step >= 20 else 100.0
        control = Control(base_velocity=np.array([0.0, 0.0, still]), gravity=np.array(DOWN))
        assert simulation.step(control).converged
        if step == 70:
            held = simulation.state.rigid_position[0].copy()
    figures.close("lift of the cube [mm]", simulation.state.rigid_position[0, 2], 20.0, 1.5)
    figures.at_most("creep in 0.5 s [mm]", np.abs(simulation.state.rigid_position[0] - held).max(), 2e-3)


def test_anchors_are_where_they_are_put(block: Callable[..., str], figures: Figures) -> None:
    """The base moves at once at 80 mm/s and stops at once: its nodes are on it after each step, at its speed."""
    bar = silicone(block((4, 1, 1), BAR), element="linear", anchors=[CLAMP])
    simulation = simulate({}, [0.0, 0.0, 0.0], soft_bodies={"bar": bar})
    nodes, rest = simulation.model.anchored_nodes, simulation.model.rest_position
    worst = speed = 0.0
    for step in range(10):
        moves = 80.0 if step < 5 else 0.0
        simulation.step(Control(base_velocity=np.array([moves, 0.0, 0.0])))
        moved = simulation.state.position[nodes] - rest[nodes] - [0.8 * min(step + 1, 5), 0.0, 0.0]
        worst = max(worst, float(np.abs(moved).max()))
        speed = max(speed, float(np.abs(simulation.state.velocity[nodes] - [moves, 0, 0]).max()))
    figures.at_most("off their places [mm]", worst, 1e-6)
    figures.at_most("off the speed of the base [mm/s]", speed, 1e-4)


def test_a_volume_asked_for_is_there_in_the_end(block: Callable[..., str], figures: Figures) -> None:
    """A ramp of 10 steps at 10 mm^3 each: half a step's rate is missed after a kink, and half of what is missed in two
    steps."""
    body = silicone(block((4, 4, 4), SQUARE, hollow=True), element="linear", cavities={"air": {"group": "cavity"}})
    body["anchors"] = [{"box": [[-10, -10, -10], [10, 10, -10]]}]
    simulation = simulate({"newton": 20}, [0.0, 0.0, 0.0], soft_bodies={"block": body})
    rest, missed = simulation.model.cavities.rest_value[0], []
    for step in range(40):
        asked = min(10.0 * (step + 1), 100.0)
        simulation.step(Control(volume_growth={"block.air": asked}))
        missed.append(float(simulation.state.actuator_value[0]) - rest - asked)
    figures.close("missed in the first step [mm^3]", missed[0], -5.0, 1e-3)
    figures.at_most("missed 30 steps after the ramp [mm^3]", abs(missed[-1]), 10.0 * 0.75**30 * 10)


def test_derivatives_are_refused() -> None:
    """They are of implicit Euler's steps."""
    simulation = simulate({}, DOWN, rigid_bodies={"cube": {"box": [10, 10, 10], "mass": 0.01}})
    with pytest.raises(SceneError, match=r"time\.theta: derivatives are of implicit Euler's steps alone; leave it 1"):
        simulation.linearise()


def test_reduced_bodies_are_refused(tmp_path: Path) -> None:
    """Their modes follow frames at the end of a step."""
    modes = tmp_path / "modes.npz"
    modes.touch()
    body = {"bar": silicone("tutorial-coarse", reduced=str(modes))}
    with pytest.raises(
        SceneError, match=r"theta = 0\.5 must be 1, implicit Euler, with soft_bodies\.bar\.reduced; leave"
    ):
        simulate({}, DOWN, soft_bodies=body)


def test_two_bodies_that_strike_keep_their_momentum(figures: Figures) -> None:
    """Impulses are equal and opposite, whatever theta is."""
    bodies = {
        "one": {"sphere": {"radius": 10.0}, "mass": 0.01, "position": [-12.0, 1.0, 0], "velocity": [300.0, 0, 0]},
        "two": {"sphere": {"radius": 10.0}, "mass": 0.02, "position": [12.0, 0, 0]},
    }
    simulation = simulate({}, [0.0, 0.0, 0.0], rigid_bodies=bodies)
    advance(simulation, 0.1)
    figures.at_most("momentum [mN s]", float(np.abs(rigid_momentum(simulation) - [3.0, 0, 0]).max()), 1e-12)


def test_a_spinning_arm_needs_no_moment(block: Callable[..., str], figures: Figures) -> None:
    """The hinge of an arm that turns evenly at 12 rad/s has the force m w^2 r to bear, and no moment. Taken where the
    arm is at the end of the step the moment would be -I w^3 h / 2, 6 % of I w^2."""
    table = silicone(block((12, 2, 2), (60.0, 10.0, 10.0)), element="linear", young_modulus=2000.0)
    table |= {"follows": "arm", "rayleigh_stiffness": 0.002, "anchors": [{"box": [[-31, -9, -9], [-29.99, 9, 9]]}]}
    frames = {"arm": {"pivot": [-30.0, 0.0, 0.0], "hinge": {"axis": [0, 1, 0]}}}
    simulation = simulate({"newton": 20}, [0.0, 0.0, 0.0], soft_bodies={"bar": table}, frames=frames)
    moments, angle, rate = [], 0.0, 12.0
    for step in range(1, 151):
        angle += 0.01 * rate * (1.0 - np.exp(-step * 0.1))
        report = simulation.step(Control(frame_angle={"arm": angle}))
        moments.append(report.observation.frame_moments["arm"])
    assert simulation.model.elasticity is not None
    mass, place = simulation.model.elasticity.node_mass, simulation.state.position - [-30.0, 0.0, 0.0]
    inertia, centre = mass @ (place**2)[:, [0, 2]].sum(axis=1), mass @ place
    figures.at_most("moment over I w^2", abs(np.mean(moments[-30:])) / (inertia * rate**2), 1e-3)
    force = np.linalg.norm(report.observation.frame_forces["arm"])
    figures.close("force over m w^2 r", force / (rate**2 * np.linalg.norm(centre)), 1.0, 0.01)
