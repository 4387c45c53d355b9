"""Rolling and spinning friction: moments of at most b N where rigid bodies touch, against the turning."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import Figures, examples
from energy import total_energy
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, advance, simulate

from taichisoft import Simulation
from taichisoft.errors import SceneError

RADIUS, MASS = 20.0, 0.05
SPHERE = {"sphere": {"radius": RADIUS}}
LENGTH = 0.4  # [mm]


def on_the_floor(
    table: dict[str, Any], contact: dict[str, float], slope: float = 0.0, step: float = 0.005, height: float = RADIUS
) -> Simulation:
    """A body of 50 g on a floor that falls by `slope` [rad] along x."""
    return simulate(
        step=step,
        gravity=(GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope)),
        rigid_bodies={"body": {"mass": MASS, "position": [0.0, 0.0, height + CONTACT_DISTANCE], **table}},
        obstacles={"floor": FLOOR},
        contact=contact,
    )


@pytest.mark.parametrize("step", [0.01, 0.002])
def test_a_rolling_ball_slows_down(step: float, figures: Figures) -> None:
    """m v' = F and 2/5 m r^2 w' = -F r - b N with v = w r: v' = -5/7 g b / r, to the digits, then it rests for ever.

    Implicit Euler has constant accelerations exactly, in any direction of rolling.
    """
    speed, heading = 100.0, np.array([math.cos(0.7), math.sin(0.7)])
    velocity, turning = speed * heading, speed / RADIUS * np.array([-heading[1], heading[0]])
    moving = {"velocity": [*velocity, 0.0], "angular_velocity": [*turning, 0.0]}
    simulation = on_the_floor({**SPHERE, **moving}, {"rolling_friction": LENGTH}, step=step)
    advance(simulation, 0.4)
    exact = speed - 5.0 / 7.0 * GRAVITY * LENGTH / RADIUS * 0.4
    figures.close("speed after 0.4 s [mm/s]", simulation.state.rigid_velocity[0, :2] @ heading, exact, 1e-5)
    figures.at_most("sideways [mm/s]", abs(simulation.state.rigid_velocity[0, :2] @ [-heading[1], heading[0]]), 1e-5)
    advance(simulation, 0.6)
    figures.at_most("speed at rest [mm/s]", float(np.linalg.norm(simulation.state.rigid_velocity)), 1e-6)
    figures.at_most("turning at rest [rad/s]", float(np.linalg.norm(simulation.state.rigid_angular_velocity)), 1e-6)


@pytest.mark.parametrize("above", [0.95, 1.05])
def test_a_ball_stays_on_a_slope_until_its_tangent_is_b_over_r(above: float, figures: Figures) -> None:
    """Held by F = m g sin t at the floor, it needs M = F r <= b m g cos t. Beyond: 5/7 g (sin t - b / r cos t)."""
    slope = math.atan(above * LENGTH / RADIUS)
    simulation = on_the_floor(SPHERE, {"rolling_friction": LENGTH}, slope)
    advance(simulation, 0.5)
    beyond = max(0.0, math.sin(slope) - LENGTH / RADIUS * math.cos(slope))
    speed = simulation.state.rigid_velocity[0, 0]
    figures.close("speed after 0.5 s [mm/s]", speed, 5.0 / 7.0 * GRAVITY * beyond * 0.5, 1e-5)


def test_a_spinning_ball_comes_to_rest(figures: Figures) -> None:
    """2/5 m r^2 w' = -b m g: the spin decays by 5/2 b g / r^2 a second, and nothing else moves."""
    simulation = on_the_floor({**SPHERE, "angular_velocity": [0.0, 0.0, 30.0]}, {"spinning_friction": LENGTH})
    advance(simulation, 0.5)
    exact = 30.0 - 2.5 * LENGTH * GRAVITY / RADIUS**2 * 0.5
    figures.close("spin after 0.5 s [rad/s]", simulation.state.rigid_angular_velocity[0, 2], exact, 1e-6)
    advance(simulation, 1.0)
    figures.at_most("spin at rest [rad/s]", abs(simulation.state.rigid_angular_velocity[0, 2]), 1e-6)
    figures.at_most("way [mm]", float(np.linalg.norm(simulation.state.rigid_position[0, :2])), 1e-6)


def test_spinning_friction_does_not_brake_rolling_nor_the_other_way_round() -> None:
    rolling = {"velocity": [100.0, 0.0, 0.0], "angular_velocity": [0.0, 100.0 / RADIUS, 0.0]}
    simulation = on_the_floor({**SPHERE, **rolling}, {"spinning_friction": LENGTH})
    advance(simulation, 0.3)
    np.testing.assert_allclose(simulation.state.rigid_velocity[0, 0], 100.0, atol=1e-6)
    simulation = on_the_floor({**SPHERE, "angular_velocity": [0.0, 0.0, 30.0]}, {"rolling_friction": LENGTH})
    advance(simulation, 0.3)
    np.testing.assert_allclose(simulation.state.rigid_angular_velocity[0, 2], 30.0, atol=1e-6)


def test_a_box_resists_spinning_at_each_of_its_corners_by_what_presses_there(figures: Figures) -> None:
    """On a floor without friction the moments add up to b N: w' = -b m g / I."""
    box = {"box": [40.0, 40.0, 20.0], "angular_velocity": [0.0, 0.0, 10.0]}
    simulation = on_the_floor(box, {"friction": 0.0, "spinning_friction": 2.0}, height=10.0)
    advance(simulation, 0.05)
    inertia = simulation.model.rigid_inertia[0, 2, 2]
    exact = 10.0 - 2.0 * MASS * GRAVITY / inertia * 0.05
    figures.close("spin after 0.05 s [rad/s]", simulation.state.rigid_angular_velocity[0, 2], exact, 1e-5)


def test_two_balls_in_space_keep_their_angular_momentum(figures: Figures) -> None:
    """A spinning ball pressed on a resting one takes it with it; the moments are against each other."""
    gap = 2.0 * RADIUS + CONTACT_DISTANCE
    simulation = simulate(
        rigid_bodies={
            "one": {**SPHERE, "mass": MASS, "angular_velocity": [0.0, 0.0, 30.0]},
            "other": {**SPHERE, "mass": MASS, "position": [0.0, 0.0, gap], "velocity": [0.0, 0.0, -200.0]},
        },
        contact={"pairs": [{"bodies": ["one", "other"], "spinning_friction": 0.1}]},
    )
    advance(simulation, 0.01)
    spin = simulation.state.rigid_angular_velocity[:, 2]
    # They meet without bouncing: the impulse is that of the reduced mass.
    taken = 0.1 * 0.5 * MASS * 200.0 / (0.4 * MASS * RADIUS**2)
    figures.close("spin that the other has [rad/s]", spin[1], taken, 1e-6)
    figures.close("spin of both [rad/s]", spin.sum(), 30.0, 1e-9)


@examples(20)
@given(
    velocity=st.tuples(*3 * [st.floats(-300.0, 300.0)]),
    turning=st.tuples(*3 * [st.floats(-20.0, 20.0)]),
    lengths=st.tuples(*2 * [st.floats(0.0, 5.0)]),
    friction=st.floats(0.0, 1.0),
    shape=st.sampled_from([SPHERE, {"box": [40.0, 40.0, 40.0]}, {"cylinder": {"radius": RADIUS, "length": 40.0}}]),
)
@example(  # where interior points end at no number
    velocity=(0.0, 0.0, 0.0),
    turning=(0.0, 1.0, 0.0),
    lengths=(0.0, 1.0),
    friction=1.0,
    shape={"cylinder": {"radius": 20.0, "length": 40.0}},
)
@example(  # 225 Newton steps in one step
    velocity=(0.0, 9.0, -3.25),
    turning=(0.0, 9.0, -3.25),
    lengths=(0.25, 0.0),
    friction=0.78125,
    shape={"box": [40.0, 40.0, 40.0]},
)
@example(  # 157 Newton steps in one step
    velocity=(0.0, 4.0, -3.0),
    turning=(0.0, 9.0, 4.0),
    lengths=(0.5, 0.0),
    friction=0.75,
    shape={"box": [40.0, 40.0, 40.0]},
)
@example(  # solved from no impulses alone
    velocity=(2.9264554001519585, -1.9561420801577278e-56, -17.420307402922877),
    turning=(2.9264554001519585, -1.9561420801577278e-56, -17.420307402922877),
    lengths=(0.0, 1.5236635673679035),
    friction=0.8348352404128956,
    shape={"box": [40.0, 40.0, 40.0]},
)
def test_energy_never_grows(
    velocity: tuple[float, ...],
    turning: tuple[float, ...],
    lengths: tuple[float, ...],
    friction: float,
    shape: dict[str, Any],
) -> None:
    """But for this: a step takes the way of a cylinder's rim as straight, and lifts what turns by up to (h w)^2 r / 2.

    The lift is one of place alone, and comes down again. Every step is solved. Rows of boxes may be left as they are
    for 1e-5 mm, which is 5e-3 mN mm of the weight.
    """
    reach, left = (math.hypot(20.0, 20.0), 1e-3) if "cylinder" in shape else (0.0, 5e-3 if "box" in shape else 1e-3)
    laws = {"friction": friction, "rolling_friction": lengths[0], "spinning_friction": lengths[1]}
    simulation = on_the_floor({**shape, "velocity": list(velocity), "angular_velocity": list(turning)}, laws, height=40)
    before = total_energy(simulation)
    for _ in range(30):
        turned = np.linalg.norm(simulation.state.rigid_angular_velocity)
        report = simulation.step()
        assert report.converged
        turned = 0.005 * max(turned, np.linalg.norm(simulation.state.rigid_angular_velocity))
        lift = MASS * GRAVITY * 0.5 * turned**2 * reach
        after = total_energy(simulation)
        assert after <= before + lift + 1e-6 * abs(before) + left
        before = after


def test_a_soft_body_has_no_length_of_its_own(block: Any) -> None:
    soft = {"mesh": block((1, 1, 1), (10.0, 10.0, 10.0)), "mass": 0.01, "young_modulus": 500, "poisson_ratio": 0.3}
    tables = {"soft_bodies": {"pad": {**soft, "translation": [0, 0, 10]}}, "obstacles": {"floor": FLOOR}}
    with pytest.raises(SceneError, match=r"contact.pairs\[0\].rolling_friction = 0.2: 'pad' is a soft body and"):
        simulate(**tables, contact={"pairs": [{"bodies": ["pad", "floor"], "rolling_friction": 0.2}]})
    assert not simulate(**tables, contact={"rolling_friction": 0.2}).model.rolling_friction.any()
