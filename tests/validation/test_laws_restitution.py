"""Newton's law of impact: the speed of separation is e times that of approach, and the energy never grows."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from conftest import Figures, examples
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import CONTACT_DISTANCE, FLOOR, GRAVITY, simulate

from taichisoft import Simulation
from taichisoft.base import matrices_from_quaternions
from taichisoft.base.rotations import rotation_from_degrees

BOX = {"box": [10.0, 10.0, 10.0], "mass": 0.01}


def _energy(simulation: Simulation) -> float:
    """Kinetic and potential energy of all rigid bodies [mN mm]."""
    state, model = simulation.state, simulation.model
    turn = matrices_from_quaternions(state.rigid_rotation)
    inertia = turn @ model.rigid_inertia @ turn.transpose(0, 2, 1)
    spin, mass = state.rigid_angular_velocity, model.rigid_mass
    turning = 0.5 * np.einsum("bi,bij,bj", spin, inertia, spin)
    return float(
        turning
        + 0.5 * (mass * (state.rigid_velocity**2).sum(axis=1)).sum()
        - (mass * (state.rigid_position @ state.gravity)).sum()
    )


def _sequence(speeds: list[float], restitution: float) -> list[float]:
    """Speeds of equal balls in a row after all impacts, of which the fastest comes first."""
    speeds = list(speeds)
    while True:
        approach = [first - second for first, second in pairwise(speeds)]
        fastest = int(np.argmax(approach))
        if approach[fastest] < 1e-9:
            return speeds
        mean, apart = 0.5 * (speeds[fastest] + speeds[fastest + 1]), 0.5 * restitution * approach[fastest]
        speeds[fastest : fastest + 2] = mean - apart, mean + apart


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("gap", [0.0, 0.2], ids=["touching", "apart"])
def test_a_cradle_of_three(figures: Figures, restitution: float, gap: float) -> None:
    """One of three equal boxes in a row strikes the next: 0, 0, 1 at e = 1, and 1/3 each at e = 0.

    Between, the sequence of the impacts of two, which can be summed by hand. Tolerance: the solver's 1e-5 mm/s for each
    of up to some ten impacts.
    """
    pitch, speed = 10.0 + CONTACT_DISTANCE + gap, 100.0
    bodies = {name: {**BOX, "position": [k * pitch, 0, 0]} for k, name in enumerate(("first", "second", "third"))}
    bodies["first"] |= {"position": [-0.5, 0, 0], "velocity": [speed, 0, 0]}
    simulation = simulate(rigid_bodies=bodies, contact={"restitution": restitution})
    for _ in range(1000):  # the first two close again at 0.25 mm/s
        assert simulation.step().converged
    expected = _sequence([speed, 0.0, 0.0], restitution) if restitution else [speed / 3] * 3
    for number, one in enumerate(expected):
        figures.close(f"speed of box {number + 1} [mm/s]", simulation.state.rigid_velocity[number, 0], one, 1e-3)


@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("restitution", [0.3, 0.8, 1.0])
def test_a_box_is_thrown_back_with_a_share_of_its_speed(restitution: float, degrees: float) -> None:
    """Onto a floor without friction or gravity, flat or on an edge: the points that touch separate with e v."""
    turn = rotation_from_degrees((0.0, degrees, 0.0))
    corners = np.array([[x, y, z] for x in (-5, 5) for y in (-5, 5) for z in (-5, 5)]) @ turn.T
    lowest = corners[corners[:, 2].argmin()]
    box = {**BOX, "rotation": [0, degrees, 0], "position": [0, 0, CONTACT_DISTANCE - lowest[2]]}
    contact = {"restitution": restitution, "friction": 0.0, "tolerance": 1e-9}
    simulation = simulate(
        1e-3, rigid_bodies={"box": {**box, "velocity": [0, 0, -50]}}, obstacles={"floor": FLOOR}, contact=contact
    )
    before = _energy(simulation)
    simulation.step()
    state = simulation.state
    point = state.rigid_velocity[0] + np.cross(state.rigid_angular_velocity[0], lowest)
    assert point[2] == pytest.approx(50 * restitution, rel=1e-6)
    assert _energy(simulation) <= before * (1 + 1e-9)
    if degrees == 0.0:
        assert _energy(simulation) == pytest.approx(before * restitution**2, rel=1e-6)


@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_a_box_rebounds_to_the_square_of_the_coefficient(figures: Figures, restitution: float) -> None:
    """Dropped from H it rises to e^2 H, and comes to rest in the end.

    Within a step it moves 2 mm, and gravity adds h g = 10 mm/s to 1400: tolerance 2 % of H. It rests once it bounces
    by less than h g.
    """
    height, step = 100.0, 1e-3
    box = {**BOX, "position": [0, 0, height + 5 + CONTACT_DISTANCE]}
    contact = {"pairs": [{"bodies": ["box", "floor"], "restitution": restitution}]}
    simulation = simulate(
        step, (0.0, 0.0, -GRAVITY), rigid_bodies={"box": box}, obstacles={"floor": FLOOR}, contact=contact
    )
    heights, energy = [], [_energy(simulation)]
    for _ in range(round((3.0 if restitution > 0.6 else 1.0) / step)):
        simulation.step()
        heights.append(simulation.state.rigid_position[0, 2] - 5 - CONTACT_DISTANCE)
        energy.append(_energy(simulation))
    fall = round(np.sqrt(2 * height / GRAVITY) / step)
    figures.close("height of the first rebound [mm]", max(heights[fall + 5 :]), restitution**2 * height, 0.02 * height)
    assert np.diff(energy).max() <= 1e-6 * energy[0]
    assert max(heights[-50:]) < 1e-5


SHAPES: list[dict[str, Any]] = [
    {"box": [10.0, 10.0, 10.0]},
    {"box": [24.0, 8.0, 6.0]},
    {"box": [30.0, 5.0, 5.0]},
]


@examples(60)
@example(  # of which the floor's impulse makes 1.7e-4 more energy
    shape=SHAPES[0],
    turn=(0.25, -7.0, 47.0),
    velocity=(0.0, 0.0, -10.0),
    spin=(-15.0, 0.0, 0.0),
    restitution=0.0,
    friction=0.0,
    step=0.01,
)
@given(
    shape=st.sampled_from(SHAPES),
    turn=st.tuples(*[st.floats(-90, 90)] * 3),
    velocity=st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-800, -10)),
    spin=st.tuples(*[st.floats(-30, 30)] * 3),
    restitution=st.floats(0, 1),
    friction=st.sampled_from([0.0, 0.3, 1.0]),
    step=st.sampled_from([0.01, 0.002]),
)
def test_an_impact_never_adds_energy(
    shape: dict[str, Any],
    turn: tuple[float, float, float],
    velocity: tuple[float, float, float],
    spin: tuple[float, float, float],
    restitution: float,
    friction: float,
    step: float,
) -> None:
    """Thrown at the floor anyhow, with any coefficients: an impact leaves no more kinetic energy than the same step
    without the floor, with the inertia at the start of the step, where impulses act. Tolerance 1e-6, the solver's.

    But for this: the law is one of the velocities at the start of the step, which the gyroscopic torque changes in its
    course, and the impulse does work on that change, too: dL . (w_free - w_start).

    And a step keeps the end of a corner's way above the floor, and takes that way as straight, as it is at the end. The
    way of what turns is an arc, so that the corner may leave with up to h w^2 r / 2 where it should come to rest; an
    impulse p does at most p times that of work.
    """
    corners = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * shape["box"]
    lowest = (corners @ rotation_from_degrees(turn).T)[:, 2].min()
    body = {
        **shape,
        "mass": 0.01,
        "rotation": list(turn),
        "position": [0, 0, CONTACT_DISTANCE - lowest],
        "velocity": list(velocity),
        "angular_velocity": list(spin),
    }
    simulation = simulate(
        step,
        rigid_bodies={"body": body},
        obstacles={"floor": FLOOR},
        contact={"restitution": restitution, "friction": friction},
    )
    free = simulate(step, rigid_bodies={"body": body})
    free.step()
    simulation.step()
    axes = rotation_from_degrees(turn)
    inertia = axes @ simulation.model.rigid_inertia[0] @ axes.T

    def kinetic(one: Simulation) -> float:
        spun, moved = one.state.rigid_angular_velocity[0], one.state.rigid_velocity[0]
        return float(0.5 * spun @ inertia @ spun + 0.005 * moved @ moved)

    turned = free.state.rigid_angular_velocity[0]
    work = (simulation.state.rigid_angular_velocity[0] - turned) @ inertia @ (turned - np.array(spin))
    impulse = simulation.model.rigid_mass[0] * (simulation.state.rigid_velocity - free.state.rigid_velocity)[0, 2]
    arc = 0.5 * step * np.dot(spin, spin) * np.linalg.norm(corners[0])
    assert kinetic(simulation) <= kinetic(free) * (1 + 1e-6) + max(0.0, work) + impulse * arc
