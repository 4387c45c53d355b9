"""Cavities on one supply, joined by tubes, valves and tanks: no air is lost, and flow is that of ISO 6358."""

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Figures
from scenes import silicone, simulate
from scipy.integrate import solve_ivp
from test_laws_linearisation import largest_error
from test_laws_reduced import chamber, write_modes

from taichisoft import Control, Simulation, equilibrium, load_scene, rollouts
from taichisoft.errors import ControlError, SceneError, SimulationDiverged
from taichisoft.mechanics.cavity_air import PRESSURE_TIMES_VOLUME, Orifice, air_mass, tube, tube_volume
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_from_dict

ATMOSPHERE = 101.325
SUPPLY: dict[str, Any] = {
    "sources": {"pump": {"highest_pressure": 40.0, "response_time": 0.02}},
    "tanks": {"manifold": {"volume": 2000.0}},
    "valves": {
        "supply": {"inlet": "pump", "outlet": "manifold", "exhaust": "atmosphere", "conductance": 0.05},
        **{f"to{i}": {"inlet": "manifold", "outlet": f"tube{i}", "conductance": 0.03} for i in range(3)},
    },
    "tubes": {f"tube{i}": {"outlet": f"finger{i}.cavity", "length": 300.0, "diameter": 2.0} for i in range(3)},
}
"""A regulator fills a manifold, from which a valve and a tube lead to each of three cavities."""
OPEN = {"supply": 1.0, "to0": 1.0, "to1": 1.0, "to2": 1.0}

Make = Callable[..., Simulation]


@pytest.fixture
def fingers(block: Callable[..., str]) -> Make:
    """Makes hollow blocks beside each other, whose cavities of 444 mm^3 each are joined by a network."""
    mesh = block((3, 3, 3), (30.0, 20.0, 20.0), hollow=True)

    def make(network: dict[str, Any], moduli: Sequence[float], step: float = 0.01, **cavity: Any) -> Simulation:
        bodies = {
            f"finger{number}": silicone(
                mesh,
                young_modulus=modulus,
                rayleigh_mass=10.0,
                element="linear",
                translation=[0.0, 40.0 * number, 0.0],
                cavities={"cavity": {"group": "cavity", **({"air": "network"} | cavity)}},
                anchors=[{"box": [[-15, -10, -10], [-15, 10, 10]]}],
            )
            for number, modulus in enumerate(moduli)
        }
        return simulate(step=step, soft_bodies=bodies, air=network)

    return make


def all_air(simulation: Simulation) -> float:
    """Air in cavities, tanks and tubes [kg]."""
    return float(simulation.state.air_mass.sum() + simulation.state.network_air_mass.sum())


@pytest.mark.parametrize("step", [0.01, 0.05])
def test_no_air_is_lost_in_a_network(fingers: Make, figures: Figures, step: float) -> None:
    """What cavities, tanks and tubes hold is what they began with and what the supply let through, to 1e-12."""
    simulation = fingers(SUPPLY, (60.0, 60.0, 80.0), step)
    first, through, most = all_air(simulation), 0.0, 0.0
    for number in range(60):
        opening = [1.0, 0.3, -1.0, 0.0, -0.2, 1.0][number // 10]
        valves = {"supply": opening, "to0": 1.0, "to1": 0.5 * (number % 2), "to2": 0.0 if number < 30 else 1.0}
        report = simulation.step(Control(pressure={"pump": 20.0}, valve=valves))
        assert report.converged
        through += step * report.observation.network_flows["supply"]
        most = max(most, all_air(simulation))
    assert most > 1.15 * first
    figures.at_most("air lost over all air", abs(all_air(simulation) - first - through) / first, 1e-12)


def test_fingers_share_a_supply_but_the_blocked_one(fingers: Make, figures: Figures) -> None:
    """At rest all have the pressure of the regulator, whatever their stiffness, but the one whose valve is shut.

    Air in each is p V / (R T), and what valves shut in stays to the last bit.
    """
    simulation, before = fingers(SUPPLY, (60.0, 120.0, 60.0)), {}
    for _ in range(150):
        before = simulation.observe().air_masses
        report = simulation.step(Control(pressure={"pump": 20.0}, valve={**OPEN, "to2": 0.0}))
        assert report.converged and report.observation.air_masses["finger2.cavity"] == pytest.approx(
            before["finger2.cavity"], rel=1e-15
        )
    seen = report.observation
    supplied = [seen.pressures["finger0.cavity"], seen.pressures["finger1.cavity"]]
    supplied += [seen.network_pressures["manifold"], seen.network_pressures["tube1"]]
    figures.at_most("pressures off the regulator's [kPa]", np.ptp([20.0, *supplied]), 1e-6)
    figures.at_most("pressure of what is blocked [kPa]", abs(seen.pressures["finger2.cavity"]), 1e-6)
    assert seen.volumes["finger0.cavity"] > seen.volumes["finger1.cavity"] > seen.volumes["finger2.cavity"]
    for name, mass in seen.air_masses.items():
        expected = (seen.pressures[name] + ATMOSPHERE) * seen.volumes[name] / PRESSURE_TIMES_VOLUME
        figures.close(f"air in {name} over p V / (R T)", mass / expected, 1.0, 1e-9)
    assert seen.network_openings == {**OPEN, "to2": 0.0}


def test_one_pump_fills_fewer_fingers_faster(fingers: Make) -> None:
    """The supply's valve limits the flow: with one of three fingers blocked, the others get more."""
    after = []
    for blocked in (0.0, 1.0):
        simulation = fingers(SUPPLY, (60.0, 60.0, 60.0))
        for _ in range(5):
            report = simulation.step(Control(pressure={"pump": 40.0}, valve={**OPEN, "supply": 0.1, "to2": blocked}))
        after.append(report.observation.pressures["finger0.cavity"])
    assert after[0] > 1.1 * after[1] > 0.0


def test_a_tank_drains_into_chambers_as_boyle_says(fingers: Make, figures: Figures) -> None:
    """A tank of finite volume and two chambers that a tube joins: in the end one pressure, p (V_1 + V_2 + ...) = m R T.

    Nothing drives them: the tank's 200 kPa and the 10 kPa in the chambers at the start become equal.
    """
    air = {
        "tanks": {"tank": {"volume": 300.0, "pressure": 200.0}},
        "orifices": {"throttle": {"inlet": "tank", "outlet": "finger0.cavity", "conductance": 0.01}},
        "tubes": {"joint": {"inlet": "finger0.cavity", "outlet": "finger1.cavity", "length": 100.0, "diameter": 3.0}},
    }
    simulation = fingers(air, (300.0, 600.0), shut_pressure=10.0)
    first = all_air(simulation)
    assert air_mass(np.array(200.0 + ATMOSPHERE), np.array(300.0)) == pytest.approx(
        simulation.state.network_air_mass[0]
    )
    for _ in range(300):
        assert simulation.step().converged
    seen = simulation.observe()
    pressures = [*seen.pressures.values(), seen.network_pressures["tank"]]
    figures.at_most("difference of the pressures [kPa]", np.ptp(pressures), 1e-6)
    space = sum(seen.volumes.values()) + 300.0 + tube_volume(100.0, 3.0)
    work = (pressures[0] + ATMOSPHERE) * space
    figures.close("p V / (m R T)", work / (first * PRESSURE_TIMES_VOLUME), 1.0, 1e-9)
    figures.at_most("air lost over all air", abs(all_air(simulation) / first - 1.0), 1e-12)
    assert 15.0 < pressures[0] < 120.0


def test_rigid_volumes_follow_the_differential_equation(fingers: Make, figures: Figures) -> None:
    """Source, throttle, tank, tube, tank: p_i' = R T / V_i sum of flows, by scipy's solve_ivp, within 1e-6.

    The steps are those of implicit Euler, whose error is a series in h: steps of h, h/2, h/4, h/8 leave the rest of the
    series behind h^3 (Richardson 1911). The cavity is beside them, and has 1e-5 of their air.
    """
    end, first_tank, last_tank, source = 0.1, 5e4, 2e4, 300.0
    pipe = tube(500.0, 1.0)
    air = {
        "sources": {"bottle": {"pressure": source}},
        "tanks": {"first": {"volume": first_tank}, "last": {"volume": last_tank, "pressure": -50.0}},
        "orifices": {
            "throttle": {"inlet": "bottle", "outlet": "first", "conductance": 0.05, "critical_ratio": 0.2},
            "side": {"inlet": "last", "outlet": "finger0.cavity", "conductance": 1e-7},
        },
        "tubes": {"pipe": {"inlet": "first", "outlet": "last", "length": 500.0, "diameter": 1.0}},
    }

    def flow(conductance: float, b: float, high: float, low: float) -> float:
        """ISO 6358 [kg/s]: C rho_0 p_1 sqrt(1 - ((p_2 / p_1 - b) / (1 - b))^2)."""
        share = max(low / high - b, 0.0) / (1.0 - b)
        return conductance * 1.185e-3 / 100.0 * high * math.sqrt(1.0 - share**2)

    def rates(_: float, pressure: np.ndarray) -> list[float]:
        fills = flow(0.05, 0.2, source + ATMOSPHERE, pressure[0])
        on = flow(pipe.conductance, pipe.critical_ratio, pressure[0], pressure[1])
        in_first = first_tank + tube_volume(500.0, 1.0)
        return [PRESSURE_TIMES_VOLUME * (fills - on) / in_first, PRESSURE_TIMES_VOLUME * on / last_tank]

    start = [ATMOSPHERE, ATMOSPHERE - 50.0]
    expected = solve_ivp(rates, (0.0, end), start, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]
    found = []
    for halvings in range(4):
        simulation = fingers(air, (1e6,), step=end / (25 * 2**halvings))
        for _ in range(25 * 2**halvings):
            simulation.step()
        found.append(
            np.array([simulation.observe().network_pressures[name] for name in ("first", "last")]) + ATMOSPHERE
        )
    ratio = (found[3] - expected) / (found[2] - expected)
    figures.at_most("error of h/8 over that of h/4, from 1/2", np.abs(ratio - 0.5).max(), 0.02)
    for order in (1, 2, 3):
        found = [(2**order * fine - coarse) / (2**order - 1) for coarse, fine in pairwise(found)]
    figures.at_most("pressures, relative to those of solve_ivp", np.abs(found[0] / expected - 1.0).max(), 1e-6)


def test_a_wide_part_joins_a_tank_and_a_cavity_to_one_space(fingers: Make, figures: Figures) -> None:
    """A tank behind a hole of any size fills as dead volume of the cavity does, and every step converges."""
    valve = {"valves": {"valve": {"inlet": "pump", "outlet": "finger0.cavity", "conductance": 0.05, "opening": 1.0}}}
    wide = {"tanks": {"tank": {"volume": 500.0}}, "orifices": {"hole": {"inlet": "tank", "outlet": "finger0.cavity"}}}
    pump = {"sources": {"pump": {}}}
    largest = 0.0
    for conductance in (300.0, 1e5):
        wide["orifices"]["hole"]["conductance"] = conductance
        both = fingers(pump | valve | wide, (120.0,)), fingers(pump | valve, (120.0,), dead_volume=500.0)
        for number in range(40):
            reports = [one.step(Control(pressure={"pump": 20.0 + 10.0 * (number % 4)})) for one in both]
            assert all(report.converged for report in reports)
            pressures = [report.observation.pressures["finger0.cavity"] for report in reports]
            largest = max(largest, abs(pressures[0] - pressures[1]))
    assert pressures[0] > 20.0
    figures.at_most("difference of the pressures [kPa]", largest, 1e-3)


def test_much_flow_elsewhere_hides_no_small_one(fingers: Make, figures: Figures) -> None:
    """A thimble is drained as fast beside bottles that a wide hole joins as alone: their round-off is above it."""
    thimble: dict[str, Any] = {
        "sources": {"pump": {"pressure": -95.0}},
        "tanks": {"thimble": {"volume": 5.0, "pressure": -24.0}},
        "orifices": {
            "drain": {"inlet": "thimble", "outlet": "pump", "conductance": 0.0026, "critical_ratio": 0.35},
            "side": {"inlet": "finger0.cavity", "outlet": "pump", "conductance": 0.0003},
        },
    }
    hole = {"inlet": "large", "outlet": "small", "conductance": 3000.0, "critical_ratio": 0.02}
    bottles = {
        "sources": thimble["sources"],
        "tanks": {
            "large": {"volume": 7e5, "pressure": 400.0},
            "small": {"volume": 1e5, "pressure": 60.0},
            **thimble["tanks"],
        },
        "orifices": {**thimble["orifices"], "hole": hole},
    }
    both = fingers(bottles, (1e5,)), fingers(thimble, (1e5,))
    for _ in range(5):
        reports = [one.step() for one in both]
        assert all(report.converged for report in reports)
        left = [report.observation.network_pressures["thimble"] + ATMOSPHERE for report in reports]
        figures.at_most("difference of the thimble's pressures, relative", abs(left[0] / left[1] - 1.0), 1e-9)


def test_air_without_a_pressure_ends_the_run(fingers: Make) -> None:
    """Pressures so high that no number is left of the others are not carried on as such."""
    with pytest.raises(SimulationDiverged, match=r"air without a pressure.*1e\+20 kPa: soft robots have"):
        fingers(SUPPLY | {"sources": {"pump": {}}}, (60.0,) * 3).step(Control(pressure={"pump": 1e20}, valve=OPEN))


def test_a_line_is_a_network_of_one_cavity(fingers: Make, figures: Figures) -> None:
    """Source, valve and tube of a cavity's `line` and the same in the table `air` give the same pressures."""
    air = {
        "sources": {"bottle": {"pressure": 60.0}},
        "valves": {
            "valve": {"inlet": "bottle", "outlet": "tube", "exhaust": "atmosphere", "conductance": 0.01, "delay": 0.02}
        },
        "tubes": {"tube": {"outlet": "finger0.cavity", "length": 300.0, "diameter": 1.5}},
    }
    line = {"supply": 60.0, "conductance": 0.01, "delay": 0.02, "tube_length": 300.0, "tube_diameter": 1.5}
    network, single = fingers(air, (60.0,)), fingers({}, (60.0,), air="line", line=line)
    largest = 0.0
    for number in range(40):
        opening = [0.6, 0.0, -0.4, 1.0][number // 10]
        pressures = [
            simulation.step(Control(valve={name: opening})).observation.pressures["finger0.cavity"]
            for simulation, name in ((network, "valve"), (single, "finger0.cavity"))
        ]
        largest = max(largest, abs(pressures[0] - pressures[1]))
    assert pressures[0] > 5.0
    figures.at_most("difference of the pressures [kPa]", largest, 1e-9)


def test_derivatives_of_a_network(fingers: Make, figures: Figures) -> None:
    """By the openings of valves, open and nearly shut, and by the pressure of a regulator."""
    simulation = fingers(SUPPLY, (60.0, 60.0, 80.0))
    control = Control(pressure={"pump": 20.0}, valve={"supply": 0.7, "to0": 0.95, "to1": 0.4})
    for _ in range(6):
        simulation.step(control)
    asked = replace(control, pressure={"pump": 22.0})
    seen = ("pressures", "network_pressures", "tip_positions")
    error = largest_error(simulation, asked, ("pressure.pump", "valve.supply", "valve.to0", "valve.to1"), seen)
    figures.at_most("derivatives of valves and regulator", error, 1e-5)
    by = simulation.linearise(asked, ["valve.to2", "pressure.pump"])
    assert by["pressures.finger2.cavity"][0] > 0.0 and by["network_pressures.pump"][1] == pytest.approx(
        -math.expm1(-0.01 / 0.02)
    )


def test_futures_and_equilibria_of_a_network(fingers: Make) -> None:
    """Rollouts are what steps by hand are, to the bit; an equilibrium has the air of a step that lasts."""
    simulation = fingers(SUPPLY, (60.0, 60.0, 80.0))
    for _ in range(4):
        simulation.step(Control(pressure={"pump": 20.0}, valve=OPEN))
    start, future = simulation.state, [Control(valve={"to0": 0.1 * number}) for number in range(4)]
    found = rollouts(simulation, [future, future], 2, ("network_pressures", "network_flows.to0"))
    for number, control in enumerate(future):
        seen = simulation.step(control).observation
        assert found["network_pressures"][1, number].tolist() == [*seen.network_pressures.values()]
        assert found["network_flows.to0"][0, number] == seen.network_flows["to0"]
    assert found.states == (simulation.state,) * 2
    simulation.restore(start)
    rest = equilibrium(simulation).state
    assert np.isfinite(rest.actuator_effort).all() and (rest.network_air_mass > 0.0).all()


def test_reduced_bodies_in_a_network(tmp_path: Any, figures: Figures) -> None:
    """With all modes a reduced chamber fills as the full one."""
    air = {
        "sources": {"pump": {}},
        "tubes": {"tube": {"inlet": "pump", "outlet": "chamber.air", "length": 400.0, "diameter": 1.0}},
    }
    body = chamber(tmp_path) | {"cavities": {"air": {"group": "cavity", "air": "network"}}}
    full = simulate(soft_bodies={"chamber": body}, air=air)
    modes = write_modes(tmp_path / "modes.npz", full)
    reduced = simulate(soft_bodies={"chamber": body | {"reduced": modes}}, air=air)
    for _ in range(20):
        both = [one.step(Control(pressure={"pump": 30.0})).observation for one in (full, reduced)]
    assert both[0].pressures["chamber.air"] > 3.0
    figures.close("pressure [kPa]", both[1].pressures["chamber.air"], both[0].pressures["chamber.air"], 1e-6)


def test_sensors_measure_a_network(fingers: Make) -> None:
    """A pressure gauge on tanks, tubes and sources with bias, and a flow meter; `truth` has the exact values."""
    simulation = fingers(SUPPLY, (60.0, 60.0, 80.0))
    scene = simulation.model.scene.model_dump() | {
        "sensors": {"network_pressure": {"bias": 0.5}, "network_flow": {"resolution": 1e-6}}
    }
    simulation = Simulation(scene_from_dict(scene))
    for _ in range(5):
        seen = simulation.step(Control(pressure={"pump": 20.0}, valve=OPEN)).observation
    off = [value - seen.truth.network_pressures[name] for name, value in seen.network_pressures.items()]
    assert len(set(off)) == len(off) == 5 and 0.0 < np.abs(off).max() <= 0.5
    assert seen.network_flows["supply"] != seen.truth.network_flows["supply"]
    assert seen.network_flows["supply"] == pytest.approx(seen.truth.network_flows["supply"], abs=0.5e-6)


def test_fingers_on_one_supply_hold_an_object(figures: Figures) -> None:
    """Two pads close on a cube, one is then shut off, and both lift it: all converges, and no air is lost."""
    network = (
        *(f'soft_bodies.{pad}.cavities.cavity={{group = "cavity", air = "network"}}' for pad in ("left", "right")),
        "air.sources.pump={}",
        "air.tanks.manifold={volume = 500.0}",
        'air.valves.supply={inlet = "pump", outlet = "manifold", conductance = 0.05, opening = 1.0}',
        'air.valves.right={inlet = "manifold", outlet = "right.cavity", conductance = 0.05, opening = 1.0}',
        'air.tubes.left={inlet = "manifold", outlet = "left.cavity", length = 200.0, diameter = 2.0}',
    )
    simulation, through = Simulation(load_scene(TINY_GRIPPER, network)), 0.0
    first = all_air(simulation)
    for number in range(50):
        up = np.array([0.0, 0.0, 0.2 * max(0, number - 30)])
        control = Control(pressure={"pump": 12.0}, valve={"right": float(number < 25)}, base_translation=up)
        report = simulation.step(control)
        assert report.converged
        through += 0.01 * report.observation.network_flows["supply"]
    seen = report.observation
    assert seen.object_positions["cube"][2] > 3.0 and seen.normal_forces["left", "cube"] > 100.0
    assert seen.pressures["left.cavity"] > seen.pressures["right.cavity"] > 9.0
    figures.at_most("air lost over all air", abs(all_air(simulation) - first - through) / first, 1e-12)


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (
            Control(valve={"to9": 1.0}),
            "control.valve: no cavity or part of \\[air\\] is called 'to9'; did you mean 'to2'",
        ),
        (Control(valve={"to0": 1.5}), "control.valve\\['to0'\\] = 1.5: must be from -1"),
        (Control(valve={"to0": math.nan}), "control.valve\\['to0'\\] = nan: must be one finite number"),
        (Control(valve={"pump": 1.0}), "control.valve: no cavity or part of \\[air\\] is called 'pump'"),
        (Control(pressure={"pump": np.ones(2)}), "control.pressure\\['pump'\\] = .*must be one finite number"),
        (Control(pressure={"finger0.cavity": 1.0}), 'cannot be asked for, its air is "network"'),
    ],
)
def test_what_cannot_be_asked_of_a_network(fingers: Make, control: Control, message: str) -> None:
    with pytest.raises(ControlError, match=message):
        fingers(SUPPLY, (60.0, 60.0, 80.0)).step(control)


def test_limits_hold_requests_back(fingers: Make) -> None:
    """A regulator's own range, and a valve without exhaust, which stays shut; both are among what is clipped."""
    simulation = fingers(SUPPLY, (60.0, 60.0, 80.0))
    seen = simulation.step(Control(pressure={"pump": 90.0}, valve={"to0": -0.5})).observation
    assert set(seen.clipped) == {"pump", "to0"} and seen.network_openings["to0"] == 0.0
    assert seen.network_pressures["pump"] == pytest.approx(-40.0 * math.expm1(-0.01 / 0.02))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tanks": {"pump": {"volume": 1.0}}}, "air.tanks.pump: air.sources.pump has this name already"),
        ({"tanks": {"alone": {"volume": 1.0}}}, "air.tanks.alone: no tube, orifice or valve of \\[air\\] leads there"),
        ({"tanks": {"t": {"volume": -1.0}}}, "air.tanks.t.volume"),
        ({"tanks": {"t": {"volume": 1.0, "pressure": -200.0}}}, "air.tanks.t.pressure"),
        (
            {"tubes": {"t": {"inlet": "pump", "outlet": "finger9.cavity", "length": 1.0, "diameter": 1.0}}},
            "finger9.cav",
        ),
        (
            {"orifices": {"o": {"inlet": "pump", "outlet": "atmosphere", "conductance": 1.0}}},
            "pressures are both given",
        ),
        (
            {"orifices": {"o": {"inlet": "tube0", "outlet": "manifold", "conductance": 1.0}}},
            "let the tube end in a tank",
        ),
        ({"orifices": {"o": {"inlet": "pump", "outlet": "pump", "conductance": 1.0}}}, "to itself"),
        ({"sources": {"s": {"pressure": 5.0, "delay": 1.0}}}, "delay would have no effect beside pressure"),
        (
            {"orifices": {"o": {"inlet": "pump", "outlet": "manifold", "conductance": 1.0, "critical_ratio": 0.9995}}},
            "critical_ratio = 0.9995: input should be less than or equal to 0.999",
        ),
        (
            {"orifices": {"o": {"inlet": "pump", "outlet": "manifold", "conductance": 1e9}}},
            "conductance = 1000000000.0: input should be less than or equal to 1000000",
        ),
        (
            {"valves": {"v": {"inlet": "pump", "outlet": "manifold", "conductance": 1.0, "opening": -0.1}}},
            "opening < 0 needs the key exhaust",
        ),
    ],
)
def test_what_is_no_network(fingers: Make, changes: dict[str, Any], message: str) -> None:
    air = {kind: {**SUPPLY.get(kind, {}), **changes.get(kind, {})} for kind in {*SUPPLY, *changes}}
    with pytest.raises(SceneError, match=message):
        fingers(air, (60.0, 60.0, 80.0))


def test_a_network_needs_its_cavities(fingers: Make) -> None:
    with pytest.raises(SceneError, match=r"air\.sources.pump joins no cavity"):
        fingers({"sources": {"pump": {}}}, (60.0,), air="regulated")
    with pytest.raises(SceneError, match=r"soft_bodies\.finger0.cavities.cavity.air = .network.: no tube"):
        fingers({}, (60.0,))


REGULATORS = {
    "ITV1030": {"conductance": 0.3, "response_time": 0.0},
    "VPPE": {"conductance": 0.3, "response_time": 0.03},
}
TUBES = {"2 mm by 500 mm": (2.0, 500.0), "2 mm by 2 m": (2.0, 2000.0), "4 mm by 1 m": (4.0, 1000.0)}
"""Of docs/air.md: both regulators with the conductance of the first, VPPE with the middle of its response times."""


@pytest.mark.parametrize("regulator", REGULATORS)
@pytest.mark.parametrize("pipe", TUBES)
def test_real_parts_fill_a_volume_as_fast_as_scipy_says(
    fingers: Make, figures: Figures, regulator: str, pipe: str
) -> None:
    """A step of a regulator to 40 kPa fills 10 000 mm^3 through a tube: time to 36 kPa, in steps of 1 ms, within 2 ms.

    The equations are p_s = 40 kPa (1 - exp(-t / tau)), V_t p_t' = R T (q_v - q_t) of the tube and V p' = R T q_t, with
    flows by ISO 6358 as `test_filling_is_that_of_iso_6358` shows them.
    """
    (diameter, length), valve = TUBES[pipe], REGULATORS[regulator]
    inlet, outlet = Orifice(valve["conductance"], 0.3), tube(length, diameter)

    def rates(time: float, pressure: np.ndarray) -> list[float]:
        rise = -math.expm1(-time / valve["response_time"]) if valve["response_time"] else 1.0
        into = inlet.flow(ATMOSPHERE + 40.0 * rise, pressure[0])[0]
        through = outlet.flow(pressure[0], pressure[1])[0]
        spaces = tube_volume(length, diameter), 1e4
        return [
            PRESSURE_TIMES_VOLUME * flow / space for flow, space in zip((into - through, through), spaces, strict=True)
        ]

    def is_full(_: float, pressure: np.ndarray) -> float:
        return float(pressure[1]) - ATMOSPHERE - 36.0

    is_full.terminal = True  # type: ignore[attr-defined]
    solved = solve_ivp(rates, (0.0, 2.0), [ATMOSPHERE] * 2, method="LSODA", rtol=1e-8, atol=1e-6, events=is_full)
    air = {
        "sources": {"pump": {"response_time": valve["response_time"]}},
        "tanks": {"volume": {"volume": 1e4}},
        "valves": {"valve": {"inlet": "pump", "outlet": "tube", "conductance": valve["conductance"], "opening": 1.0}},
        "tubes": {"tube": {"outlet": "volume", "length": length, "diameter": diameter}},
        "orifices": {"side": {"inlet": "volume", "outlet": "finger0.cavity", "conductance": 1e-7}},
    }
    simulation = fingers(air, (1e6,), step=1e-3)
    while simulation.observe().network_pressures["volume"] < 36.0:
        simulation.step(Control(pressure={"pump": 40.0}))
    figures.close(f"time to 90 % [s], {regulator}, {pipe}", simulation.state.time, float(solved.t[-1]), 2e-3)


def test_documented_network_inflates_a_finger_and_blocks_another(fingers: Make) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "air.md").read_text(encoding="utf-8")
    tables = tomllib.loads(page.partition("## Networks")[2].partition("```toml")[2].partition("```")[0])
    air, names = tables["air"], {f"finger{number}.cavity": f"finger{number - 1}.cavity" for number in (1, 2)}
    for tube_table in air["tubes"].values():
        tube_table["outlet"] = names[tube_table["outlet"]]
    simulation = fingers(air, (60.0, 60.0), **tables["soft_bodies"]["finger1"]["cavities"]["cavity"])
    for _ in range(60):
        seen = simulation.step(Control(pressure={"pump": 20.0}, valve={"first": 1.0, "second": 0.0})).observation
    assert seen.pressures["finger0.cavity"] == pytest.approx(20.0, rel=0.01)
    assert abs(seen.pressures["finger1.cavity"]) < 1e-6
