"""Air that is shut into a cavity: its pressure follows the volume."""

from dataclasses import dataclass

import numpy as np

# Air as an ideal gas at 20 degrees C: gas constant of dry air, 287.05 J/(kg K), times temperature [mN mm/kg].
GAS_CONSTANT, TEMPERATURE = 287.05e6, 293.15
PRESSURE_TIMES_VOLUME = GAS_CONSTANT * TEMPERATURE


def air_mass(pressure: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Masses of air [kg] at absolute pressures [kPa] in volumes [mm^3] of the same shape, at room temperature."""
    return pressure * volume / PRESSURE_TIMES_VOLUME


@dataclass(frozen=True)
class ShutAir:
    """Air of constant mass, p V^n = const, with p its absolute pressure and V the space that it fills.

    n is 1 for slow changes at constant temperature (isothermal) and 1.4 for fast ones without heat flow (adiabatic).

    Attributes:
        mass: mass of the air [kg].
        exponent: n [-].
        warm_space: space in which the air has room temperature [mm^3].
        rest_volume: volume of the cavity at rest [mm^3].
        dead_volume: volume of tube and fittings, at the same pressure [mm^3].
        atmosphere: absolute pressure outside [kPa].
    """

    mass: float
    exponent: float
    warm_space: float
    rest_volume: float
    dead_volume: float
    atmosphere: float

    @property
    def lowest_effort(self) -> float:
        """Pressure over the atmosphere's at which there is a vacuum [kPa]."""
        return -self.atmosphere

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
