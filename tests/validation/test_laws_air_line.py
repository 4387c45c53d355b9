"""Air that flows through valve and tube: ISO 6358 for stiff walls, no air lost, and valves that are wide or shut."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import silicone, simulate
from scipy.optimize import brentq

from taichisoft import Control, Simulation
from taichisoft.errors import ControlError
from taichisoft.mechanics.cavity_air import LAMINAR, PRESSURE_TIMES_VOLUME, REFERENCE_DENSITY, Orifice, tube

SIZE = (30.0, 20.0, 20.0)
CAVITY = "block.cavity"
ATMOSPHERE = 101.325
CONDUCTANCE, RATIO = 2e-3, 0.3

Make = Callable[..., Simulation]


@pytest.fixture
def hollow(block: Callable[..., str]) -> Make:
    """Makes a hollow block on a line; its cavity has 444 mm^3."""

    def make(line: dict[str, Any], step: float = 0.001, young_modulus: float = 1e7, **cavity: Any) -> Simulation:
        air = {"air": "line", "line": {"conductance": CONDUCTANCE, "critical_ratio": RATIO, **line}} if line else cavity
        table = silicone(
            block((3, 3, 3), SIZE, hollow=True),
            young_modulus=young_modulus,
            rayleigh_mass=10.0,
            element="linear",
            cavities={"cavity": {"group": "cavity", **air}},
            anchors=[{"box": [[-15, -10, -10], [-15, 10, 10]]}],
        )
        return simulate(step=step, soft_bodies={"block": table})

    return make


def absolute(simulation: Simulation) -> float:
    """Pressure in the last step [kPa]."""
    return float(simulation.state.actuator_effort[0]) + ATMOSPHERE


def test_filling_is_that_of_iso_6358(hollow: Make, figures: Figures) -> None:
    """A stiff volume at constant temperature, from a source p1: p' = k p1 while p < b p1, k = C rho0 R T / V, and then

        p / p1 = b + (1 - b) sin(k (t - t_b) / (1 - b)),

    which is the ellipse of ISO 6358 integrated. Tolerance 1 %: implicit Euler's steps of 1 ms.
    """
    simulation = hollow({"supply": 500.0})
    volume, source = simulation.model.cavities.rest_value[0], 500.0 + ATMOSPHERE
    rate = CONDUCTANCE / 100.0 * REFERENCE_DENSITY * PRESSURE_TIMES_VOLUME / volume
    sonic_until = (RATIO * source - ATMOSPHERE) / (rate * source)
    end = sonic_until + 0.5 * math.pi * (1.0 - RATIO) / rate
    assert 0.01 < sonic_until < 0.1 < end < 0.5
    worst = 0.0
    for _ in range(round(end / 0.001)):
        time = simulation.step(Control(valve={CAVITY: 1.0})).time
        expected = ATMOSPHERE + rate * source * time
        if time > sonic_until:
            angle = min(rate * (time - sonic_until) / (1.0 - RATIO), 0.5 * math.pi)
            expected = source * (RATIO + (1.0 - RATIO) * math.sin(angle))
        worst = max(worst, abs(absolute(simulation) / expected - 1.0))
    figures.at_most("pressure while a stiff volume is filled, against the closed form", worst, 0.01)


def test_venting_is_that_of_iso_6358(hollow: Make, figures: Figures) -> None:
    """Sonic flow out of a stiff volume at constant temperature: p = p0 exp(-k t), while p_a < b p. Tolerance 1 %."""
    simulation = hollow({"supply": 500.0})
    rate = CONDUCTANCE / 100.0 * REFERENCE_DENSITY * PRESSURE_TIMES_VOLUME / simulation.model.cavities.rest_value[0]
    while absolute(simulation) < 500.0:
        simulation.step(Control(valve={CAVITY: 1.0}))
    start, begun, worst, count = absolute(simulation), simulation.state.time, 0.0, 0
    while RATIO * absolute(simulation) > ATMOSPHERE:
        time = simulation.step(Control(valve={CAVITY: -1.0})).time - begun
        worst, count = max(worst, abs(absolute(simulation) / (start * math.exp(-rate * time)) - 1.0)), count + 1
    assert count > 50
    figures.at_most("pressure while a stiff volume is vented, against the closed form", worst, 0.01)


@pytest.mark.parametrize("step", [0.01, 0.05])
@pytest.mark.parametrize(
    "line",
    [
        {"supply": 80.0, "exhaust": -60.0},
        {"supply": 80.0, "tube_length": 300.0, "tube_diameter": 1.5},
        {
            "supply": 20.0,
            "valve": "on/off",
            "period": 0.07,
            "conductance": 0.05,
            "tube_length": 50.0,
            "tube_diameter": 4.0,
        },
        {"conductance": 2.0, "response_time": 0.03, "delay": 0.02},
    ],
    ids=["vacuum", "tube", "on/off", "regulator"],
)
def test_no_air_is_lost(hollow: Make, figures: Figures, line: dict[str, Any], step: float) -> None:
    """The mass is that at the start and what the valve let through, to 1e-12; pressure, volume and mass agree.

    At rest p V = m R T, and every step converges, whatever the valve does.
    """
    simulation = hollow(line, step=step, young_modulus=60.0)
    first, through, most = float(simulation.state.air_mass[0]), 0.0, 0.0
    openings = [1.0, 0.4, -1.0, 0.0, -0.2, 1.0, 0.0]
    for number in range(42):
        opening = openings[number // 6]
        asked = Control(valve={CAVITY: opening}) if "supply" in line else Control(pressure={CAVITY: 20.0 * opening})
        report = simulation.step(asked)
        assert report.converged
        assert report.observation.air_masses[CAVITY] == simulation.state.air_mass[0]
        through += step * report.observation.air_flows[CAVITY]
        most = max(most, float(simulation.state.air_mass[0]))
    kept = float(simulation.state.air_mass[0])
    assert most > 1.2 * first
    figures.at_most(f"air lost, h = {step * 1e3:g} ms [-]", abs(kept - first - through) / first, 1e-12)
    for _ in range(round(2.0 / step)):
        simulation.step(Control(valve={CAVITY: 0.0}))
    inside = float(simulation.state.air_mass[0] - simulation.state.tube_air_mass[0])
    work = absolute(simulation) * float(simulation.state.actuator_value[0])
    figures.close("p V / (m R T) at rest", work / (inside * PRESSURE_TIMES_VOLUME), 1.0, 1e-6)


def test_a_line_that_is_shut_is_sealed_air(hollow: Make, figures: Figures) -> None:
    """With the valve shut a line is sealed air, its tube a dead volume. Tolerance 1e-6: the rest of the motion."""
    line = hollow({"supply": 50.0, "tube_length": 100.0, "tube_diameter": 2.0}, step=0.01, young_modulus=60.0)
    for _ in range(20):
        line.step(Control(valve={CAVITY: 1.0}))
    volume = line.model.cavities.rest_value[0] + 0.25 * math.pi * 4.0 * 100.0
    shut_pressure = float(line.state.air_mass[0]) * PRESSURE_TIMES_VOLUME / volume - ATMOSPHERE
    dead = {"air": "sealed", "dead_volume": 100.0 * math.pi, "shut_pressure": shut_pressure}
    sealed = hollow({}, step=0.01, young_modulus=60.0, **dead)
    load = np.array([0.0, 0.0, -2e4])
    for _ in range(200):
        line.step(Control(valve={CAVITY: 0.0}, gravity=load))
        sealed.step(Control(gravity=load))
    assert absolute(line) > ATMOSPHERE + 5.0
    figures.close("pressure [kPa]", absolute(line), absolute(sealed), 1e-6 * absolute(sealed))


@pytest.mark.parametrize("step", [0.01, 0.05])
def test_a_wide_valve_is_a_regulated_pressure(hollow: Make, figures: Figures, step: float) -> None:
    """The wider the valve of a regulator, the nearer is the motion to that of regulated air. Tolerance 1e-3 kPa."""
    line, regulated = hollow({"conductance": 100.0}, step, 60.0), hollow({}, step, 60.0)
    worst = 0.0
    for pressure in (10.0, 20.0, 5.0, -10.0, -10.0):
        reports = [simulation.step(Control(pressure={CAVITY: pressure})) for simulation in (line, regulated)]
        assert all(report.converged for report in reports)
        worst = max(worst, abs(absolute(line) - absolute(regulated)))
    figures.at_most(f"pressures with wide valve and regulated, h = {step * 1e3:g} ms [kPa]", worst, 1e-3)


def test_the_flow_has_the_slopes_that_it_says() -> None:
    """Derivatives against central differences; the flow turns its sign with its direction, and has no jump."""
    orifice = Orifice(0.5, 0.25)
    for first, second in ((500.0, 101.0), (500.0, 300.0), (500.0, 499.9), (120.0, 400.0), (90.0, 600.0)):
        flow, *slopes = orifice.flow(first, second)
        assert flow == -orifice.flow(second, first)[0] and flow * (first - second) > 0.0
        for slope, ahead, behind in (
            (slopes[0], orifice.flow(first + 1e-3, second)[0], orifice.flow(first - 1e-3, second)[0]),
            (slopes[1], orifice.flow(first, second + 1e-3)[0], orifice.flow(first, second - 1e-3)[0]),
        ):
            assert slope == pytest.approx((ahead - behind) / 2e-3, rel=1e-5, abs=1e-12)
    for ratio in (0.25, LAMINAR):
        below, above = (orifice.flow(500.0, 500.0 * ratio * (1 + side * 1e-9))[0] for side in (-1, 1))
        assert above == pytest.approx(below, rel=1e-5)
    assert orifice.flow(100.0, 100.0)[0] == 0.0


def test_longer_and_thinner_tubes_let_less_through() -> None:
    """4 mm by 1 m has about 1.2 dm^3/(s bar), b about 0.35, as tables of makers have it (1.0 to 1.3)."""
    usual = tube(1000.0, 4.0)
    assert usual.conductance == pytest.approx(1.2, abs=0.1) and usual.critical_ratio == pytest.approx(0.35, abs=0.05)
    assert tube(2000.0, 4.0).conductance < usual.conductance > tube(1000.0, 3.0).conductance


def fanno_flow(length: float, diameter: float, inlet: float, outlet: float) -> float:
    """Mass flow [kg/s] of air through a smooth tube [mm] between absolute pressures [kPa], adiabatic with friction.

    Fanno flow behind an isentropic entry, with friction by Blasius, f = 0.3164 / Re^0.25.
    """
    area, ratio = 0.25 * math.pi * (1e-3 * diameter) ** 2, length / diameter

    def friction_length(mach: float) -> float:
        warm = 0.5 * 2.4 * mach**2 / (1.0 + 0.2 * mach**2)
        return (1.0 - mach**2) / (1.4 * mach**2) + 2.4 / 2.8 * math.log(warm)

    def entry(mach: float) -> tuple[float, float, float]:
        """Flow [kg/s], pressure [kPa], and length of friction that is left behind the tube, for a Mach number."""
        warm = 1.0 + 0.2 * mach**2
        pressure = inlet / warm**3.5
        flow = 1e3 * pressure * mach * math.sqrt(1.4 * warm / (287.05 * 293.15)) * area
        friction = 0.3164 / (4.0 * flow / (math.pi * 1e-3 * diameter * 1.81e-5)) ** 0.25
        return flow, pressure, friction_length(mach) - friction * ratio

    def exit_pressure(mach: float) -> float:
        _, pressure, left = entry(mach)
        end = brentq(lambda other: friction_length(other) - left, 1e-6, 1.0) if left > 1e-9 else 1.0
        return float(pressure * mach / end * math.sqrt((1.0 + 0.2 * mach**2) / (1.0 + 0.2 * end**2)))

    choked = brentq(lambda mach: entry(mach)[2], 1e-3, 0.999)
    if exit_pressure(choked) >= outlet:
        return entry(choked)[0]
    return entry(brentq(lambda mach: exit_pressure(mach) - outlet, 1e-4, choked * (1.0 - 1e-9)))[0]


@pytest.mark.parametrize(
    ("length", "diameter"), [(500.0, 2.0), (1000.0, 2.5), (200.0, 4.0), (1000.0, 4.0), (5000.0, 6.0)]
)
def test_a_tube_lets_through_what_friction_leaves(figures: Figures, length: float, diameter: float) -> None:
    """The formula of a tube is one fitted constant for all flows: within 20 % of adiabatic flow with wall friction."""
    pressures = ((700.0, 1.0), (200.0, 1.0), (200.0, ATMOSPHERE), (150.0, ATMOSPHERE), (120.0, ATMOSPHERE))
    shares = [tube(length, diameter).flow(*both)[0] / fanno_flow(length, diameter, *both) for both in pressures]
    figures.at_most(f"off by, {diameter:g} mm by {length:g} mm", max(abs(share - 1.0) for share in shares), 0.22)


def test_requests_take_effect_after_delay_and_response(hollow: Make) -> None:
    """A proportional valve: nothing for 20 ms, then 1 - exp(-t / T) of the way. An on/off valve: shares of steps."""
    proportional = hollow({"supply": 50.0, "delay": 0.02, "response_time": 0.03}, step=0.01)
    seen = [proportional.step(Control(valve={CAVITY: 0.8})).observation.valve_openings[CAVITY] for _ in range(5)]
    assert seen == pytest.approx([0.0, 0.0, *(0.8 * (1.0 - math.exp(-time / 0.03)) for time in (0.01, 0.02, 0.03))])
    switched = hollow({"supply": 50.0, "valve": "on/off", "period": 0.04}, step=0.01)
    seen = [switched.step(Control(valve={CAVITY: -0.625})).observation.valve_openings[CAVITY] for _ in range(6)]
    assert seen == pytest.approx([-1.0, -1.0, -0.5, 0.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("line", "control", "message"),
    [
        ({}, {"valve": {CAVITY: 1.5}}, "= 1.5: must be from -1 (open to the exhaust) to 1 (open to the source)"),
        ({}, {"valve": {CAVITY: math.nan}}, "= nan: must be one finite number"),
        (
            {"supply": 50.0},
            {"pressure": {CAVITY: 5.0}},
            ': cannot be asked for, its air is "line" with a supply of constant pressure',
        ),
        ({}, {"volume_growth": {CAVITY: 5.0}}, ': cannot be asked for, its air is "line"'),
    ],
)
def test_what_cannot_be_asked_of_a_line(hollow: Make, line: dict[str, Any], control: Any, message: str) -> None:
    simulation = hollow({"delay": 0.01, **line})
    (key,) = control
    before = simulation.state
    with pytest.raises(ControlError) as error:
        simulation.step(Control(**control))
    assert str(error.value) == f"control.{key}['{CAVITY}']{' ' if message[0] == '=' else ''}{message}"
    assert simulation.state is before
