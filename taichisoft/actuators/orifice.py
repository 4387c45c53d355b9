"""Flow of air through valves and tubes (ISO 6358-1:2013, ISO 6358-3:2014)."""

import math
from dataclasses import dataclass

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
