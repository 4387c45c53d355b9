"""The line through which a cavity gets its air: source, valve and tube, as a user describes them."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from taichisoft.scenes.table import NotNegative, Number, Positive, Table

Ratio = Annotated[float, Field(strict=True, ge=0.0, lt=1.0)]


class AirLine(Table):
    """A source, a valve and a tube. Flow is that of ISO 6358, by sonic conductance and critical pressure ratio."""

    supply: Number | None = None
    """Pressure of the source over the atmosphere's [kPa]; when it is not given, the source is a pressure regulator that
    gives and takes air, at the pressure that is asked for."""
    exhaust: Number = 0.0
    """Pressure where a valve with an opening below 0 leads to, over the atmosphere's [kPa]: negative for a vacuum."""
    conductance: Positive
    """Sonic conductance C of the open valve [dm^3/(s bar)], as in its data sheet."""
    critical_ratio: Ratio = 0.3
    """Critical pressure ratio b of the valve [-]."""
    valve: Literal["proportional", "on/off"] = "proportional"
    """A "proportional" valve opens by the share of its conductance that is asked for; an "on/off" valve opens wholly
    for that share of each period."""
    period: Positive | None = None
    """Time from one opening of an on/off valve to the next [s]."""
    delay: Annotated[float, Field(strict=True, ge=0.0, le=10.0)] = 0.0
    """Time from a request to its first effect on regulator or valve [s], rounded to whole steps; 10 s at most, since
    what is on its way is kept."""
    response_time: NotNegative = 0.0
    """Time in which the regulator's pressure, or the opening of a proportional valve, goes 63 % of the way to what is
    asked for (time constant of first order) [s]."""
    tube_length: Positive | None = None
    """Length of the tube from the valve to the cavity [mm]; without a tube the valve is at the cavity."""
    tube_diameter: Positive | None = None
    """Inner diameter of the tube [mm]."""

    @property
    def has_regulator(self) -> bool:
        """Whether the source has the pressure that is asked for."""
        return self.supply is None

    @model_validator(mode="after")
    def _check_valve(self) -> Self:
        if (self.valve == "on/off") != (self.period is not None):
            raise ValueError('period belongs to valve = "on/off": give both or none')
        if self.valve == "on/off" and self.response_time:
            raise ValueError('response_time has no effect with valve = "on/off", which is open or closed; remove it')
        if self.valve == "on/off" and self.has_regulator:
            raise ValueError('valve = "on/off" needs a supply of constant pressure')
        if (self.tube_length is None) != (self.tube_diameter is None):
            raise ValueError("a tube needs tube_length and tube_diameter: give both or none")
        return self
