"""Parts of air supplies: orifices and tubes by ISO 6358, valves and regulators with delay and response."""

import math
from dataclasses import dataclass

import numpy as np

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


# Air as an ideal gas at 20 degrees C: gas constant of dry air, 287.05 J/(kg K), times temperature [mN mm/kg].
GAS_CONSTANT, TEMPERATURE = 287.05e6, 293.15
PRESSURE_TIMES_VOLUME = GAS_CONSTANT * TEMPERATURE


def air_mass(pressure: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Masses of air [kg] at absolute pressures [kPa] in volumes [mm^3] of the same shape, at room temperature."""
    return pressure * volume / PRESSURE_TIMES_VOLUME


# Valves and regulators: what has become of requests, after delay and response time.


@dataclass(frozen=True)
class Response:
    """How a valve or a regulator answers requests.

    Attributes:
        delay: steps from a request to its first effect.
        share: part of the distance to the request that is covered in a step, exact for requests that do not change [-].
        period: time from one opening of an on/off valve to the next [s]; None for others.
        time_step: time step [s].
    """

    delay: int
    share: float
    period: float | None
    time_step: float

    @classmethod
    def of(cls, delay: float, response_time: float, period: float | None, time_step: float) -> "Response":
        """The response with a delay, a time constant of first order, and a period [s]."""
        share = 1.0 if response_time == 0.0 else -math.expm1(-time_step / response_time)
        return cls(round(delay / time_step), share, period, time_step)

    def moved(self, value: float, target: float, waiting: np.ndarray, step: int) -> float:
        """The value after a step with a request; `waiting` has the requests under way, oldest first, and moves up."""
        queue = [*waiting[: self.delay].tolist(), target]
        waiting[: self.delay], waiting[self.delay :] = queue[1:], target  # the rest is there for a longer delay
        target = queue[0]
        if self.period is not None:
            return math.copysign(self._share_open(step, self.period, abs(target)), target)
        return value + self.share * (target - value)

    def _share_open(self, step: int, period: float, duty: float) -> float:
        """Share of a step in which an on/off valve is open that opens at the start of each period."""

        def time_open(until: float) -> float:
            periods = math.floor(until / period)
            return periods * duty * period + min(until - periods * period, duty * period)

        start = step * self.time_step
        return min(max((time_open(start + self.time_step) - time_open(start)) / self.time_step, 0.0), 1.0)
