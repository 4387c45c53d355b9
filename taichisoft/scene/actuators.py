"""Actuators as a user describes them: cavities and cables of soft bodies, and limits of what drives them."""

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from taichisoft.scene.air import AirLine
from taichisoft.scene.table import Name, NotNegative, Number, Positive, Rule, Table, Vector, ordered


class CavitySettings(Table):
    """An air chamber: a closed surface, by a group of the mesh or by a surface file of its own."""

    group: str | None = None
    """Name of a closed surface group of the mesh; either this or surface."""
    surface: str | None = None
    """Closed surface file; either this or group."""
    lowest_pressure: Number | None = None
    """Smallest pressure [kPa]: a pump that draws no further."""
    highest_pressure: Number | None = None
    """Largest pressure [kPa]: a valve that opens."""
    lowest_volume_growth: Number | None = None
    """How far the volume shrinks at most [mm^3], negative, whatever the pressure."""
    highest_volume_growth: Number | None = None
    """How far the volume grows at most [mm^3]: the supply has no more air."""
    air: Literal["regulated", "sealed", "line", "network"] = "regulated"
    """What holds the pressure: a "regulated" source has the requested pressure or volume; "sealed" air
    has a constant mass, and its pressure follows the volume; air of a "line" comes and goes through a valve of the
    cavity's own; air of a "network" through what the scene's table `air` joins with the cavity."""
    line: AirLine | None = None
    """Source, valve and tube of a line."""
    shut_pressure: Number = 0.0
    """Pressure over the atmosphere's at which the air is sealed, or at the start in a network, in the cavity at rest
    [kPa]."""
    exponent: Annotated[float, Field(strict=True, ge=1.0, le=1.7)] = 1.0
    """Exponent n of sealed air, p V^n = const, with p its absolute pressure: 1 for slow changes (isothermal), 1.4 for
    fast ones without heat flow (adiabatic)."""
    dead_volume: NotNegative = 0.0
    """Space for sealed air or that of a network outside the cavity, in tube and fittings [mm^3]."""
    alternatives = (("group", "surface"),)
    own_keys: ClassVar = {
        'air == "regulated"': ("lowest_pressure", "highest_pressure", "lowest_volume_growth", "highest_volume_growth"),
        'air == "sealed"': ("exponent",),
        'air == "sealed" or air == "network"': ("shut_pressure", "dead_volume"),
        'air == "line"': ("line",),
    }
    needs: ClassVar = {'air == "line"': ("line",)}
    rules = ordered("pressure", "volume_growth")


class CablePoint(Table):
    """A point of a cable on another body than the one that has the cable."""

    body: str
    """Name of the soft body, rigid body or obstacle."""
    point: Vector
    """The point in this body's own coordinates, as in its mesh or its scaled surface [mm]."""


class CableArea(Table):
    """A place of a cable that pulls at a whole area, such as a plate that is glued in: the weighted mean of points."""

    body: str | None = None
    """Name of the body that has the points; the cable's own body when it is not given."""
    area: Annotated[list[Vector], Field(min_length=1)]
    """The points, in this body's own coordinates [mm]."""
    weights: Annotated[list[NotNegative], Field(min_length=1)] | None = None
    """Share of each point in the pull, of any sum; equal ones when they are not given."""

    rules = (Rule("max(weights) > 0", "weights are all 0; at least one point must be pulled"),)

    @model_validator(mode="after")
    def _check_weights(self) -> Self:
        if self.weights is not None and len(self.weights) != len(self.area):
            raise ValueError(f"weights has {len(self.weights)} numbers for the {len(self.area)} points of area")
        return self


def _kind_of_points(value: Any) -> str:
    return "<file>" if isinstance(value, str) else "<list>"


def _kind_of_place(value: Any) -> str:
    if isinstance(value, CableArea) or (isinstance(value, dict) and "area" in value):
        return "<area>"
    return "<other body>" if isinstance(value, dict | CablePoint) else "<point>"


CablePlace = Annotated[
    Annotated[Vector, Tag("<point>")]
    | Annotated[CablePoint, Tag("<other body>")]
    | Annotated[CableArea, Tag("<area>")],
    Discriminator(_kind_of_place),
]


class CableSettings(Table):
    """A cable (tendon) through points of bodies: pulled in at its first point, attached at the last, free to slide
    through those between."""

    points: Annotated[
        Annotated[str, Tag("<file>")] | Annotated[list[CablePlace], Tag("<list>")], Discriminator(_kind_of_points)
    ]
    """Points in the mesh's own coordinates [mm], points of other bodies, or areas; or a file with a list of points
    (.json) or lines of x, y, z (.csv)."""
    pull_point: Vector | None = None
    """The place from which the cable is pulled, in the same coordinates [mm]; the first point when it is not given."""
    pull_point_moves: bool = True
    """Whether the pull point moves with the base, or what else the body follows; else it stays where it is in space."""
    friction: NotNegative = 0.0
    """Friction coefficient between the cable and its points [-]."""
    axial_stiffness: Positive | None = None
    """Young's modulus times cross-section: tension per relative stretch [mN]. When it is not given a cable does not
    stretch; one with friction has 1e7 mN, a thin line of strong fibres, since what does not stretch cannot stick."""
    rod: bool = False
    """Whether it pushes as well as it pulls; the tension of a cable is never negative."""
    lowest_tension: Number | None = None
    """Smallest tension [mN]; that of a cable is 0 when it is not given."""
    highest_tension: Number | None = None
    """Largest tension [mN], at which a motor gives way."""
    lowest_pull: Number | None = None
    """How far the cable is pulled in at least [mm]; negative when it may be paid out."""
    highest_pull: Number | None = None
    """How far the cable can be pulled in [mm], a stop."""

    rules = (
        *ordered("tension", "pull"),
        Rule(
            "rod or lowest_tension >= 0", "lowest_tension ({lowest_tension:g}) must not be negative unless rod = true"
        ),
        Rule(
            "rod or highest_tension >= 0",
            "highest_tension ({highest_tension:g}) must not be negative unless rod = true",
        ),
    )

    @property
    def other_bodies(self) -> list[str]:
        """Names of the bodies that its points and areas name."""
        places = [place for place in self.points if isinstance(place, CablePoint | CableArea)]
        return [place.body for place in places if place.body is not None]

    @model_validator(mode="after")
    def _check_count(self) -> Self:
        if not isinstance(self.points, str) and len(self.points) + (self.pull_point is not None) < 2:
            raise ValueError(f"points has {len(self.points)} points; a cable needs two, its pull point counted")
        return self


class ActuatorTables(Table):
    """The actuators of a soft body by name: a key for each kind."""

    cavities: dict[Name, CavitySettings] = {}
    cables: dict[Name, CableSettings] = {}

    @classmethod
    def tables(cls) -> dict[str, type[Table]]:
        """The table of each kind by its key."""
        return {key: get_args(field.annotation)[1] for key, field in ActuatorTables.model_fields.items()}

    @model_validator(mode="after")
    def _check_actuator_names(self) -> Self:
        known: dict[str, str] = {}
        for key, table in self.tables().items():
            kind = f"a {table.__name__.removesuffix('Settings').lower()}"
            for name in getattr(self, key):
                if name in known:
                    raise ValueError(f"{known[name]} and {kind} are both called '{name}'; give one another name")
                known[name] = kind
        return self


class ActuatorLimits(Table):
    """What no request to an actuator can exceed."""

    lowest_pressure: Number | None = None
    """Lowest pressure [kPa]."""
    highest_pressure: Number | None = None
    """Highest pressure [kPa]."""
    pressure_rate: Positive | None = None
    """Fastest change of a pressure, up or down [kPa/s]."""
    tension_rate: Positive | None = None
    """Fastest change of a cable's tension, up or down [mN/s]."""
    pull_speed: Positive | None = None
    """Fastest motion of a cable that is pulled in or paid out [mm/s]."""
    rules = ordered("pressure")
