"""Ranges of quantities in soft robots: what lies outside was mostly given in another unit."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Plausible:
    """Range of a quantity in soft robots.

    Attributes:
        unit: unit in scenes.
        lowest, highest: bounds of the plausible range.
        mistaken: factors from other units to `unit`, by the name of the unit.
    """

    unit: str
    lowest: float
    highest: float
    mistaken: Mapping[str, float]


MODULUS = Plausible("kPa", 0.5, 5e4, {"MPa": 1e3, "GPa": 1e6, "Pa": 1e-3})
"""From the softest gels to the hardest rubber: 60 kPa in Pa lie above it."""
FIBRE_MODULUS = Plausible("kPa", 500.0, 5e8, {"MPa": 1e3, "GPa": 1e6, "Pa": 1e-3})
"""From threads of rubber to carbon fibre."""
PRESSURE = Plausible("kPa", 0.0, 2000.0, {"Pa": 1e-3, "hPa": 0.1})
"""Of air, up to the highest of compressors; as size, for vacuum as well."""
SOFT_DENSITY = Plausible("kg/mm^3", 1e-8, 2e-5, {"g/cm^3": 1e-6, "kg/m^3": 1e-9, "g/mm^3": 1e-3})
"""From foams to metals."""
DENSITY = Plausible("kg/mm^3", 1e-9, 2.3e-5, {"g/cm^3": 1e-6, "kg/m^3": 1e-9, "g/mm^3": 1e-3})
"""From aerogels to osmium."""
SIZE = Plausible("mm", 1.0, 2e4, {"m": 1e3, "um": 1e-3, "cm": 10.0})
"""Of the longest side of a body; one of a metre, in metres, is just within it."""
TIME_STEP = Plausible("s", 1e-7, 0.5, {"ms": 1e-3, "us": 1e-6})
DURATION = Plausible("s", 1e-6, 1e6, {"ms": 1e-3})
GRAVITY = Plausible("mm/s^2", 50.0, 1e6, {"m/s^2": 1e3})


def implausible(key: str, value: float, plausible: Plausible) -> str:
    """A line on a value outside of a range, with the unit that was probably meant; empty within it."""
    low, high = plausible.lowest, plausible.highest
    if low <= value <= high:
        return ""
    line = f"{key} = {value:g} {plausible.unit}: soft robots have {low:g} to {high:g}"
    meant = likely_unit(value, plausible)
    return f"{line}; {meant}" if meant else line


def likely_unit(value: float, plausible: Plausible) -> str:
    """The first unit in which a value would be plausible, as in "0.04 m are 40 mm"; empty where there is none."""
    for unit, factor in plausible.mistaken.items():
        if plausible.lowest <= value * factor <= plausible.highest:
            return f"{value:g} {unit} are {value * factor:g} {plausible.unit}"
    return ""
