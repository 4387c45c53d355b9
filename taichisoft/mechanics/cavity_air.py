"""Air of a cavity: closed volumes, tubes, orifices and valves, in a step of implicit Euler."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from taichisoft.mechanics.state import State
from taichisoft.scene.actuators import AirLine

# Flow of air through valves and tubes (ISO 6358-1:2013, ISO 6358-3:2014).

# Density of air in the standard reference atmosphere of ISO 8778: 20 degrees C, 100 kPa, 65 % humidity [kg/dm^3].
REFERENCE_DENSITY = 1.185e-3
KPA_PER_BAR = 100.0
# From this ratio of pressures on flow is laminar, proportional to their difference: the ellipse of ISO 6358 would
# change infinitely fast with the pressures where they are equal.
LAMINAR = 0.999


@dataclass(frozen=True)
class Orifice:
    """A restriction.

    Attributes:
        conductance: sonic conductance C [dm^3/(s bar)].
        critical_ratio: ratio b of absolute pressures up to which the flow is sonic [-].
    """

    conductance: float
    critical_ratio: float

    def flow(self, first: float, second: float) -> tuple[float, float, float]:
        """Flow of air at 20 degrees C from an absolute pressure to another one [kPa], negative in the other direction.

        Returns:
            Mass flow [kg/s], and its derivatives by the first pressure and by the second [kg/(s kPa)].
        """
        if first < second:
            flow, by_second, by_first = self.flow(second, first)
            return -flow, -by_first, -by_second
        b, sonic = self.critical_ratio, self.conductance * REFERENCE_DENSITY / KPA_PER_BAR
        ratio = second / first
        if ratio <= b:
            return sonic * first, sonic, 0.0
        if ratio <= LAMINAR:
            share = (ratio - b) / (1.0 - b)
            part = math.sqrt(1.0 - share * share)
            by_ratio = -share / ((1.0 - b) * part)
            return sonic * first * part, sonic * (part - ratio * by_ratio), sonic * by_ratio
        slope = sonic * math.sqrt(1.0 - ((LAMINAR - b) / (1.0 - b)) ** 2) / (1.0 - LAMINAR)
        return slope * (first - second), slope, -slope


def tube(length: float, diameter: float) -> Orifice:
    """A straight tube of a length and an inner diameter [mm] as a restriction.

    C = 0.029 D^2 / sqrt(L / D^1.25 + 510) [m^3/(s Pa)] and b = 474 C / D^2, with L and D in m (Eckersten 1975, in
    Beater 2007, Pneumatic Drives); within 22 % of adiabatic flow with wall friction.
    """
    wide, long = 1e-3 * diameter, 1e-3 * length
    conductance = 0.029 * wide**2 / math.sqrt(long / wide**1.25 + 510.0)
    return Orifice(1e8 * conductance, 474.0 * conductance / wide**2)


def tube_volume(length: float, diameter: float) -> float:
    """Space in a tube [mm^3]."""
    return 0.25 * math.pi * diameter**2 * length


# Sealed air: its pressure follows the volume of the cavity.

# Air as an ideal gas at 20 degrees C: gas constant of dry air, 287.05 J/(kg K), times temperature [mN mm/kg].
GAS_CONSTANT, TEMPERATURE = 287.05e6, 293.15
PRESSURE_TIMES_VOLUME = GAS_CONSTANT * TEMPERATURE


def air_mass(pressure: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Masses of air [kg] at absolute pressures [kPa] in volumes [mm^3] of the same shape, at room temperature."""
    return pressure * volume / PRESSURE_TIMES_VOLUME


@dataclass(frozen=True)
class CavityAir:
    """Air that gives a cavity of its own pressure its volume, a `CoordinateLaw`.

    Attributes:
        rest_volume: volume of the cavity at rest [mm^3].
        atmosphere: absolute pressure outside [kPa].
    """

    rest_volume: float
    atmosphere: float

    @property
    def lowest_effort(self) -> float:
        """Pressure over the atmosphere's at which there is a vacuum [kPa]."""
        return -self.atmosphere


@dataclass(frozen=True)
class SealedAir(CavityAir):
    """Air of constant mass, p V^n = const, with p its absolute pressure and V the space that it fills.

    n is 1 for slow changes at constant temperature (isothermal) and 1.4 for fast ones without heat flow (adiabatic).

    Attributes:
        mass: mass of the air [kg].
        exponent: n [-].
        warm_space: space in which the air has room temperature [mm^3].
        dead_volume: volume of tube and fittings, at the same pressure [mm^3].
    """

    mass: float
    exponent: float
    warm_space: float
    dead_volume: float

    @property
    def scale(self) -> float:
        """Space for the air at rest [mm^3]."""
        return self.rest_volume + self.dead_volume

    def growth(self, pressure: float) -> tuple[float, float]:
        """Growth of the cavity at which the air has a pressure over the atmosphere's [kPa], and its slope.

        Returns:
            Growth over the rest volume [mm^3], and its change with the pressure [mm^3/kPa], which is negative.
        """
        absolute = pressure + self.atmosphere
        at_room_temperature = self.mass * PRESSURE_TIMES_VOLUME / self.warm_space
        space = self.warm_space * (at_room_temperature / absolute) ** (1.0 / self.exponent)
        return space - self.scale, -space / (self.exponent * absolute)


# Valves and regulators of air lines: what has become of requests, after delay and response time.


class Valves:
    """The valves of all cavities with a line.

    Attributes:
        lines: settings by number of the cavity.
    """

    def __init__(self, lines: Mapping[int, AirLine], cavity_count: int, time_step: float):
        """Prepare for a time step [s]."""
        self.lines, self._count, self._time_step = lines, cavity_count, time_step
        self._delays = {number: round(line.delay / time_step) for number, line in lines.items()}

    def start(self) -> dict[str, np.ndarray]:
        """Fields of the first state: a regulator's valve is open, others are closed."""
        opening, supply = np.zeros(self._count), np.zeros(self._count)
        for number, line in self.lines.items():
            opening[number], supply[number] = (1.0, 0.0) if line.supply is None else (0.0, line.supply)
        return {
            "valve_request": opening,
            "valve_opening": opening.copy(),
            "supply_pressure": supply,
            "delayed_requests": np.zeros((self._count, max(self._delays.values(), default=0))),
        }

    def moved(self, state: State, pressure: np.ndarray, request: np.ndarray) -> dict[str, np.ndarray]:
        """Valves and regulators in the step that begins, by the pressures and openings requested."""
        if not self.lines:
            return {}
        opening, supply = state.valve_opening.copy(), state.supply_pressure.copy()
        waiting = state.delayed_requests.copy()
        for number, line in self.lines.items():
            target = float((pressure if line.has_regulator else request)[number])
            target = self._delayed(waiting[number], self._delays[number], target)
            # First order, exact for a request that stays as it is in the step.
            share = 1.0 if line.response_time == 0.0 else -math.expm1(-self._time_step / line.response_time)
            if line.has_regulator:
                supply[number] += share * (target - supply[number])
                opening[number] = request[number]
            elif line.period is not None:
                opening[number] = math.copysign(self._share_open(state.step, line.period, abs(target)), target)
            else:
                opening[number] += share * (target - opening[number])
        return {
            "valve_request": request,
            "valve_opening": opening,
            "supply_pressure": supply,
            "delayed_requests": waiting,
        }

    def _delayed(self, waiting: np.ndarray, delay: int, target: float) -> float:
        """The request of `delay` steps ago; later requests move up by one."""
        if not delay:
            return target
        oldest = float(waiting[0])
        waiting[: delay - 1], waiting[delay - 1] = waiting[1:delay].copy(), target
        return oldest

    def _share_open(self, step: int, period: float, duty: float) -> float:
        """Share of a step in which an on/off valve is open that opens at the start of each period."""

        def time_open(until: float) -> float:
            periods = math.floor(until / period)
            return periods * duty * period + min(until - periods * period, duty * period)

        start = step * self._time_step
        return min(max((time_open(start + self._time_step) - time_open(start)) / self._time_step, 0.0), 1.0)


# Air that flows into a cavity, or out of it, through a valve and a tube in a step of implicit Euler.

# Relative change of the pressure in the tube by another iteration of Newton's method; and most iterations.
ROUND_OFF, MOST_ITERATIONS = 1e-14, 100


class Tube(NamedTuple):
    """A tube between valve and cavity, whose air has one pressure.

    Attributes:
        orifice: its resistance, which is between its air and the cavity.
        volume: space in it [mm^3].
    """

    orifice: Orifice
    volume: float


@dataclass(frozen=True)
class LineAir(CavityAir):
    """Air of constant temperature in a cavity and in the tube before it, at the end of a step.

    Attributes:
        cavity_mass, tube_mass: air at the start of the step [kg].
        valve: the valve as open as it is in the step.
        source: absolute pressure to which it leads [kPa].
        tube: the tube; None where the valve is at the cavity.
        time_step: time step [s].
    """

    cavity_mass: float
    tube_mass: float
    valve: Orifice
    source: float
    tube: Tube | None
    time_step: float

    @property
    def scale(self) -> float:
        """Volume of the cavity at rest [mm^3]."""
        return self.rest_volume

    def growth(self, pressure: float) -> tuple[float, float]:
        """As of `SealedAir`, at the end of the step."""
        absolute = pressure + self.atmosphere
        _, into_cavity, slope = self._flows(absolute)
        space = (self.cavity_mass + self.time_step * into_cavity) * PRESSURE_TIMES_VOLUME / absolute
        return space - self.rest_volume, (self.time_step * slope * PRESSURE_TIMES_VOLUME - space) / absolute

    def flows(self, pressure: float) -> tuple[float, float]:
        """Mass flows through the valve, and into the cavity [kg/s], at a pressure over the atmosphere's [kPa]."""
        through_valve, into_cavity, _ = self._flows(pressure + self.atmosphere)
        return through_valve, into_cavity

    def _flows(self, pressure: float) -> tuple[float, float, float]:
        """Flows through the valve and into the cavity, and the slope of the latter by the cavity's pressure."""
        if self.tube is None:
            flow, _, slope = self.valve.flow(self.source, pressure)
            return flow, flow, slope
        resistance = self.tube.orifice
        capacity = self.tube.volume / PRESSURE_TIMES_VOLUME  # of the tube [kg/kPa]
        # What the tube has too much rises with its pressure: it is negative at the lowest pressure around, and positive
        # at the highest.
        as_it_was = self.tube_mass / capacity
        low, high = min(self.source, pressure, as_it_was), max(self.source, pressure, as_it_was)
        inside, last_move = as_it_was, high - low
        for _ in range(MOST_ITERATIONS):
            through_valve, _, valve_slope = self.valve.flow(self.source, inside)
            into_cavity, from_inside, by_cavity = resistance.flow(inside, pressure)
            too_much = capacity * inside - self.tube_mass - self.time_step * (through_valve - into_cavity)
            slope = capacity - self.time_step * (valve_slope - from_inside)
            low, high = (low, inside) if too_much > 0.0 else (inside, high)
            move = -too_much / slope
            # Where flow turns its direction, moves that do not shrink lead to and fro.
            if not low <= inside + move <= high or abs(move) > 0.5 * last_move:
                move = 0.5 * (low + high) - inside
            if abs(move) <= ROUND_OFF * high:
                break
            inside, last_move = inside + move, abs(move)
        inside_by_cavity = -self.time_step * by_cavity / slope
        return through_valve, into_cavity, by_cavity + from_inside * inside_by_cavity
