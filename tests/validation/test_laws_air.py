"""Air that is shut into a cavity obeys p V^n = const, together with the body around it, at rest and in motion."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from actuator_geometry import measured
from conftest import Figures
from energy import total_energy
from scenes import advance, silicone, simulate
from scipy.optimize import brentq

from taichisoft import Control, Simulation
from taichisoft.errors import ControlError

SIZE = (30.0, 20.0, 20.0)
CAVITY = "block.cavity"
ATMOSPHERE = 101.325

Make = Callable[..., Simulation]


@pytest.fixture
def hollow(block: Callable[..., str]) -> Make:
    """Makes a soft hollow block held at one end, whose walls follow the air; 10 kPa bulge it by a fifth."""

    def make(time: dict[str, Any] | None = None, body: dict[str, Any] | None = None, **cavity: Any) -> Simulation:
        table = silicone(
            block((3, 3, 3), SIZE, hollow=True),
            young_modulus=60.0,
            rayleigh_stiffness=0.0,
            element="linear",
            cavities={"cavity": {"group": "cavity", **cavity}},
            anchors=[{"box": [[-15, -10, -10], [-15, 10, 10]]}],
        )
        return simulate(time={"step": 0.01, **(time or {})}, soft_bodies={"block": {**table, **(body or {})}})

    return make


def pressure_and_volume(simulation: Simulation) -> tuple[float, float]:
    """Absolute pressure in the last step [kPa], and volume after it [mm^3]."""
    state = simulation.state
    return float(state.actuator_effort[0]) + simulation.model.cavities.atmosphere, float(state.actuator_value[0])


@pytest.mark.parametrize("step", [0.01, 0.05])
@pytest.mark.parametrize(("exponent", "dead_volume"), [(1.0, 0.0), (1.4, 700.0)])
def test_pressure_and_motion_are_found_together(
    hollow: Make, figures: Figures, step: float, exponent: float, dead_volume: float
) -> None:
    """The end of a step is where body and air agree, as scipy finds it.

    A linearised step is affine in the pressure, so steps with imposed pressures of 0 and 1 kPa give the volume that it
    leads to at any pressure, V + h dV/dx . v(p). brentq finds p (V + V_d)^n = const on it. Tolerance 1e-6 [-] of the
    absolute pressure, for every one of the first steps of air that bursts in at 60 kPa.
    """
    air = {"air": "sealed", "shut_pressure": 60.0, "exponent": exponent, "dead_volume": dead_volume}
    simulation, imposed = hollow({"step": step}, **air), hollow({"step": step})
    rest = simulation.model.cavities.rest_value[0] + dead_volume
    worst = 0.0
    for _ in range(12):
        before = simulation.state
        geometry, ends = measured(simulation.model, before.position), []
        for pressure in (0.0, 1.0):
            imposed.restore(before)
            imposed.step(Control(pressure={CAVITY: pressure}))
            ends.append(before.actuator_value[0] + step * geometry.rates(imposed.state.velocity, np.zeros((0, 6)))[0])
        simulation.step()

        def missed(pressure: float, at_zero: float = ends[0], slope: float = ends[1] - ends[0]) -> float:
            space = at_zero + slope * pressure + dead_volume
            return math.log(pressure + ATMOSPHERE) - math.log(60.0 + ATMOSPHERE) + exponent * math.log(space / rest)

        # The space is positive and the pressure above the vacuum's between these.
        lowest = max(-ATMOSPHERE, -(ends[0] + dead_volume) / (ends[1] - ends[0])) + 1e-6
        expected = brentq(missed, lowest, 1e5, xtol=1e-12, rtol=1e-14)
        found = float(simulation.state.actuator_effort[0])
        worst = max(worst, abs(found - expected) / (expected + ATMOSPHERE))
    figures.at_most(f"pressure against scipy's, h = {step * 1e3:g} ms, n = {exponent:g}", worst, 1e-6)


@pytest.mark.parametrize("step", [0.01, 0.05])
@pytest.mark.parametrize("exponent", [1.0, 1.4])
def test_the_gas_law_holds_in_motion(hollow: Make, figures: Figures, step: float, exponent: float) -> None:
    """p V^n = const at the end of every step whose equations are solved there (`time.newton`).

    Tolerance 1e-6, which `newton_tolerance` of 1e-7 mm leaves of the volume.
    """
    time = {"step": step, "newton": 40, "newton_tolerance": 1e-7}
    simulation = hollow(time, air="sealed", shut_pressure=30.0, exponent=exponent)
    constant = (30.0 + ATMOSPHERE) * simulation.model.cavities.rest_value[0] ** exponent
    worst, volumes = 0.0, []
    for _ in range(20):
        report = simulation.step(Control(gravity=np.array([0.0, 0.0, -3e4])))
        assert report.converged
        pressure, volume = pressure_and_volume(simulation)
        worst, volumes = max(worst, abs(pressure * volume**exponent / constant - 1.0)), [*volumes, volume]
    assert max(volumes) > 1.1 * simulation.model.cavities.rest_value[0]
    figures.at_most(f"p V^n - const, h = {step * 1e3:g} ms, n = {exponent:g} [-]", worst, 1e-6)


def test_one_linearisation_comes_to_rest_where_the_gas_law_holds(hollow: Make, figures: Figures) -> None:
    """What a linearised step leaves of the volume is not carried on: mass is the state, so at rest p V = const.

    Tolerance 1e-9 [-]: what is left of the motion.
    """
    simulation = hollow(air="sealed", shut_pressure=30.0, body={"rayleigh_mass": 10.0})
    mass = simulation.state.air_mass[0]
    advance(simulation, 3.0)
    pressure, volume = pressure_and_volume(simulation)
    assert volume > 1.1 * simulation.model.cavities.rest_value[0]
    figures.close("p V at rest over that at the start", pressure * volume, (30 + ATMOSPHERE) * 10 * (20 / 3) ** 2, 1e-4)
    figures.close("mass of the air [mg]", 1e6 * simulation.state.air_mass[0], 1e6 * mass, 1e-12 * 1e6 * mass)


@pytest.mark.parametrize("step", [0.01, 0.05])
def test_a_sealed_body_gains_no_energy(hollow: Make, figures: Figures, step: float) -> None:
    """The air's free energy is -p0 V0 ln V, and p_a V for the atmosphere's; with it a body that swings gains nothing.

    Implicit Euler takes from the motion, and more in longer steps. Tolerance 1e-6 of the energy of the first swing: the
    residuals of the equations.
    """
    simulation = hollow({"step": step, "newton": 40, "newton_tolerance": 1e-7}, air="sealed", shut_pressure=20.0)
    work = (20.0 + ATMOSPHERE) * simulation.model.cavities.rest_value[0]

    def energy() -> float:
        volume = float(simulation.state.actuator_value[0])
        return total_energy(simulation) - work * math.log(volume) + ATMOSPHERE * volume

    levels = [energy()]
    for _ in range(30):
        simulation.step()
        levels.append(energy())
    lost = levels[0] - levels[-1]
    assert lost > 1.0
    figures.at_most(f"largest gain in a step of {step * 1e3:g} ms, of what is lost", max(np.diff(levels)) / lost, 1e-6)


def test_shut_air_lies_between_held_pressure_and_held_volume(hollow: Make) -> None:
    """Sideways load on a body at 10 kPa: its air stiffens it, if less than water would; the pressure rises by V0/V.

    Air that is shut in where a regulator has filled the body has room temperature there, and nothing moves. Without
    flow of heat it is stiffer.
    """
    load = np.array([0.0, 0.0, -2e4])

    def deflection(simulation: Simulation, control: Control) -> float:
        before = simulation.state.position
        advance(simulation, 1.5, control)
        return float(np.abs(simulation.state.position - before).max())

    damped = {"rayleigh_mass": 20.0}
    regulated = hollow(body=damped)
    advance(regulated, 1.5, Control(pressure={CAVITY: 10.0}))
    pressure, volume = pressure_and_volume(regulated)
    rest = regulated.model.cavities.rest_value[0]
    start = regulated.state
    shut = hollow(body=damped, air="sealed", shut_pressure=pressure * volume / rest - ATMOSPHERE)
    advance(shut, 1.5)
    assert np.abs(shut.state.position - start.position).max() < 1e-6
    moved = [deflection(shut, Control(gravity=load))]
    adiabatic = hollow(body=damped, air="sealed", exponent=1.4)
    adiabatic.restore(start)
    advance(adiabatic, 0.1)
    assert np.abs(adiabatic.state.position - start.position).max() < 1e-5
    of_adiabatic = deflection(adiabatic, Control(gravity=load))
    for asked in ({"pressure": {CAVITY: 10.0}}, {"volume_growth": {CAVITY: volume - rest}}):
        regulated.restore(start)
        moved.append(deflection(regulated, Control(gravity=load, **asked)))
    of_shut, of_pressure, of_volume = moved
    assert of_volume < of_adiabatic < of_shut < of_pressure


def test_what_cannot_be_asked_of_sealed_air(hollow: Make) -> None:
    simulation = hollow(air="sealed")
    for key in ("pressure", "volume_growth"):
        with pytest.raises(ControlError) as error:
            simulation.step(Control(**{key: {CAVITY: 1.0}}))
        assert str(error.value) == f"control.{key}['{CAVITY}']: cannot be asked for, its air is \"sealed\""


def test_suction_ends_at_the_vacuum(hollow: Make) -> None:
    """No pump draws below - atmosphere: such a request is held back, and the controller sees that it was."""
    simulation = hollow(body={"young_modulus": 5000.0})
    seen = simulation.step(Control(pressure={CAVITY: -150.0})).observation
    assert seen.pressures[CAVITY] == -ATMOSPHERE and seen.clipped == (CAVITY,)
    assert seen.air_masses[CAVITY] == 0.0
