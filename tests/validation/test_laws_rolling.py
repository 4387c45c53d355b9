"""Round bodies roll as the law of rigid bodies says: the step makes no difference, since their shape is exact."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, simulate

from taichisoft import Control, Simulation

RADIUS, LENGTH = 20.0, 50.0
SPHERE = {"sphere": {"radius": RADIUS}}
ACROSS = [90.0, 0.0, 0.0]  # the axis along y
CYLINDER = {"cylinder": {"radius": RADIUS, "length": LENGTH}, "rotation": ACROSS}
CAPSULE = {"capsule": {"radius": RADIUS, "length": LENGTH}, "rotation": ACROSS}
BODIES = {"sphere": SPHERE, "cylinder": CYLINDER, "capsule": CAPSULE}
BOX = {"box": [4000.0, 2000.0, 100.0], "translation": [0.0, 0.0, -50.0]}
FLOORS = {"plane": FLOOR, "box": BOX}


def on_the_floor(
    table: dict[str, Any], step: float = 0.01, slope: float = 0.0, floor: dict[str, Any] = FLOOR, friction: float = 0.6
) -> Simulation:
    """A round body of 50 g on a floor that falls by `slope` [degrees] along x."""
    turn = math.radians(slope)
    return simulate(
        step=step,
        gravity=(GRAVITY * math.sin(turn), 0.0, -GRAVITY * math.cos(turn)),
        rigid_bodies={"body": {"mass": 0.05, "position": [0.0, 0.0, RADIUS + CONTACT_DISTANCE], **table}},
        obstacles={"floor": floor},
        contact={"friction": friction},
    )


def share_of_inertia(simulation: Simulation) -> float:
    """Of the inertia of rolling, that which is not of turning: 5/7 for a ball, 2/3 for a cylinder."""
    inertia = np.diagonal(simulation.model.rigid_inertia[0])
    across = inertia[0] if math.isclose(inertia[0], inertia[2]) else inertia[2]
    return float(1.0 / (1.0 + across / (simulation.model.rigid_mass[0] * RADIUS**2)))


@pytest.mark.parametrize("floor", FLOORS.values(), ids=FLOORS)
@pytest.mark.parametrize("step", [0.01, 0.005, 0.002])
@pytest.mark.parametrize("table", BODIES.values(), ids=BODIES)
def test_rolling_on_the_level_goes_on(
    table: dict[str, Any], step: float, floor: dict[str, Any], figures: Figures
) -> None:
    """Nothing brakes pure rolling: 100 mm/s stay 100 mm/s. Tolerance: what the Gauss-Seidel leaves in a second."""
    simulation = on_the_floor(
        {**table, "velocity": [100, 0, 0], "angular_velocity": [0, 100 / RADIUS, 0]}, step, 0.0, floor
    )
    advance(simulation, 1.0)
    figures.close("speed after 1 s [mm/s]", simulation.state.rigid_velocity[0, 0], 100.0, 1e-6)
    figures.at_most("sideways [mm/s]", abs(simulation.state.rigid_velocity[0, 1]), 1e-6)
    figures.close("way in 1 s [mm]", simulation.state.rigid_position[0, 0], 100.0, 1e-6)


@pytest.mark.parametrize("floor", FLOORS.values(), ids=FLOORS)
@pytest.mark.parametrize("slope", [0.5, 10.0])
@pytest.mark.parametrize("table", BODIES.values(), ids=BODIES)
def test_rolling_down_a_slope(table: dict[str, Any], slope: float, floor: dict[str, Any], figures: Figures) -> None:
    """From rest: v = k g sin(slope) t, with k = 5/7 of a ball and 2/3 of a cylinder; implicit Euler has it exactly."""
    simulation = on_the_floor(table, 0.005, slope, floor)
    advance(simulation, 0.5)
    exact = share_of_inertia(simulation) * GRAVITY * math.sin(math.radians(slope)) * 0.5
    figures.close("speed over the exact one", simulation.state.rigid_velocity[0, 0] / exact, 1.0, 1e-8)


def test_the_shares_of_the_textbook() -> None:
    assert share_of_inertia(on_the_floor(SPHERE)) == pytest.approx(5 / 7)
    assert share_of_inertia(on_the_floor(CYLINDER)) == pytest.approx(2 / 3)


@pytest.mark.parametrize("table", [SPHERE, CYLINDER], ids=["sphere", "cylinder"])
@pytest.mark.parametrize("step", [0.01, 0.002])
def test_sliding_becomes_rolling(table: dict[str, Any], step: float, figures: Figures) -> None:
    """What slides at v0 without turning ends at k v0, whatever the friction: its momentum about the floor is kept."""
    simulation = on_the_floor({**table, "velocity": [300, 0, 0]}, step, friction=0.2)
    advance(simulation, 0.6)
    end = share_of_inertia(simulation) * 300.0
    figures.close("speed over the exact one", simulation.state.rigid_velocity[0, 0] / end, 1.0, 1e-8)
    figures.close("spin over the exact one", simulation.state.rigid_angular_velocity[0, 1] * RADIUS / end, 1.0, 1e-8)


def test_sliding_lasts_as_long_as_the_law_says(figures: Figures) -> None:
    """A ball slides for t = 2 v0 / (7 mu g), decelerated by mu g, then rolls; to one step."""
    simulation = on_the_floor({**SPHERE, "velocity": [300, 0, 0]}, 0.001, friction=0.2)
    rolls = 2.0 * 300.0 / (7.0 * 0.2 * GRAVITY)
    while simulation.state.rigid_velocity[0, 0] - RADIUS * simulation.state.rigid_angular_velocity[0, 1] > 1e-3:
        simulation.step()
    figures.close("time until it rolls [s]", simulation.state.time, rolls, 0.001)


def test_a_spinning_ball_comes_to_rolling(figures: Figures) -> None:
    """Set down with spin w0 and no speed: v = 2/7 w0 r. The spin about the vertical is left: a point resists none."""
    simulation = on_the_floor({**SPHERE, "angular_velocity": [0, 20, 3]}, friction=0.2)
    advance(simulation, 0.6)
    figures.close("speed [mm/s]", simulation.state.rigid_velocity[0, 0], 2 / 7 * 20 * RADIUS, 1e-8)
    figures.close("spin about the vertical [rad/s]", simulation.state.rigid_angular_velocity[0, 2], 3.0, 1e-8)


@pytest.mark.parametrize("floor", FLOORS.values(), ids=FLOORS)
@pytest.mark.parametrize("table", BODIES.values(), ids=BODIES)
def test_at_rest_it_stays(table: dict[str, Any], floor: dict[str, Any], figures: Figures) -> None:
    """Impulses are found to 1e-5 mm/s, which could move it by 1e-5 mm in a second; a tenth of that is allowed."""
    simulation = on_the_floor(table, floor=floor)
    report = advance(simulation, 1.0)
    moved = simulation.state.rigid_position[0] - simulation.model.rigid_bodies[0].start_position
    figures.at_most("moved in 1 s [mm]", float(np.abs(moved).max()), 1e-6)
    figures.close("force of the floor over the weight", report.contact_forces[:, 2].sum() / -490.5, 1.0, 1e-6)


STANDING = {"cylinder": {"radius": 10.0, "length": 40.0}, "position": [0.0, 0.0, 20.0 + CONTACT_DISTANCE]}
LIMIT = math.degrees(math.atan(10.0 / 20.0))


def tilt(simulation: Simulation) -> float:
    """Angle between the axis of the body and the vertical [degrees]."""
    return math.degrees(2.0 * math.hypot(*simulation.state.rigid_rotation[0, 1:3]))


@pytest.mark.parametrize("direction", [0.0, 17.0, 130.0])
def test_a_standing_cylinder_topples_at_its_angle(direction: float, figures: Figures) -> None:
    """It stands until the weight points past the rim, tan(angle) = r / (L/2), whatever the direction; to 0.05 degrees.

    The floor is tilted by turning gravity, within a second up to half a degree below that angle, then at 0.5 degrees/s.
    """
    simulation = on_the_floor(STANDING, 0.002, friction=1.5)
    toward = np.array([math.cos(math.radians(direction)), math.sin(math.radians(direction)), 0.0])
    angle = began = highest = 0.0
    while tilt(simulation) < 0.5 and angle < LIMIT + 1.0:
        angle = min(simulation.state.time, 1.0) * (LIMIT - 0.5) + 0.5 * max(0.0, simulation.state.time - 1.0)
        down = math.sin(math.radians(angle)) * toward - [0.0, 0.0, math.cos(math.radians(angle))]
        simulation.step(Control(gravity=GRAVITY * down))
        highest = max(highest, tilt(simulation) if angle < LIMIT - 0.05 else 0.0)
        if tilt(simulation) < 0.01:
            began = angle
    figures.close("angle at which it begins to fall [degrees]", began, LIMIT, 0.05)
    figures.at_most("tilt before [degrees]", highest, 0.01)


def test_cylinders_stacked_and_crossed_stay(figures: Figures) -> None:
    """A cylinder on a coin, off its middle, and a rod across a lying cylinder: nothing moves."""
    bodies = {
        "base": {"cylinder": {"radius": 15.0, "length": 4.0}, "position": [0, 0, 3]},
        "middle": {"cylinder": {"radius": 8.0, "length": 20.0}, "position": [2, 0, 16]},
        "lying": {"cylinder": {"radius": 10.0, "length": 30.0}, "position": [60, 0, 11], "rotation": [90, 0, 0]},
        "rod": {"cylinder": {"radius": 3.0, "length": 30.0}, "position": [60, 0, 25], "rotation": [0, 90, 0]},
    }
    simulation = simulate(
        step=0.005,
        gravity=(0.0, 0.0, -GRAVITY),
        rigid_bodies={name: {"mass": 0.02, **table} for name, table in bodies.items()},
        obstacles={"floor": FLOOR},
    )
    advance(simulation, 0.5)
    start = np.array([body.start_position for body in simulation.model.rigid_bodies])
    figures.at_most("moved in 0.5 s [mm]", float(np.abs(simulation.state.rigid_position - start).max()), 1e-4)
