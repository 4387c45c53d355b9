"""Air that flows into a cavity, or out of it, through a valve and a tube in a step of implicit Euler."""

from dataclasses import dataclass
from typing import NamedTuple

from taichisoft.actuators.orifice import Orifice
from taichisoft.actuators.shut_air import PRESSURE_TIMES_VOLUME

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
class LineAir:
    """Air of constant temperature in a cavity and in the tube before it, at the end of a step.

    Attributes:
        cavity_mass, tube_mass: air at the start of the step [kg].
        valve: the valve as open as it is in the step.
        source: absolute pressure to which it leads [kPa].
        tube: the tube; None where the valve is at the cavity.
        rest_volume: volume of the cavity at rest [mm^3].
        atmosphere: absolute pressure outside [kPa].
        time_step: time step [s].
    """

    cavity_mass: float
    tube_mass: float
    valve: Orifice
    source: float
    tube: Tube | None
    rest_volume: float
    atmosphere: float
    time_step: float

    @property
    def lowest_effort(self) -> float:
        """Pressure over the atmosphere's at which there is a vacuum [kPa]."""
        return -self.atmosphere

    @property
    def scale(self) -> float:
        """Volume of the cavity at rest [mm^3]."""
        return self.rest_volume

    def growth(self, pressure: float) -> tuple[float, float]:
        """Growth of the cavity at which the air has a pressure over the atmosphere's [kPa] at the end of the step.

        Returns:
            Growth over the rest volume [mm^3], and its change with the pressure [mm^3/kPa], which is negative.
        """
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
