"""Air of cavities, sealed or joined by tubes and valves with tanks and sources, in a step of implicit Euler."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from taichisoft.mechanics.actuator_kind import limits
from taichisoft.mechanics.cavity_air import PRESSURE_TIMES_VOLUME, Orifice, Response, air_mass, tube, tube_volume
from taichisoft.mechanics.state import State
from taichisoft.scene.actuators import CavitySettings
from taichisoft.scene.air import ATMOSPHERE, AirNetworkSettings, AirTube

# The air in a step: contents of nodes and flows between them, which depend on the pressures at its end.

# Newton's method ends where a node's air is in excess by no more than this share of the terms that it is a sum of; most
# iterations; smallest share of a step that is tried; decrease, over a linear one, that accepts a share (Armijo 1966):
# much, since steps lead to and fro across equal pressures, where flow changes fast, and gain little.
ROUND_OFF, MOST_ITERATIONS, LEAST_SHARE, DECREASE = 4e-16, 200, 1e-9, 0.3
# Most of a pressure or a space that a step takes away.
MOST_TAKEN = 0.9
# Excess over those terms above which pressures are not a solution.
UNSOLVED = 1e-9


@dataclass(frozen=True)
class AirLaw:
    """The air of all cavities that have their own, a `CoordinateLaw` of their volumes and pressures.

    A node is a cavity, a rigid volume, or a given pressure, in this order. Its air is phi(p) V = m + h flow at the end
    of the step, with phi = p / (R T), of sealed air phi = p_w / (R T) (p / p_w)^(1 / n), and p_w the pressure at which
    it had room temperature.

    Attributes:
        numbers: numbers of the cavities among all, shape (cavity_count,).
        rest_volume: their volumes at rest [mm^3], shape (cavity_count,).
        dead_volume: space outside them at the same pressure [mm^3], shape (cavity_count,).
        exponent: n of cavities, 1 where air flows [-], shape (cavity_count,).
        warm_space: space in which the air of cavities has room temperature [mm^3], shape (cavity_count,).
        volume: of the rigid volumes [mm^3], shape (volume_count,).
        mass: air in cavities and rigid volumes at the start of the step [kg], (cavity_count + volume_count,).
        given: absolute pressures of sources [kPa], shape (source_count,).
        branches: what joins nodes, as far as it is open.
        atmosphere: absolute pressure outside [kPa].
        time_step: time step [s].
    """

    numbers: np.ndarray
    rest_volume: np.ndarray
    dead_volume: np.ndarray
    exponent: np.ndarray
    warm_space: np.ndarray
    volume: np.ndarray
    mass: np.ndarray
    given: np.ndarray
    branches: "tuple[Branch, ...]"
    atmosphere: float
    time_step: float

    @property
    def lowest_effort(self) -> float:
        """Pressure over the atmosphere's at which there is a vacuum [kPa]."""
        return -self.atmosphere

    @property
    def scale(self) -> np.ndarray:
        """Space for the air at rest [mm^3], shape (cavity_count,)."""
        return self.rest_volume + self.dead_volume

    def growth(self, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Growth of the cavities at which their air has pressures over the atmosphere's [kPa], (cavity_count,).

        Returns:
            Growth over the rest volumes [mm^3], and its changes with the pressures [mm^3/kPa], (cavity_count,) twice.
        """
        count = len(self.numbers)
        pressure = self._at(effort)
        inflow, slope = self._flows(pressure)
        density, by_pressure = self._density(pressure[:count])
        space = (self.mass[:count] + self.time_step * inflow[:count]) / density
        by_all = self.time_step * slope[:count] / density[:, None]
        # What the rigid volumes have too much stays 0: their pressures follow those of the cavities.
        own = slice(count, len(self.mass))
        excess = -self.time_step * slope[own]
        excess[:, own] += np.diag(self.volume / PRESSURE_TIMES_VOLUME)
        # What round-off of their pressures leaves in excess is the cavities': through wide parts it is much air.
        left = self.mass[own] + self.time_step * inflow[own] - self.volume * pressure[own] / PRESSURE_TIMES_VOLUME
        follow = np.linalg.solve(excess[:, own], np.column_stack([left, -excess[:, :count]]))
        change: np.ndarray = by_all[:, :count] + by_all[:, own] @ follow[:, 1:] - np.diag(space * by_pressure / density)
        return space + by_all[:, own] @ follow[:, 0] - self.scale, change

    def meeting(self, effort: np.ndarray, growth: np.ndarray, compliance: np.ndarray) -> np.ndarray:
        """The pressures [kPa] at which the air takes the space that bodies give it.

        Args:
            effort: pressures above the vacuum, at which the bodies give the cavities a growth, shape (cavity_count,).
            growth: it [mm^3], shape (cavity_count,).
            compliance: its change with the pressures [mm^3/kPa], (cavity_count,) twice.
        """
        count = len(self.numbers)
        start = self._pressures(effort)
        space, give = np.concatenate([self.scale + growth, self.volume]), np.zeros((len(self.mass),) * 2)
        give[:count, :count] = compliance
        for _ in range(60):  # a linear body may have shrunk to less than nothing: more pressure widens it
            if space.min() > 0.0:
                break
            more = np.where(space > 0.0, 0.0, start[: len(space)])
            start[: len(space)] += more
            space += give @ more
        met: np.ndarray = self._settled(start, space, give, 0)[:count] - self.atmosphere
        return met

    def after(self, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Air in cavities and rigid volumes at the end of the step [kg], and flows through the branches [kg/s]."""
        pressure = self._at(effort)
        flows, mass = np.zeros(len(self.branches)), self.mass.copy()
        for number, (first, second, orifice, *_) in enumerate(self.branches):
            flows[number] = orifice.flow(float(pressure[first]), float(pressure[second]))[0]
            for node, sign in ((first, -1.0), (second, 1.0)):
                if node < len(mass):
                    mass[node] += sign * self.time_step * flows[number]
        return mass, flows

    def _at(self, effort: np.ndarray) -> np.ndarray:
        """Pressures of all nodes with those of the cavities."""
        count = len(self.numbers)
        space = np.concatenate([self.scale, self.volume])
        return self._settled(self._pressures(effort), space, np.zeros((len(space),) * 2), count)

    def _pressures(self, effort: np.ndarray) -> np.ndarray:
        """Absolute pressures of all nodes, with rigid volumes as they were."""
        inside = self.mass[len(self.numbers) :] * PRESSURE_TIMES_VOLUME / self.volume
        return np.concatenate([effort + self.atmosphere, inside, self.given])

    def _density(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Air of cavities over its space [kg/mm^3], and its change with the pressure, each (cavity_count,)."""
        density = pressure / PRESSURE_TIMES_VOLUME
        warm = self.exponent > 1.0
        if warm.any():
            reference = self.mass[: len(pressure)][warm] / self.warm_space[warm]
            density[warm] = reference * (density[warm] / reference) ** (1.0 / self.exponent[warm])
        return density, density / (self.exponent * pressure)

    def _flows(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Flows of air into all nodes [kg/s], (node_count,), and their changes with the pressures."""
        inflow, slope = np.zeros(len(pressure)), np.zeros((len(pressure),) * 2)
        for first, second, orifice, *_ in self.branches:
            flow, by_first, by_second = orifice.flow(float(pressure[first]), float(pressure[second]))
            for node, sign in ((first, -1.0), (second, 1.0)):
                inflow[node] += sign * flow
                slope[node, first] += sign * by_first
                slope[node, second] += sign * by_second
        return inflow, slope

    def _excess(self, pressure: np.ndarray, space: np.ndarray, give: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Air that nodes have too much at pressures [kg], (cavity_count + volume_count,), and its changes with them."""
        count, nodes = len(self.numbers), len(self.mass)
        density, by_pressure = self._density(pressure[:count])
        rigid = pressure[count:nodes] / PRESSURE_TIMES_VOLUME
        inflow, slope = self._flows(pressure)
        all_density = np.concatenate([density, rigid])
        change = all_density[:, None] * give - self.time_step * slope[:nodes, :nodes]
        all_by_pressure = np.concatenate([by_pressure, np.full(nodes - count, 1.0 / PRESSURE_TIMES_VOLUME)])
        change[np.diag_indices(nodes)] += all_by_pressure * space
        return all_density * space - self.mass - self.time_step * inflow[:nodes], change

    def _settled(self, start: np.ndarray, space: np.ndarray, give: np.ndarray, first: int) -> np.ndarray:
        """Pressures at which no node from `first` on has too much air: Newton's method with a line search.

        Args:
            start: pressures to begin with, shape (node_count,).
            space: spaces of cavities and rigid volumes there.
            give: their changes with the pressures [mm^3/kPa].
            first: the first node whose pressure is sought.
        """
        free, nodes = slice(first, len(self.mass)), len(self.mass)
        if first == nodes:
            return start
        pressure, place = start, space
        excess, slope = self._excess(pressure, place, give)
        for _ in range(MOST_ITERATIONS):
            terms = np.abs(slope[free]) @ pressure[:nodes]
            before = _beyond(excess[free], terms)
            if before == 0.0:
                break
            step = np.zeros(nodes)
            step[free] = np.linalg.solve(slope[free, free], -excess[free])
            widening, share = give @ step, 1.0
            # Where a step leads to a vacuum or to no space, it goes a part of it.
            pv, dpv = place + np.diag(give) * pressure[:nodes], widening + np.diag(give) * step
            for value, change in ((pressure[free], step[free]), (pv, dpv)):
                falls = change < 0.0
                share = min(share, float((MOST_TAKEN * value[falls] / -change[falls]).min(initial=1.0)))
            while share > LEAST_SHARE:
                moved, wider = pressure.copy(), place + share * widening
                moved[:nodes] += share * step
                next_excess, next_slope = self._excess(moved, wider, give)
                next_terms = np.abs(next_slope[free]) @ moved[:nodes]
                if _beyond(next_excess[free], next_terms) <= (1.0 - DECREASE * share) * before:
                    break
                share *= 0.5
            else:
                break
            pressure, place, excess, slope = moved, wider, next_excess, next_slope
        if (np.abs(excess[free]) > UNSOLVED * terms).any():
            pressure[first] = np.nan
        return pressure


def _beyond(excess: np.ndarray, terms: np.ndarray) -> float:
    """Sum of what nodes have in excess beyond the round-off of its terms: that of a few would hide what others have."""
    return float(np.maximum(np.abs(excess) - ROUND_OFF * terms, 0.0).sum())


# The parts of all air supplies of a model.

Key = str | tuple[str, str]


class Branch(NamedTuple):
    """What joins two nodes.

    Attributes:
        first, second: numbers of the nodes; flow from the first to the second is positive.
        orifice: what is between, wholly open.
        valve: number of the opening by which it is open, among all that is driven; -1 where it always is.
        sign: sign of the openings that open it.
        part: number of the tube, orifice or valve; -1 of a line's.
    """

    first: int
    second: int
    orifice: Orifice
    valve: int
    sign: float
    part: int


class AirNetwork:
    """How all cavities with air of their own get it: the lines of single ones are the simplest networks.

    Attributes:
        own: numbers of these cavities, shape (cavity_count,).
        dead_volume: space outside each cavity at its pressure [mm^3], of all cavities.
        volume: rigid volumes, the lines' tubes before those of the table `air` [mm^3], shape (volume_count,).
        valves, regulators, drives: names in the table `air` of what requests drive; the valves come first among all.
        drive_range: smallest and largest opening or pressure of the drives, shape (drive_count, 2).
        start_drive: opening or pressure of the drives until one is requested, shape (drive_count,).
    """

    def __init__(
        self, cavities: Mapping[str, CavitySettings], air: AirNetworkSettings, atmosphere: float, time_step: float
    ):
        """Join the cavities of a scene by its table `air`, for an absolute pressure outside [kPa] and a step [s]."""
        self._atmosphere, self._time_step = atmosphere, time_step
        self._tables, names = list(cavities.values()), list(cavities)
        self.own = np.flatnonzero([table.air != "regulated" for table in self._tables])
        self._parts = list(air.parts)
        self._set_drives(air)
        pipes = {name: tube_volume(pipe.length, pipe.diameter) for name, pipe in air.tubes.items()}
        volumes = {name: air.tanks[name].volume if name in air.tanks else pipes[name] for name in air.volumes}
        self._start_pressure = np.array([air.tanks[name].pressure if name in air.tanks else 0.0 for name in volumes])
        self.dead_volume = np.array([table.dead_volume for table in self._tables])
        for name, pipe in air.tubes.items():
            if pipe.inlet in volumes:
                volumes[pipe.inlet] += pipes[name]
            elif pipe.inlet in names:
                self.dead_volume[names.index(pipe.inlet)] += pipes[name]
        lines = {name: table.line for name, table in cavities.items() if table.line is not None}
        line_tubes = {
            name: (line.tube_length, line.tube_diameter)
            for name, line in lines.items()
            if line.tube_length is not None and line.tube_diameter is not None
        }
        self._tubes = [names.index(name) for name in line_tubes]
        self.volume = np.array([*(tube_volume(*size) for size in line_tubes.values()), *volumes.values()])
        # What is a line's has the cavity's name and its own.
        inner: list[Key] = [*(names[number] for number in self.own), *((name, "tube") for name in line_tubes), *volumes]
        given: list[Key] = [*air.sources, ATMOSPHERE, *((name, end) for name in lines for end in ("source", "exhaust"))]
        nodes = {key: place for place, key in enumerate([*inner, *given])}
        constants: dict[Key, float] = {ATMOSPHERE: 0.0}
        constants |= {name: one.pressure for name, one in air.sources.items() if one.pressure is not None}
        constants |= {(name, "exhaust"): line.exhaust for name, line in lines.items()}
        # Openings and pressures stand in one array: those of lines by cavity, of drives, and constants.
        of_lines: list[Key] = [(name, kind) for kind in ("valve", "source") for name in names]
        driven = {key: place for place, key in enumerate([*of_lines, *self.drives, *constants])}
        self._constants, self._given = np.array([*constants.values()]), [driven[key] for key in given]
        self._branches = []
        for name, line in lines.items():
            valve, outlet, opening = Orifice(line.conductance, line.critical_ratio), nodes[name], driven[name, "valve"]
            if name in line_tubes:
                self._branches.append(Branch(nodes[name, "tube"], outlet, tube(*line_tubes[name]), -1, 0.0, -1))
                outlet = nodes[name, "tube"]
            for end, sign in (("source", 1.0), ("exhaust", -1.0)):
                self._branches.append(Branch(nodes[name, end], outlet, valve, opening, sign, -1))
        for name, part, inlet, end, sign in air.joins():
            if isinstance(part, AirTube):
                orifice = tube(part.length, part.diameter)
            else:
                orifice = Orifice(part.conductance, part.critical_ratio)
            opening = driven[name] if sign else -1
            self._branches.append(Branch(nodes[inlet], nodes[end], orifice, opening, sign, self._parts.index(name)))

    def _set_drives(self, air: AirNetworkSettings) -> None:
        """Ranges, starts and responses of valves and regulators."""
        self.valves, self.regulators, self.drives = tuple(air.valves), air.regulators, air.drives
        valves, regulators = list(air.valves.values()), [air.sources[name] for name in self.regulators]
        openings = [(0.0 if valve.exhaust is None else -1.0, 1.0) for valve in valves]
        pressures = [
            limits(one.lowest_pressure, one.highest_pressure, unless_given=-self._atmosphere) for one in regulators
        ]
        self.drive_range = np.array([*openings, *pressures]).reshape(-1, 2)
        starts = [*(valve.opening for valve in valves), *(min(max(0.0, low), high) for low, high in pressures)]
        self.start_drive = np.array(starts)
        start_of = dict(zip(self.drives, starts, strict=True))
        self._start_sources = [start_of.get(name, source.pressure) for name, source in air.sources.items()]
        self._responses = [
            *(Response.of(one.delay, one.response_time, one.period, self._time_step) for one in valves),
            *(Response.of(one.delay, one.response_time, None, self._time_step) for one in regulators),
        ]

    def start(self, in_cavities: np.ndarray) -> dict[str, np.ndarray]:
        """Fields of the first state, with pressures over the atmosphere's in the cavities [kPa]."""
        pressure = np.concatenate([in_cavities[self._tubes], self._start_pressure]) + self._atmosphere
        mass, line_count = air_mass(pressure, self.volume), len(self._tubes)
        in_tube = np.zeros(len(in_cavities))
        in_tube[self._tubes] = mass[:line_count]
        drive, longest = self.start_drive, max((one.delay for one in self._responses), default=0)
        return {
            "tube_air_mass": in_tube,
            "network_air_mass": mass[line_count:],
            "network_pressure": np.concatenate([self._start_pressure, self._start_sources]),
            "network_flow": np.zeros(len(self._parts)),
            **{f"network_{key}": drive.copy() for key in ("request", "target", "drive")},
            "network_delayed": np.tile(drive[:, None], longest),
        }

    def moved(self, state: State, request: np.ndarray, target: np.ndarray) -> dict[str, np.ndarray]:
        """Drives in the step that begins, by requests and by what limits leave of them, each (drive_count,)."""
        waiting, value = state.network_delayed.copy(), state.network_drive.copy()
        for number, response in enumerate(self._responses):
            value[number] = response.moved(float(value[number]), float(target[number]), waiting[number], state.step)
        return {
            "network_request": request,
            "network_target": target,
            "network_drive": value,
            "network_delayed": waiting,
        }

    def law(self, state: State, rest_value: np.ndarray) -> AirLaw:
        """The air in the step from a state; volumes of all cavities at rest [mm^3]."""
        driven = np.concatenate([state.valve_opening, state.supply_pressure, state.network_drive, self._constants])
        in_tube, own, tables = state.tube_air_mass, self.own, self._tables
        branches = []
        for branch in self._branches:
            share = 1.0 if branch.valve < 0 else branch.sign * float(driven[branch.valve])
            if share > 0.0:
                orifice = Orifice(share * branch.orifice.conductance, branch.orifice.critical_ratio)
                branches.append(branch._replace(orifice=orifice))
        return AirLaw(
            numbers=own,
            rest_volume=rest_value[own],
            dead_volume=self.dead_volume[own],
            exponent=np.array([tables[number].exponent for number in own]),
            warm_space=state.warm_air_space[own],
            volume=self.volume,
            mass=np.concatenate([(state.air_mass - in_tube)[own], in_tube[self._tubes], state.network_air_mass]),
            given=driven[self._given] + self._atmosphere,
            branches=tuple(branches),
            atmosphere=self._atmosphere,
            time_step=self._time_step,
        )

    def after(self, start: State, law: AirLaw, effort: np.ndarray, mass: np.ndarray) -> dict[str, np.ndarray]:
        """Fields of the state after a step, with pressures of all cavities [kPa]; `mass` gets the air of its own."""
        air, flows = law.after(effort[self.own])
        in_tube, count, line_count = start.tube_air_mass.copy(), len(self.own), len(self._tubes)
        in_tube[self._tubes] = air[count : count + line_count]
        mass[self.own] = air[:count] + in_tube[self.own]
        rigid, volume = air[count + line_count :], self.volume[line_count:]
        sources = law.given[: len(self._start_sources)]
        pressure = np.concatenate([rigid * PRESSURE_TIMES_VOLUME / volume, sources]) - self._atmosphere
        through = np.zeros(len(self._parts))
        for branch, flow in zip(law.branches, flows.tolist(), strict=True):
            if branch.part >= 0:
                through[branch.part] += flow
        return {
            "tube_air_mass": in_tube,
            "network_air_mass": rigid,
            "network_pressure": pressure,
            "network_flow": through,
        }
