"""Air in a closed cavity: what its pressure does, and that pressure and volume are two sides of one thing."""

from collections.abc import Callable

import numpy as np
import pytest
from actuator_geometry import measured
from conftest import Figures
from scenes import advance, silicone, simulate

from taichisoft import Control, Model, Simulation

SIZE = (30.0, 20.0, 20.0)
CAVITY = "block.cavity"
ELEMENTS = ("linear", "quadratic")
"""The walls of quadratic elements are six-node triangles."""


@pytest.fixture
def hollow(block: Callable[..., str]) -> Callable[..., Simulation]:
    """Makes a hollow block held at one end, for a time step; it comes to rest in some 0.2 s."""
    table = silicone(
        block((3, 3, 3), SIZE, hollow=True),
        rayleigh_mass=1.0,
        cavities={"cavity": {"group": "cavity"}},
        anchors=[{"box": [[-15, -10, -10], [-15, 10, 10]]}],
    )
    return lambda step, element="linear": simulate(step=step, soft_bodies={"block": {**table, "element": element}})


def _deformed(model: Model) -> np.ndarray:
    return model.rest_position + np.random.default_rng(3).uniform(-1, 1, (model.node_count, 3))


@pytest.mark.parametrize("element", ELEMENTS)
def test_pressure_in_a_closed_cavity_pushes_the_body_nowhere(hollow: Callable[..., Simulation], element: str) -> None:
    """sum dV/dx = 0 and sum x cross dV/dx = 0 for any shape, or a body in free space would drive itself.

    Tolerance 1e-12 of the largest term: round-off.
    """
    model = hollow(0.01, element).model
    position = _deformed(model)
    gradient = measured(model, position).gradient.soft
    moments = np.cross(position[model.actuators.coordinates.entry_node], gradient)
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).max()
    assert np.abs(moments.sum(axis=0)).max() < 1e-12 * np.abs(moments).max()


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_gradient_is_that_of_the_volume(hollow: Callable[..., Simulation], element: str) -> None:
    """Virtual work: p dV = sum p dV/dx . dx. The volume of this mesh is linear in each coordinate, so that central
    differences of 1 mm are exact; tolerance 1e-12 of the volume of 3000 mm^3: round-off."""
    model = hollow(0.01, element).model
    position = _deformed(model)
    geometry = measured(model, position)
    volume, gradient = geometry.value[0], geometry.gradient.soft
    for entry, node in enumerate(model.actuators.coordinates.entry_node):
        for axis in range(3):
            shift = np.zeros_like(position)
            shift[node, axis] = 1.0
            ahead, behind = (measured(model, position + sign * shift).value[0] for sign in (1.0, -1.0))
            assert 0.5 * (ahead - behind) == pytest.approx(gradient[entry, axis], abs=1e-12 * volume)


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_volume_at_rest_is_that_of_the_hole(hollow: Callable[..., Simulation], element: str) -> None:
    """A third of the block in every direction: 10 x 20/3 x 20/3 mm; exact but for round-off."""
    assert hollow(0.01, element).model.cavities.rest_value[0] == pytest.approx(10 * (20 / 3) ** 2, rel=1e-12)


def test_pressure_does_not_depend_on_the_time_step(hollow: Callable[..., Simulation], figures: Figures) -> None:
    """The shape at rest solves f(x) + p dV/dx = 0, where no step appears (in SOFA the value is an impulse).

    Tolerance 1e-9 of the displacement: what is left of the motion after 0.5 s.
    """
    shapes = {}
    for step in (0.02, 0.01, 0.005, 0.001):
        simulation = hollow(step)
        report = advance(simulation, 0.5, Control(pressure={CAVITY: 100.0}))
        assert report.observation.pressures[CAVITY] == pytest.approx(100.0, rel=1e-12)
        shapes[step] = simulation.state.position
    displacement = np.abs(shapes[0.001] - simulation.model.rest_position).max()
    assert displacement > 0.2
    for step in (0.02, 0.01, 0.005):
        miss = np.abs(shapes[step] - shapes[0.001]).max() / displacement
        figures.at_most(f"shape with steps of {step * 1e3:g} ms and of 1 ms", miss, 1e-9)


def test_volume_and_pressure_are_dual(hollow: Callable[..., Simulation], figures: Figures) -> None:
    """The pressure that an imposed volume takes, imposed, gives that volume. Tolerance 1e-9: rest, as above."""
    by_volume = hollow(0.01)
    report = advance(by_volume, 0.5, Control(volume_growth={CAVITY: 100.0}))
    pressure = report.observation.pressures[CAVITY]
    assert pressure > 1.0
    by_pressure = hollow(0.01)
    report = advance(by_pressure, 0.5, Control(pressure={CAVITY: pressure}))
    growth = report.observation.volumes[CAVITY] - by_pressure.model.cavities.rest_value[0]
    figures.close("growth of the volume [mm^3]", growth, 100.0, 1e-7)


@pytest.mark.parametrize("unlimited", [True, False])
def test_a_valve_opens_and_air_runs_out(block: Callable[..., str], unlimited: bool) -> None:
    """A valve bounds the pressure of an imposed volume, and then the volume is that of the pressure; air that runs out
    bounds the volume whatever the pressure asked for, and then the pressure is that of the volume."""

    def make(**limits: float) -> Simulation:
        cavity = {"group": "cavity", **({} if unlimited else limits)}
        anchor = {"box": [[-15, -10, -10], [-15, 10, 10]]}
        table = silicone(block((3, 3, 3), SIZE, True), rayleigh_mass=1.0, cavities={"cavity": cavity}, anchors=[anchor])
        return simulate(soft_bodies={"block": table})

    def growth(simulation: Simulation) -> float:
        return float(simulation.state.actuator_value[0] - simulation.model.cavities.rest_value[0])

    free = make()
    advance(free, 0.5, Control(pressure={CAVITY: 60.0}))
    valve, air = make(highest_pressure=60.0), make(highest_volume_growth=0.5 * growth(free))
    advance(valve, 0.5, Control(volume_growth={CAVITY: 2.0 * growth(free)}))
    advance(air, 0.5, Control(pressure={CAVITY: 60.0}))
    if unlimited:
        assert growth(valve) == pytest.approx(2.0 * growth(free))
        assert growth(air) == pytest.approx(growth(free))
    else:
        assert valve.state.actuator_effort[0] == pytest.approx(60.0, rel=1e-12)
        assert growth(valve) == pytest.approx(growth(free), rel=1e-6)
        assert growth(air) == pytest.approx(0.5 * growth(free), rel=1e-9)
        assert 20.0 < air.state.actuator_effort[0] < 40.0
