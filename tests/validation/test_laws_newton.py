"""Converged implicit Euler, `time.newton`: a step solves the equations at its end, with contacts and actuators."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
from actuator_geometry import measured
from blocks import make_block
from conftest import Figures
from scenes import FLOOR, GRAVITY, silicone, soft_momentum
from scipy.optimize import brentq, root

from taichisoft import Control, Simulation, write_volume_mesh
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.scene import scene_from_dict

SIZE = (30.0, 20.0, 10.0)
ELEMENTS = ("linear", "smoothed", "quadratic")
CAVITY = "block.cavity"
YEOH = {"c10": 36.0, "c20": 2.5, "c30": 0.2}
RUBBER = {"young_modulus": 60.0, "poisson_ratio": 0.45}


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A block of 48 tetrahedra."""
    path = tmp_path_factory.mktemp("mesh") / "block.msh"
    write_volume_mesh(make_block((2, 2, 2), SIZE), path)
    return str(path)


def simulate(body: dict[str, Any], newton: int, step: float = 0.05, gravity: float = 0.0, **tables: Any) -> Simulation:
    time = {"step": step, "newton": newton, **tables.pop("time", {})}
    return Simulation(
        scene_from_dict({"gravity": [0, 0, -gravity], "time": time, "soft_bodies": {"block": body}, **tables})
    )


def bent(rest: np.ndarray) -> np.ndarray:
    """Bent and turned, with strains of some 30 %."""
    x, y, z = rest.T
    return np.column_stack([x + 0.02 * x * z, y + 0.01 * x * y, 1.1 * z - 0.012 * x**2])


def left_over(simulation: Simulation, start: Any, forces: np.ndarray | float = 0.0) -> np.ndarray:
    """M (v - v0) - h (f(x) + M g + forces) at the end of the last step [mN s]."""
    model, state, step = simulation.model, simulation.state, simulation.model.scene.time.step
    assert model.elasticity is not None
    mass = model.elasticity.node_mass[:, None]
    force = internal_force(model.elasticity, state.position) + mass * state.gravity + forces
    left: np.ndarray = mass * (state.velocity - start.velocity) - step * force
    return left


KINDS = [
    ("linear", {"corotation": "edges"}),
    *((element, {"law": law}) for element, law in product(ELEMENTS, ("hooke", "neo-hookean"))),
    ("smoothed", {"law": "yeoh", "young_modulus": None, "coefficients": {"c10": 10.0, "c20": 2.0, "c30": 0.1}}),
]


@pytest.mark.parametrize(("element", "keys"), KINDS)
def test_the_equations_hold_at_the_end_of_a_step(mesh: str, element: str, keys: dict[str, Any]) -> None:
    """M (v - v0) = h (f(x) + M g), from a shape with large strains that is let go, x being that at the end.

    Tolerance 1e-6 of the largest impulse; one linearisation misses by more than a hundredth. Linear momentum is that of
    gravity to round-off, since inner forces have no sum.
    """
    body = {key: value for key, value in (silicone(mesh, **RUBBER) | keys).items() if value is not None}
    missed = {}
    for newton in (1, 60):
        simulation = simulate({**body, "element": element, "rayleigh_stiffness": 0.0}, newton, 0.02, GRAVITY)
        start = simulation.state.changed(position=bent(simulation.model.rest_position))
        simulation.restore(start)
        report = simulation.step()
        left = left_over(simulation, start)
        size = np.abs(left - simulation.model.elasticity.node_mass[:, None] * (simulation.state.velocity)).max()
        missed[newton] = np.abs(left).max() / size
        mass = simulation.model.elasticity.node_mass.sum()
        np.testing.assert_allclose(soft_momentum(simulation), [0, 0, -mass * GRAVITY * 0.02], atol=1e-9)
    assert report.converged
    assert report.newton_residual is not None
    assert report.newton_residual < 1e-7
    assert missed[60] < 1e-6
    assert missed[1] > 1e-2


@pytest.mark.parametrize(("element", "damped"), [*((element, False) for element in ELEMENTS), ("linear", True)])
def test_a_large_step_is_that_of_a_solver_of_equations(mesh: str, element: str, damped: bool) -> None:
    """Stress, damping, weight and masses written anew in numpy, and solved by scipy's `root` (Powell's hybrid method).

    Neo-Hookean P = mu F + (mu (J - 2) + l (J - 1)) cof F; the damping a M v + b K0 v has the slope of the forces at the
    start, which is rest, of the springs' too with `damped_anchors`. Both stop at 1e-8 mm: tolerance 1e-6 mm of a
    motion of 8 mm.
    """
    step, a, b = 0.1, 2.0, 0.03
    body = silicone(mesh, **RUBBER, element=element, law="neo-hookean", rayleigh_mass=a, rayleigh_stiffness=b)
    body |= {"density": 5e-6, "damped_anchors": damped}
    body["anchors"] = [{"box": [[-15, -10, -5], [-15, 10, 5]], "stiffness": 200.0}]
    simulation = simulate(body, 40, step, GRAVITY, time={"newton_tolerance": 1e-9})
    model = simulation.model
    assert model.elasticity is not None
    assert model.elasticity.domains is not None
    domains, rest = model.elasticity.domains.domains, model.rest_position
    mass, spring = model.elasticity.node_mass[:, None], model.elasticity.anchor_stiffness
    mu = RUBBER["young_modulus"] / (2 * (1 + RUBBER["poisson_ratio"]))
    lame = 2 * mu * RUBBER["poisson_ratio"] / (1 - 2 * RUBBER["poisson_ratio"])
    shape, volume = domains.volume.T

    def force(position: np.ndarray) -> np.ndarray:
        deformation = domains.deformation(position)
        j = np.linalg.det(deformation)
        cofactor = j[:, None, None] * np.linalg.inv(deformation).transpose(0, 2, 1)
        pressure = shape * mu * (j - 2) + volume * lame * (j - 1)
        stress = (shape * mu)[:, None, None] * deformation + pressure[:, None, None] * cofactor
        counts = np.diff(domains.start)
        pulls = np.einsum("eij,ej->ei", np.repeat(stress, counts, axis=0), domains.gradient)
        total = np.zeros_like(position)
        np.subtract.at(total, domains.node, pulls)
        return total

    axes = 1e-4 * np.eye(rest.size).reshape(-1, *rest.shape)
    stiffness = np.array([(force(rest - axis) - force(rest + axis)).ravel() / 2e-4 for axis in axes]).T
    if damped:
        stiffness += np.diag(spring.ravel())

    def equations(velocity: np.ndarray) -> np.ndarray:
        v = velocity.reshape(-1, 3)
        pull = force(rest + step * v) - spring * step * v + mass * np.array([0, 0, -GRAVITY]) - a * mass * v
        return (mass * v - step * pull).ravel() + step * b * stiffness @ velocity

    solution = root(equations, np.zeros(rest.size), tol=1e-12)
    report = simulation.step()
    assert report.converged
    motion = simulation.state.position - rest
    assert np.abs(motion).max() > 4.0
    np.testing.assert_allclose(motion, step * solution.x.reshape(-1, 3), atol=1e-6)


def pull_to(stretch: float, mesh: str, element: str, newton: int) -> Simulation:
    """A block of Yeoh's rubber whose length is set in one step of 1000 s, and whose sides slide freely."""
    body = silicone(mesh, element=element, law="yeoh", poisson_ratio=0.49, rayleigh_stiffness=0.0)
    body = {key: value for key, value in body.items() if key != "young_modulus"} | {"coefficients": YEOH}
    low, high = -np.array(SIZE) / 2, np.array(SIZE) / 2
    body["anchors"] = []
    for axis, at in ((0, low[0]), (0, high[0]), (1, low[1]), (2, low[2])):
        box = [np.where(np.arange(3) == axis, at, corner).tolist() for corner in (low, high)]
        body["anchors"].append({"box": box, "directions": ["xyz"[axis]], "stiffness": 1e9})
    simulation = simulate(body, newton, 1000.0, time={"newton_tolerance": 1e-7})
    held = simulation.model.rest_position[simulation.model.anchored_nodes].copy()
    held[:, 0] = np.where(held[:, 0] > high[0] - 1e-9, high[0] + (stretch - 1) * SIZE[0], held[:, 0])
    simulation.step(Control(anchor_positions={"block": held}))
    return simulation


def test_the_residual_falls_quadratically_in_tension(mesh: str, figures: Figures) -> None:
    """In tension the tangent is exact, and Newton's method squares the residual each time, until round-off.

    A block of quadratic elements that is pulled to 2.5 times its length: once the residual is below 1 mm, it
    falls with a power of at least 1.7.
    """
    residuals = []
    for newton in range(2, 8):
        report = pull_to(2.5, mesh, "quadratic", newton).report
        assert report is not None
        assert report.newton_residual is not None
        figures.at_most(f"residual after {newton} linearisations [mm]", report.newton_residual, 1e4)
        residuals.append(report.newton_residual)
    size = np.log([one for one in residuals if 1e-8 < one < 2.0])
    assert len(size) >= 3
    assert (np.diff(size)[1:] / np.diff(size)[:-1]).min() > 1.7
    assert residuals[-1] < 1e-7


@pytest.mark.parametrize("element", ["smoothed", "quadratic"])
@pytest.mark.parametrize("stretch", [0.5, 2.5])
def test_one_step_leads_to_rest_at_large_strain(mesh: str, element: str, stretch: float) -> None:
    """One step of 1000 s that sets the length: the sides give until their stress is zero, P_y = 0 of the same law.

    2 c1 y + (2 c1 (J - 2) + l (J - 1)) J / y = 0, c1 = c10 + 2 c20 K + 3 c30 K^2, K = I1 - 3 - 2 (J - 1) + (J - 1)^2,
    for sides y and J = x y^2. Tolerance 3e-6: anchors of 1e9 mN/mm.
    """
    simulation = pull_to(stretch, mesh, element, 60)
    report = simulation.report
    assert report is not None
    assert report.converged
    assert report.linearisations < (10 if stretch > 1.0 else 50)
    c10, c20, c30 = YEOH.values()
    lame = 4 * c10 * 0.49 / (1 - 2 * 0.49)

    def side_stress(y: float) -> float:
        j, i1 = stretch * y**2, stretch**2 + 2 * y**2
        k = i1 - 3 - 2 * (j - 1) + (j - 1) ** 2
        c1 = c10 + 2 * c20 * k + 3 * c30 * k**2
        return 2 * c1 * y + (2 * c1 * (j - 2) + lame * (j - 1)) * j / y

    sides = brentq(side_stress, 0.8 * stretch**-0.5, 1.2 * stretch**-0.5, xtol=1e-12)
    extent = np.ptp(simulation.state.position, axis=0) / SIZE
    np.testing.assert_allclose(extent, [stretch, sides, sides], rtol=3e-6)


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("law", ["hooke", "neo-hookean"])
def test_one_step_leads_to_rest_within_the_tolerance(mesh: str, element: str, law: str) -> None:
    """A cantilever that sags by its weight in one step of 1000 s, and in three: 1e-5 mm of some millimetres.

    The tolerance is a displacement, 1e-7 mm; as a velocity it allowed 0.01 mm in such a step. Under Hooke's law, whose
    slope leaves out how stress turns, the last linearisations gain a fixed share each: hence the hundredfold.
    """
    body = silicone(mesh, **RUBBER, element=element, law=law, density=2e-5, rayleigh_stiffness=0.0)
    body["anchors"] = [{"box": [[-15, -10, -5], [-15, 10, 5]]}]
    simulation = simulate(body, 100, 1000.0, GRAVITY)
    assert simulation.step().converged
    first = simulation.state.position
    for _ in range(2):
        simulation.step()
    assert np.abs(first - simulation.model.rest_position).max() > 1.0
    assert np.abs(simulation.state.position - first).max() < 1e-5


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_acts_on_the_shape_at_the_end(block: Callable[..., str], element: str) -> None:
    """f(x) + p dV/dx(x) = 0 after one step of 1000 s, 1e-6 of the largest force of the pressure; and the volume found
    is that which this pressure takes where it is imposed instead, but for 1e-6 of the pressure."""
    body = silicone(block((3, 3, 3), (30.0, 20.0, 20.0), hollow=True), **RUBBER, element=element)
    body |= {"cavities": {"cavity": {"group": "cavity"}}, "anchors": [{"box": [[-15, -10, -10], [-15, 10, 10]]}]}
    body |= {"law": "neo-hookean", "rayleigh_stiffness": 0.0}
    by_pressure, by_volume = (simulate(body, 60, 1000.0, time={"newton_tolerance": 1e-9}) for _ in range(2))
    pressure = 8.0
    assert by_pressure.step(Control(pressure={CAVITY: pressure})).converged
    model, state = by_pressure.model, by_pressure.state
    geometry = measured(model, state.position)
    assert model.elasticity is not None
    push = np.zeros_like(state.position)
    np.add.at(push, model.actuators.coordinates.entry_node, pressure * geometry.gradient.soft)
    force = internal_force(model.elasticity, state.position) + push
    free = np.setdiff1d(np.arange(model.node_count), model.anchored_nodes)
    assert np.abs(force[free]).max() < 1e-6 * np.abs(push).max()
    growth = float(state.actuator_value[0] - model.cavities.rest_value[0])
    assert growth > 0.05 * model.cavities.rest_value[0]
    assert by_volume.step(Control(volume_growth={CAVITY: growth})).converged
    assert by_volume.state.actuator_effort[0] == pytest.approx(pressure, rel=1e-6)
    assert by_volume.state.actuator_value[0] == pytest.approx(state.actuator_value[0], rel=1e-9)


def test_a_cable_is_as_short_as_it_is_pulled(mesh: str) -> None:
    """Pulled in by 5 mm in one step, it is 5 mm shorter at the end of it, to 1e-7 mm; with one linearisation it is not
    to 0.01 mm, since the block bends."""
    body = silicone(mesh, **RUBBER, element="smoothed", anchors=[{"box": [[-15, -10, -5], [-15, 10, 5]]}])
    body["cables"] = {"tendon": {"points": [[-14.0, 3.0, 4.0], [0.0, 3.0, 4.0], [14.0, 3.0, 4.0]]}}
    missed = {}
    for newton in (1, 40):
        simulation = simulate(body, newton, 0.1)
        report = simulation.step(Control(cable_pull={"block.tendon": 5.0}))
        missed[newton] = abs(simulation.model.cables.rest_value - simulation.state.actuator_value - 5.0)[0]
        assert report.converged
    assert missed[40] < 1e-7
    assert missed[1] > 1e-2


@pytest.mark.parametrize("element", ELEMENTS)
def test_contact_holds_at_the_end_of_a_step(mesh: str, element: str) -> None:
    """A soft block thrown on the floor and squashed by a twelfth of its height: after each step nothing is nearer
    than the contact distance, friction is within its cone, and nodes that touch nothing obey their equations.

    Tolerance of the equations 1e-6 of the largest momentum of a node, of the gap 1e-4 mm (`contact/surfaces.py`).
    """
    body = silicone(mesh, **RUBBER, element=element, law="neo-hookean", rayleigh_stiffness=0.0)
    body |= {"translation": [0, 0, 7.0], "velocity": [500.0, 0.0, -1000.0], "density": 1e-5}
    simulation = simulate(body, 60, 0.002, GRAVITY, obstacles={"floor": FLOOR})
    squashed = 1.0
    for _ in range(8):
        start = simulation.state
        report = simulation.step()
        state, model = simulation.state, simulation.model
        assert report.converged
        assert model.elasticity is not None
        left = left_over(simulation, start)
        touching = state.position[:, 2] < 1.5
        size = (model.elasticity.node_mass[:, None] * np.abs(start.velocity)).max()
        assert np.abs(left[~touching]).max() < 1e-6 * size
        np.testing.assert_allclose(left.sum(axis=0), -state.contact_impulse.sum(axis=0), atol=1e-9)
        assert state.position[:, 2].min() > 1.0 - 1e-4
        normal, slip = -state.contact_impulse[:, 2], state.contact_impulse[:, :2]
        assert (np.linalg.norm(slip, axis=1) <= 0.6 * normal * (1 + 1e-9) + 1e-12).all()
        squashed = min(squashed, np.ptp(state.position[:, 2]) / SIZE[2])
    assert squashed < 0.93
