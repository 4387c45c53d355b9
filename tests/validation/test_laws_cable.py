"""Cables: the work they do, the forces they transmit, their lengths, their friction."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from actuator_geometry import measured
from conftest import Figures
from scenes import advance, silicone, simulate

from taichisoft import Control, Model, Simulation
from taichisoft.mechanics import ActuatorGeometry
from taichisoft.mechanics.elasticity import internal_force

SIZE = (40.0, 10.0, 10.0)
ROOT = {"box": [[-20, -5, -5], [-20, 5, 5]]}
CABLE = "block.tendon"
# Off the middle, so that the block bends, and not straight, so that its points are pulled sideways.
BENT = [[-10.0, 2.0, 4.0], [0.0, -2.0, 3.5], [10.0, 1.0, 4.5], [18.0, 0.0, 4.0]]


@pytest.fixture
def pulled(block: Callable[..., str]) -> Callable[..., Simulation]:
    """Makes a block held at one end, with a cable of the given keys; it comes to rest in some 0.2 s."""

    def make(step: float = 0.01, block_keys: dict | None = None, **cable: object) -> Simulation:
        cable = {"points": BENT, "pull_point": [-30.0, 0.0, 4.0], **cable}
        table = silicone(block((8, 2, 2), SIZE), rayleigh_mass=1.0, anchors=[ROOT], cables={"tendon": cable})
        return simulate(step=step, soft_bodies={"block": {**table, **(block_keys or {})}})

    return make


def _pull(simulation: Simulation, index: int = 0) -> float:
    return float(simulation.model.cables.rest_value[index] - simulation.state.actuator_value[index])


def _geometry(model: Model, simulation: Simulation) -> ActuatorGeometry:
    geometry = ActuatorGeometry(model.actuators, model.node_count)
    geometry.update(simulation.state, model.placed_pull_points(simulation.state))
    return geometry


AREA = {"area": [[18.0, -4.0, 3.0], [18.0, 4.0, 3.0], [14.0, 0.0, 4.0]], "weights": [1.0, 1.0, 2.0]}


@pytest.mark.parametrize("points", [BENT, [*BENT[:3], AREA]])
def test_the_gradient_is_that_of_the_length(
    pulled: Callable[..., Simulation], figures: Figures, points: list[object]
) -> None:
    """d(pull)/dx = -dL/dx, by central differences of 1 um: their error is 1e-9 of a term."""
    simulation = pulled(points=points)
    advance(simulation, 0.3, Control(cable_pull={CABLE: 3.0}))
    model, state = simulation.model, simulation.state
    gradient = _geometry(model, simulation).gradient.soft.copy()
    worst = 0.0
    for entry, node in enumerate(model.actuators.coordinates.entry_node):
        for axis in range(3):
            shift = np.zeros((model.node_count, 3))
            shift[node, axis] = 1e-3
            ahead, behind = (measured(model, state.position + sign * shift).value[0] for sign in (1.0, -1.0))
            worst = max(worst, abs(-(ahead - behind) / 2e-3 - gradient[entry, axis]))
    figures.at_most("difference of the gradient", worst, 1e-8)


def test_an_area_is_pulled_in_shares(pulled: Callable[..., Simulation], figures: Figures) -> None:
    """A cable that ends in a glued-in plate acts as three cables to its points do that pull alike, in its shares.

    The three run from the same far pull point, so that they are parallel to 1e-5 of their tension.
    """
    far = [-3e6, 0.0, 4.0]
    one = pulled(points=[AREA], pull_point=far)
    advance(one, 0.5, Control(cable_tension={CABLE: 100.0}))
    cables = {str(k): {"points": [point], "pull_point": far} for k, point in enumerate(AREA["area"])}
    three = pulled(block_keys={"cables": cables})
    advance(three, 0.5, Control(cable_tension={"block.0": 25.0, "block.1": 25.0, "block.2": 50.0}))
    moved = np.abs(one.state.position - one.model.rest_position).max()
    difference = np.abs(one.state.position - three.state.position).max()
    figures.at_most("difference by motion", difference / moved, 1e-4)


def test_a_pull_does_the_work_that_the_block_stores(pulled: Callable[..., Simulation], figures: Figures) -> None:
    """Slowly pulled in, the work of the tension, sum T dL, is that of the elastic forces, - sum f dx.

    By the trapezoidal rule over 20 states at rest; tolerance 1e-3: its error, 1/n^2.
    """
    simulation = pulled()
    work = stored = 0.0
    last_force, last_position, last_tension = np.zeros((simulation.model.node_count, 3)), None, 0.0
    last_position, last_pull = simulation.state.position, 0.0
    for pull in np.linspace(0.2, 4.0, 20):
        advance(simulation, 0.5, Control(cable_pull={CABLE: float(pull)}))
        state = simulation.state
        assert simulation.model.elasticity is not None
        force = internal_force(simulation.model.elasticity, state.position)
        stored -= 0.5 * float(np.vdot(force + last_force, state.position - last_position))
        work += 0.5 * (state.actuator_effort[0] + last_tension) * (pull - last_pull)
        last_force, last_position, last_tension, last_pull = force, state.position, state.actuator_effort[0], pull
    figures.close("work over stored energy", work / stored, 1.0, 1e-3)


def test_an_imposed_length_holds_at_rest(pulled: Callable[..., Simulation], figures: Figures) -> None:
    """Tolerance 1e-9 mm; and the tension that it takes, imposed instead, gives the same pull (1e-6 mm: creep)."""
    by_length, by_tension = pulled(), pulled()
    advance(by_length, 2.0, Control(cable_pull={CABLE: 4.0}))
    figures.at_most("pull, off by [mm]", abs(_pull(by_length) - 4.0), 1e-9)
    tension = float(by_length.state.actuator_effort[0])
    assert tension > 100.0
    advance(by_tension, 3.0, Control(cable_tension={CABLE: tension}))
    figures.close("pull under the same tension [mm]", _pull(by_tension), 4.0, 1e-6)


def test_a_straight_channel_is_compressed_like_a_bar(block: Callable[..., str], figures: Figures) -> None:
    """Four cables through a block without lateral contraction shorten it by T l / (E A), between cross-sections.

    Points at the nodes, at both ends of the block; the mean over a cross-section is exact by equilibrium. Tolerance
    1e-3: the strain of 0.6e-3 squared, and its part in the rotation of elements.
    """
    corners = [(y, z) for y in (-2.5, 2.5) for z in (-2.5, 2.5)]
    cables = {f"c{n}": {"points": [[-20.0, y, z], [20.0, y, z]]} for n, (y, z) in enumerate(corners)}
    table = silicone(block((16, 4, 4), SIZE), poisson_ratio=0.0, rayleigh_mass=5.0, corotation="polar", cables=cables)
    simulation = simulate(soft_bodies={"block": table})
    tension = 7.5  # [mN] each
    advance(simulation, 2.0, Control(cable_tension={f"block.{name}": tension for name in cables}))
    rest = simulation.model.rest_position
    moved = (simulation.state.position - rest)[:, 0]

    def mean_over(plane: float) -> float:
        """By the trapezoidal rule: cut into triangles as the block is, the section's mean is within 1e-3 of it."""
        here = np.isclose(rest[:, 0], plane)
        weight = (1.0 + (np.abs(rest[here, 1]) < 4.9)) * (1.0 + (np.abs(rest[here, 2]) < 4.9))
        return float(np.average(moved[here], weights=weight))

    expected = 4 * tension * 20.0 / (500.0 * 100.0)
    figures.close("shortening over T l / (E A)", (mean_over(-10.0) - mean_over(10.0)) / expected, 1.0, 1e-3)


def test_a_free_body_is_driven_nowhere_by_its_own_cable(block: Callable[..., str], figures: Figures) -> None:
    """The forces of a cable sum to zero, and so do their moments: 1e-12 of the largest, round-off.

    In a simulation the centre of mass stays where it is.
    """
    table = silicone(block((8, 2, 2), SIZE), rayleigh_mass=1.0, corotation="polar", cables={"tendon": {"points": BENT}})
    simulation = simulate(soft_bodies={"block": table})
    mass = simulation.model.elasticity.node_mass[:, None]  # type: ignore[union-attr]
    start = (mass * simulation.state.position).sum(axis=0)
    advance(simulation, 0.5, Control(cable_pull={CABLE: 2.0}))
    gradient, coordinates = (
        _geometry(simulation.model, simulation).gradient.soft,
        simulation.model.actuators.coordinates,
    )
    moments = np.cross(simulation.state.position[coordinates.entry_node], gradient)
    figures.at_most("sum of forces", np.abs(gradient.sum(axis=0)).max(), 1e-12)
    figures.at_most("sum of moments [mm]", np.abs(moments.sum(axis=0)).max(), 1e-11)
    drift = np.abs((mass * simulation.state.position).sum(axis=0) - start).max() / mass.sum()
    figures.at_most("drift of the centre of mass [mm]", drift, 1e-9)


def test_a_cable_between_a_soft_and_a_rigid_body_keeps_momentum(block: Callable[..., str], figures: Figures) -> None:
    """Action is reaction, also for a row on a rigid body: to 1e-8 of the momentum, the direct solver's digits."""
    points = [[-18.0, 0.0, 3.0], [18.0, 0.0, 3.0], {"body": "cube", "point": [-5.0, 2.0, 3.0]}]
    points.append({"body": "cube", "point": [5.0, -2.0, 1.0]})
    table = silicone(block((8, 2, 2), SIZE), cables={"tendon": {"points": points}})
    cube = {"box": [10.0, 10.0, 10.0], "mass": 0.005, "position": [60.0, 0.0, 10.0]}
    simulation = simulate(soft_bodies={"block": table}, rigid_bodies={"cube": cube})
    node_mass = simulation.model.elasticity.node_mass[:, None]  # type: ignore[union-attr]
    before = _pull(simulation)
    advance(simulation, 0.2, Control(cable_tension={CABLE: 200.0}))
    soft = (node_mass * simulation.state.velocity).sum(axis=0)
    rigid = simulation.model.rigid_mass[0] * simulation.state.rigid_velocity[0]
    figures.at_most("momentum gained", float(np.abs(soft + rigid).max() / np.abs(rigid).max()), 1e-8)
    assert _pull(simulation) > before + 1.0  # it was pulled in
    assert np.abs(simulation.state.rigid_angular_velocity).max() > 0.1  # and turned the cube


def test_a_slack_cable_transmits_nothing(pulled: Callable[..., Simulation]) -> None:
    """Paid out, a cable leaves the block alone, to the bit of one that has no cable; a rod pushes it."""
    slack, rod, bare = pulled(), pulled(rod=True), pulled(block_keys={"cables": {}})
    advance(slack, 0.3, Control(cable_pull={CABLE: -3.0}))
    advance(bare, 0.3)
    advance(rod, 0.3, Control(cable_pull={CABLE: -3.0}))
    assert slack.state.actuator_effort[0] == 0.0
    assert (slack.state.position == bare.state.position).all()
    assert rod.state.actuator_effort[0] < -100.0
    assert _pull(rod) == pytest.approx(-3.0, abs=1e-6)


def test_a_motor_gives_way_and_a_stop_holds(pulled: Callable[..., Simulation]) -> None:
    """The largest tension bounds what a pull may take, a stop bounds how far a tension may pull."""
    weak = pulled(highest_tension=300.0)
    advance(weak, 1.0, Control(cable_pull={CABLE: 10.0}))
    assert weak.state.actuator_effort[0] == pytest.approx(300.0, rel=1e-12)
    assert 0.5 < _pull(weak) < 9.0
    free = pulled()
    advance(free, 1.0, Control(cable_tension={CABLE: 300.0}))
    assert _pull(weak) == pytest.approx(_pull(free), abs=1e-6)
    stopped = pulled(highest_pull=0.5 * _pull(free))
    advance(stopped, 1.0, Control(cable_tension={CABLE: 300.0}))
    assert _pull(stopped) == pytest.approx(0.5 * _pull(free), abs=1e-9)
    assert 50.0 < stopped.state.actuator_effort[0] < 290.0  # the stop takes the rest
    spooled = pulled(lowest_pull=0.3)
    advance(spooled, 1.0, Control(cable_tension={CABLE: 0.0}))
    assert _pull(spooled) == pytest.approx(0.3, abs=1e-9)
    assert spooled.state.actuator_effort[0] > 1.0


def _capstan(block: Callable[..., str], friction: float, corners: int = 60) -> Simulation:
    """A cable from far away over three quarters of a rigid polygon to a block that is held at its other end."""
    angles = np.linspace(0.0, 1.5 * math.pi, corners)
    # It comes in along -x over the top of the post (at the origin) and leaves it upwards along +y.
    around = [{"body": "post", "point": [20 * math.sin(-a), 20 * math.cos(a), 0.0]} for a in angles]
    table = silicone(
        block((8, 2, 2), SIZE),
        element="linear",
        rayleigh_mass=5.0,
        rayleigh_stiffness=0.001,  # at 1 mm/s its part of the force is less than a hundredth of a percent
        rotation=[0.0, 0.0, -90.0],
        translation=[20.0, 60.0, 0.0],
        anchors=[ROOT],
        cables={
            "tendon": {
                "points": [*around, [20.0, 0.0, 0.0]],
                "pull_point": [-20.0, 80.0, 0.0],
                "friction": friction,
            }
        },
    )
    post = {"plane": {"point": [0, 0, -100], "normal": [0, 0, 1]}}
    return simulate(soft_bodies={"block": table}, obstacles={"post": post})


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.8])
def test_a_rope_around_a_post(block: Callable[..., str], figures: Figures, friction: float) -> None:
    """Euler and Eytelwein: pulled, T1 / T2 = exp(mu theta); paid out again, T1 / T2 = exp(-mu theta).

    T2 is what the block feels: the sum of the elastic forces where it is held. Tolerance 1 %.
    """
    simulation = _capstan(block, friction)
    directions = np.diff(simulation.model.cables.all[0].rest_point, axis=0)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    theta = np.arccos(np.clip((directions[1:] * directions[:-1]).sum(axis=1), -1, 1)).sum()

    def ratio() -> float:
        elasticity = simulation.model.elasticity
        assert elasticity is not None
        force = internal_force(elasticity, simulation.state.position)
        block_tension = np.linalg.norm(force[simulation.model.anchored_nodes].sum(axis=0))
        return float(simulation.state.actuator_effort[0] / block_tension)

    for pull in np.linspace(0.05, 2.0, 40):
        advance(simulation, 0.03, Control(cable_pull={CABLE: float(pull)}))
    figures.close("pulled: log of the ratio over mu theta", math.log(ratio()) / (friction * theta), 1.0, 0.01)
    for pull in np.arange(1.99, 1.0, -0.01):
        advance(simulation, 0.01, Control(cable_pull={CABLE: float(pull)}))
    figures.close("paid out: log of the ratio over mu theta", math.log(ratio()) / (friction * theta), -1.0, 0.01)


def test_a_cable_that_rubs_sticks(block: Callable[..., str]) -> None:
    """Between the two laws of sliding it sticks: a little less tension moves nothing behind the post.

    Bounds: after pulling, the block feels T1 exp(-mu theta); with 20 % less at the pulled end it still does.
    """
    simulation = _capstan(block, 0.3)
    for tension in np.linspace(10.0, 400.0, 40):
        advance(simulation, 0.02, Control(cable_tension={CABLE: float(tension)}))
    advance(simulation, 0.5, Control(cable_tension={CABLE: 400.0}))
    behind = simulation.state.actuator_effort[0] - simulation.state.actuator_loss.sum()
    advance(simulation, 0.5, Control(cable_tension={CABLE: 320.0}))
    after = simulation.state.actuator_effort[0] - simulation.state.actuator_loss.sum()
    assert after == pytest.approx(behind, rel=1e-3)
    assert simulation.state.actuator_effort[0] == pytest.approx(320.0)


def test_the_base_takes_its_pull_points_along(pulled: Callable[..., Simulation]) -> None:
    """A robot that is carried about keeps its shape; a pull point that stays behind is pulled at."""
    moves, stays = pulled(), pulled(pull_point_moves=False)
    for simulation in (moves, stays):
        advance(simulation, 0.5, Control(cable_pull={CABLE: 2.0}, base_translation=np.zeros(3)))
    rest = moves.state.position
    shift = np.array([5.0, 3.0, -2.0])
    for fraction in np.linspace(0.1, 1.0, 10):
        for simulation in (moves, stays):
            advance(simulation, 0.05, Control(base_translation=fraction * shift))
    for simulation in (moves, stays):
        advance(simulation, 1.0)
    assert np.abs(moves.state.position - rest - shift).max() < 1e-5
    assert moves.state.actuator_effort[0] == pytest.approx(float(pulled_tension(pulled)), rel=1e-5)
    assert abs(stays.state.actuator_effort[0] - moves.state.actuator_effort[0]) > 50.0


def pulled_tension(pulled: Callable[..., Simulation]) -> float:
    """The tension of the cable of a base that never moved."""
    simulation = pulled()
    advance(simulation, 2.0, Control(cable_pull={CABLE: 2.0}))
    return float(simulation.state.actuator_effort[0])


def test_a_turned_base_turns_everything(pulled: Callable[..., Simulation]) -> None:
    """Objective: after a turn of the base by 90 degrees the tension is what it was, with exact rotations (polar)."""
    simulation = pulled(block_keys={"corotation": "polar"})
    advance(simulation, 1.0, Control(cable_pull={CABLE: 2.0}))
    before = float(simulation.state.actuator_effort[0])
    for angle in np.linspace(0.02, 1.0, 50):
        advance(simulation, 0.02, Control(base_rotation=np.array([0.0, 0.0, angle * math.pi / 2])))
    advance(simulation, 2.0)
    assert simulation.state.actuator_effort[0] == pytest.approx(before, rel=1e-5)


def test_cables_and_a_resumed_run_give_the_same_bits(pulled: Callable[..., Simulation]) -> None:
    """A state holds everything that a cable needs, its friction included."""
    simulation = pulled(friction=0.4)
    controls = [Control(cable_pull={CABLE: 0.1 * n}) for n in range(20)]
    for control in controls[:10]:
        simulation.step(control)
    kept = simulation.state.copy()
    for control in controls[10:]:
        simulation.step(control)
    again = Simulation(simulation.model)
    again.restore(kept)
    for control in controls[10:]:
        again.step(control)
    assert again.state == simulation.state
    assert (simulation.state.actuator_loss > 0.0).any()
