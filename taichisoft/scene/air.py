"""Air supplies as a user describes them: lines of single cavities, and networks of tanks, tubes and valves."""

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichisoft.errors import nearest
from taichisoft.scene.table import Name, NotNegative, Number, Positive, Rule, Table, ordered

# What lines and networks are made of. Flow is that of ISO 6358, by sonic conductance and critical pressure ratio.

# Up to where flow is proportional to the pressure difference, above a ratio of 0.999.
Ratio = Annotated[float, Field(strict=True, ge=0.0, le=0.999)]


class Restriction(Table):
    """Something that air flows through."""

    conductance: Annotated[Positive, Field(le=1e6)]
    """Sonic conductance C, of a valve that is open [dm^3/(s bar)], as in its data sheet; 1e6 at most, since round-off
    of equal pressures is a flow."""
    critical_ratio: Ratio = 0.3
    """Critical pressure ratio b [-]."""


class Answering(Table):
    """Something that answers requests."""

    delay: Annotated[float, Field(strict=True, ge=0.0, le=10.0)] = 0.0
    """Time from a request to its first effect on regulator or valve [s], rounded to whole steps; 10 s at most, since
    what is on its way is kept."""
    response_time: NotNegative = 0.0
    """Time in which the regulator's pressure, or the opening of a proportional valve, covers 63 % of the distance to
    the request (time constant of first order) [s]."""


class Valve(Restriction, Answering):
    """A valve."""

    valve: Literal["proportional", "on/off"] = "proportional"
    """A "proportional" valve opens by the requested share of its conductance; an "on/off" valve opens wholly
    for that share of each period."""
    period: Positive | None = None
    """Time from one opening of an on/off valve to the next [s]."""
    own_keys: ClassVar = {'valve == "on/off"': ("period",), 'valve == "proportional"': ("response_time",)}
    needs: ClassVar = {'valve == "on/off"': ("period",)}


class AirLine(Valve):
    """A source, a valve and a tube. Flow is that of ISO 6358, by sonic conductance and critical pressure ratio."""

    supply: Number | None = None
    """Pressure of the source over the atmosphere's [kPa]; when it is not given, the source is a pressure regulator that
    gives and takes air, at the requested pressure."""
    exhaust: Number = 0.0
    """Pressure where a valve with an opening below 0 leads to, over the atmosphere's [kPa]: negative for a vacuum."""
    tube_length: Positive | None = None
    """Length of the tube from the valve to the cavity [mm]; without a tube the valve is at the cavity."""
    tube_diameter: Positive | None = None
    """Inner diameter of the tube [mm]."""

    needs: ClassVar = {
        'valve == "on/off"': ("period", "supply"),
        "tube_length": ("tube_diameter",),
        "tube_diameter": ("tube_length",),
    }

    @property
    def has_regulator(self) -> bool:
        """Whether the source has the requested pressure."""
        return self.supply is None


# Networks: nodes with a pressure, and what joins them.

ATMOSPHERE = "atmosphere"
"""The node of every network that is the air outside."""


class AirSource(Answering):
    """A source of unlimited air."""

    pressure: Number | None = None
    """Pressure over the atmosphere's [kPa]; when it is not given, the source is a pressure regulator that gives and
    takes air, at the pressure that is requested by its name."""
    lowest_pressure: Number | None = None
    """Lowest pressure of a regulator [kPa]; a vacuum when it is not given."""
    highest_pressure: Number | None = None
    """Highest pressure of a regulator [kPa]."""
    no_effect_beside: ClassVar = {"pressure": ("delay", "response_time", "lowest_pressure", "highest_pressure")}
    rules = ordered("pressure")


class Tank(Table):
    """A rigid volume: a reservoir, a manifold, the air in fittings."""

    volume: Positive
    """Space for air [mm^3]."""
    pressure: Number = 0.0
    """Pressure over the atmosphere's at the start [kPa]."""


class AirTube(Table):
    """A straight tube: its air has the pressure where it begins, its resistance is where it ends."""

    inlet: str | None = None
    """Tank, source or cavity where it begins; when it is not given, what has the tube as its outlet leads into it."""
    outlet: str
    """Tank, source, cavity, "atmosphere", or the next tube, where it ends."""
    length: Positive
    """Length [mm]."""
    diameter: Positive
    """Inner diameter [mm]."""


class AirOrifice(Restriction):
    """A throttle, a filter, a leak."""

    inlet: str
    """Tank, source, cavity or "atmosphere" before it; air may flow back."""
    outlet: str
    """The one behind it, or a tube that begins there."""


class AirValve(Valve):
    """A valve with two ports, or three: inlet, outlet and exhaust."""

    inlet: str
    """Tank, source, cavity or "atmosphere" that an opening above 0 joins with the outlet; air may flow back."""
    outlet: str
    """The one behind it, or a tube that begins there."""
    exhaust: str | None = None
    """Where openings below 0 lead from the outlet: the third port, "atmosphere" or any other."""
    opening: Annotated[float, Field(strict=True, ge=-1.0, le=1.0)] = 0.0
    """Opening at the start, until one is requested: 0 is shut, 1 wholly open."""
    needs: ClassVar = {**Valve.needs, "opening < 0": ("exhaust",)}
    rules = (
        Rule(
            'valve == "proportional" or opening == 0',
            "opening ({opening:g}) is of proportional valves; an on/off valve is shut until it is asked",
        ),
    )


class AirNetworkSettings(Table):
    """What joins cavities whose `air` is "network"; all parts have names of their own."""

    sources: dict[Name, AirSource] = {}
    tanks: dict[Name, Tank] = {}
    tubes: dict[Name, AirTube] = {}
    orifices: dict[Name, AirOrifice] = {}
    valves: dict[Name, AirValve] = {}

    @property
    def volumes(self) -> tuple[str, ...]:
        """Rigid volumes by name: tanks, and tubes whose air is no part of what they begin at."""
        return (*self.tanks, *(name for name, tube in self.tubes.items() if tube.inlet is None))

    @property
    def nodes(self) -> tuple[str, ...]:
        """What has a pressure, beside cavities: the rigid volumes, and sources."""
        return (*self.volumes, *self.sources)

    @property
    def regulators(self) -> tuple[str, ...]:
        """Sources at the requested pressure."""
        return tuple(name for name, source in self.sources.items() if source.pressure is None)

    @property
    def drives(self) -> tuple[str, ...]:
        """What requests drive: valves by their openings, regulators by their pressures."""
        return (*self.valves, *self.regulators)

    @property
    def parts(self) -> "dict[str, AirTube | AirOrifice | AirValve]":
        """What air flows through, by name: tubes, orifices, valves."""
        return {**self.tubes, **self.orifices, **self.valves}

    def joins(self) -> "Iterator[tuple[str, AirTube | AirOrifice | AirValve, str, str, float]]":
        """Name and table of each part, the nodes that it joins, and the sign of the openings that do, 0 for all."""
        for name, part in self.parts.items():
            yield name, part, name if part.inlet is None else part.inlet, part.outlet, float(isinstance(part, AirValve))
            if isinstance(part, AirValve) and part.exhaust is not None:
                yield name, part, part.exhaust, part.outlet, -1.0

    def check(self, air_of: Mapping[str, str]) -> None:
        """Refuse a network that joins what is not there, or nothing, with the `air` of each cavity by its name.

        Raises:
            ValueError: one line for the user.
        """
        known = {ATMOSPHERE: "the air outside"}
        for kind in ("sources", "tanks", "tubes", "orifices", "valves"):
            for name in getattr(self, kind):
                if name in known:
                    raise ValueError(f"air.{kind}.{name}: {known[name]} has this name already; give it another one")
                known[name] = f"air.{kind}.{name}"
        networked = [name for name, kind in air_of.items() if kind == "network"]
        if len(known) > 1 and not networked:
            raise ValueError(f'air: {[*known.values()][1]} joins no cavity; give one air = "network", or remove it')
        for name, part in self.parts.items():
            for key in ("inlet", "outlet", "exhaust"):
                if (node := getattr(part, key, None)) is not None:
                    self._check_end(f"{known[name]}.{key}", node, key, air_of, networked)
        given, reached = {ATMOSPHERE, *self.sources}, set()
        for name, _, inlet, outlet, _ in self.joins():
            reached |= {inlet, outlet} - {name}
            if inlet == outlet:
                raise ValueError(f"{known[name]}: leads from '{inlet}' to itself; join it to another node")
            if {inlet, outlet} <= given:
                raise ValueError(
                    f"{known[name]}: leads from '{inlet}' to '{outlet}', whose pressures are both given; put a tank, "
                    "tube or cavity between"
                )
        for name in (*networked, *self.nodes):
            if name not in reached:
                body, _, cavity = name.partition(".")
                place = f'soft_bodies.{body}.cavities.{cavity}.air = "network"' if cavity else known[name]
                raise ValueError(f"{place}: no tube, orifice or valve of [air] leads there; let one end at '{name}'")

    def _check_end(self, key: str, node: str, end: str, air_of: Mapping[str, str], networked: list[str]) -> None:
        """Refuse an end of a part that is no node."""
        if node in air_of and node not in networked:
            raise ValueError(f'{key} = \'{node}\': a cavity with air = "{air_of[node]}"; it needs air = "network"')
        tube = self.tubes.get(node)
        if tube is not None and end == "inlet":
            raise ValueError(
                f"{key} = '{node}': the name of a tube is where it begins; let the tube end in a tank, and begin there"
            )
        if tube is not None and tube.inlet is not None:
            raise ValueError(f"{key} = '{node}': this tube begins at '{tube.inlet}'; name that, or leave its inlet out")
        nodes = [ATMOSPHERE, *self.nodes, *networked]
        if node not in nodes:
            raise ValueError(
                f"{key} = '{node}': no tank, source, tube or cavity has this name; {nearest(node, nodes, 'there are')}"
            )
