"""All that is observed in one table, which files, plots, pages, conditions, environments and rollouts read."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from enum import Flag, auto
from itertools import combinations
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taichisoft.mechanics.actuator_kind import ActuatorFigure, ActuatorKind
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS

if TYPE_CHECKING:
    from taichisoft.contact.model import Model

Pair = tuple[str, str]
"""Names of two bodies, in the scene's order."""
Values = Mapping[Any, Any]
"""Values of a figure, numbers or arrays, by the names of what it is of; "" for the base."""
Reader = Callable[[Any], Values]
"""Gives the values of a figure in an `Observation`."""


@dataclass(frozen=True)
class Subject:
    """What figures are of.

    Attributes:
        word: word for one of them; of the base, which is one, what conditions choose.
        names: those of a model that files have columns for.
        all: words for those that a condition means without brackets, behind the meaning of a figure.
        axes: "xyz" where all figures are vectors.
        kind: the kind of actuators that they are; None for others.
    """

    word: str
    names: "Callable[[Model], Sequence[Any]]"
    all: str = ""
    axes: str = ""
    kind: ActuatorKind | None = None


def _fingers(model: "Model") -> Sequence[str]:
    return [name for name, body in model.scene.soft_bodies.items() if body.anchors or body.tip is not None]


def _hinges(model: "Model") -> Sequence[str]:
    return [name for name, frame in model.scene.frames.items() if frame.hinge is not None]


def _bodies_and_frames(model: "Model") -> Sequence[str]:
    return [*model.scene.soft_bodies, *model.scene.rigid_bodies, *model.scene.all_frames]


def _pairs_with_objects(model: "Model") -> list[Pair]:
    """All pairs of a rigid body with any other body that it can touch, in the order of the scene.

    Where there is none: of soft bodies with obstacles, which they then press. Recordings have all pairs.
    """
    rigid = [body for body in model.rigid_bodies if body.collides or body.follows is None]
    pairs: list[Pair] = [(body.name, other.name) for body in model.soft_bodies for other in rigid]
    pairs += [(one.name, two.name) for one, two in combinations(rigid, 2) if None in (one.follows, two.follows)]
    pairs += [(body.name, one.name) for body in rigid if body.follows is None for one in model.obstacles]
    return pairs if rigid else [(body.name, one.name) for body in model.soft_bodies for one in model.obstacles]


def _actuators(kind: ActuatorKind) -> Subject:
    return Subject(f"finger or {kind.name}", lambda model: model.actuators.names_of(kind), kind=kind)


FINGERS = Subject("finger", _fingers)
BASE = Subject("x, y or z", lambda model: ("",), axes="xyz")
FRAMES = Subject("frame", lambda model: list(model.scene.frames), axes="xyz")
HINGES = Subject("frame", _hinges)
PUSHED = Subject("body or frame", _bodies_and_frames, axes="xyz")
OBJECTS = Subject("rigid body", lambda model: model.scene.objects)
AIR_NODES = Subject("tank, tube or source", lambda model: model.scene.air.nodes)
AIR_PARTS = Subject("tube, orifice or valve", lambda model: list(model.scene.air.parts))
AIR_VALVES = Subject("valve", lambda model: list(model.scene.air.valves))
TACTILE_ARRAYS = Subject("tactile array", lambda model: list(model.scene.tactile_arrays))
PAIRS = Subject("pair of bodies", _pairs_with_objects, " of the soft bodies on the object")


class In(Flag):
    """What has a figure: CSV files, recordings and their plots, pages, and metrics, of the last step or the largest."""

    NOTHING = 0
    CSV = auto()
    RECORDING = auto()
    PAGE = auto()
    FINAL = auto()
    LARGEST = auto()


FILES = In.CSV | In.RECORDING


@dataclass(frozen=True)
class Figure:
    """Something that is observed. What it says here is all that any output, condition or environment knows of it.

    Attributes:
        name: in conditions of scripts, files and plots, such as "normal_force".
        unit: unit for people, "1" for none; an observation has radians instead of degrees.
        per: what it is of.
        meaning: of the name in a condition without brackets; "" where conditions cannot have it.
        combined: how a condition makes one number of several; of vectors it has the length.
        recorded: what has it.
        drawn: title of its plot; "" for none.
        reach: largest value of a channel of an environment [unit of the observation]; 0 where none can have it.
        of: its values in an observation; the attribute `field` unless given.
        axes: "xyz" for vectors.
        field: attribute of an observation, also for rollouts; the name in the plural unless given, but of the base.
        factor: factor on the value in plots.
        digits: digits after the point in captions; tables have one more.
        in_model: makes `of` for a model, for what depends on it as well.
    """

    name: str
    unit: str
    per: Subject
    meaning: str = ""
    combined: Literal["max", "mean", "sum"] = "max"
    recorded: In = In.NOTHING
    drawn: str = ""
    reach: float = 0.0
    of: Reader | None = None
    axes: str = ""
    field: str = ""
    factor: float = 1.0
    digits: int = 1
    in_model: "Callable[[Model], Reader] | None" = None
    _read: Reader = dataclass_field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Fill in what follows from the name and from what it is of."""
        plural = f"{self.name[:-1]}ies" if self.name.endswith("y") else f"{self.name}s"
        field = self.field or (self.name if self.per is BASE else plural)
        read = self.of or attrgetter(field)
        of_base = self.of is None and self.per is BASE
        object.__setattr__(self, "field", field)
        object.__setattr__(self, "_read", (lambda seen: {"": read(seen)}) if of_base else read)
        object.__setattr__(self, "axes", self.axes or self.per.axes)

    def values(self, seen: Any) -> Values:
        """Its values in an observation, of what does not depend on a model."""
        return self._read(seen)

    def reader(self, model: "Model") -> Reader:
        """What gives its values in an observation of a model."""
        return self.values if self.in_model is None else self.in_model(model)

    def value(self, values: Values, name: Any) -> Any:
        """The value of one of them in its unit for people; bodies that are far apart are not observed, and have 0."""
        value = values.get(name, 0.0) if self.per is PAIRS else values[name]
        return np.degrees(value) if self.unit == "degrees" else value

    def metric(self, kind: str) -> str:
        """The name among the metrics, such as "final_pressures_kPa"."""
        return f"{kind}_{self.name}s_{self.unit.replace('^', '')}"


def text_of(name: str | Pair) -> str:
    """The name of what a figure is of, in files: "finger1|cube" for a pair."""
    return name if isinstance(name, str) else "|".join(name)


def _of_actuators(kind: ActuatorKind, figure: ActuatorFigure) -> Figure:
    metric = {"final": In.FINAL, "largest": In.LARGEST}.get(figure.metric, In.NOTHING)
    return Figure(
        figure.name,
        figure.unit,
        _actuators(kind),
        figure.meaning,
        "sum" if figure.total else "mean",
        metric | (FILES if figure.recorded else In.NOTHING),
        figure.plotted,
        reach=200e3 if figure is kind.rate else 0.0,
        field=figure.observed,
        factor=figure.plot_factor,
        digits=figure.digits,
    )


def _heights(model: "Model") -> Reader:
    up = model.scene.up
    return lambda seen: {name: float(place @ up) for name, place in seen.object_positions.items()}


def _lifts(model: "Model") -> Reader:
    # A run that is resumed counts on from where the scene has the bodies.
    up, start = model.scene.up, {body.name: body.start_position for body in model.rigid_bodies}
    return lambda seen: {name: float((seen.object_positions[name] - place) @ up) for name, place in start.items()}


def _lengths(vectors: Values) -> Values:
    return {name: float(np.linalg.norm(vector)) for name, vector in vectors.items()}


ON_PAGE, LISTED = FILES | In.PAGE, FILES | In.FINAL
EVERYWHERE, CSV_PAGE = ON_PAGE | In.FINAL, In.CSV | In.PAGE

FIGURES: tuple[Figure, ...] = (
    *(_of_actuators(kind, figure) for kind in ACTUATOR_KINDS for figure in kind.measured),
    Figure(
        "network_pressure",
        "kPa",
        AIR_NODES,
        "pressure in tanks, tubes and sources of the air network, mean of all",
        "mean",
        FILES,
        "pressure in the air network [kPa]",
    ),
    Figure(
        "network_flow",
        "kg/s",
        AIR_PARTS,
        "largest flow through a tube, orifice or valve of the air network",
        "max",
        FILES,
        "flow in the air network [mg/s]",
        factor=1e6,
    ),
    Figure("network_opening", "1", AIR_VALVES, "opening of the air network's valves, mean of all", "mean", In.CSV),
    Figure("tip_position", "mm", FINGERS, recorded=In.CSV | In.FINAL, reach=200.0, axes="xyz"),
    Figure(
        "bending_angle",
        "degrees",
        FINGERS,
        "turn of the tip against the base, mean of all fingers",
        "mean",
        In.CSV | In.FINAL,
        reach=np.pi,
    ),
    Figure(
        "tip_speed", "mm/s", FINGERS, "speed of the fastest fingertip", of=lambda seen: _lengths(seen.tip_velocities)
    ),
    Figure("tip_velocity", "mm/s", FINGERS, reach=1e3, axes="xyz"),
    Figure("base_translation", "mm", BASE, "distance of the base from its rest", recorded=In.CSV),
    Figure("base_rotation", "degrees", BASE, "angle of the base's turn", recorded=In.CSV),
    Figure("base_force", "mN", BASE, "force on the base, its amount", "max", CSV_PAGE, "force on the base [mN]"),
    Figure(
        "base_torque",
        "mN mm",
        BASE,
        "torque on the base about its pivot, its amount",
        "max",
        CSV_PAGE,
        "torque on the base [mN mm]",
    ),
    Figure("base_force_in_base", "mN", BASE, recorded=In.CSV, reach=1e4),
    Figure("base_torque_in_base", "mN mm", BASE, recorded=In.CSV, reach=1e6),
    Figure("frame_translation", "mm", FRAMES, "distance of the farthest frame from its rest", recorded=In.CSV),
    Figure("frame_rotation", "degrees", FRAMES, "largest angle of a frame's turn", recorded=In.CSV),
    Figure("frame_force", "mN", FRAMES, "largest force on a frame, its amount", "max", In.CSV, "force on a frame [mN]"),
    Figure("frame_torque", "mN mm", FRAMES, "largest torque on a frame about its pivot", recorded=In.CSV),
    Figure("frame_angle", "degrees", HINGES, "largest angle of a hinge"),
    Figure("frame_moment", "mN mm", HINGES, "largest moment about a hinge"),
    Figure("position", "mm", OBJECTS, recorded=In.CSV, axes="xyz", field="object_positions"),
    Figure("height", "mm", OBJECTS, "coordinate of the object's centre of mass, upwards", in_model=_heights),
    Figure(
        "lift", "mm", OBJECTS, "height of the object over its height at the start", recorded=In.CSV, in_model=_lifts
    ),
    Figure(
        "speed",
        "mm/s",
        OBJECTS,
        "speed of the object's centre of mass",
        of=lambda seen: _lengths(seen.object_velocities),
        field="object_speeds",
    ),
    Figure("object_velocity", "mm/s", OBJECTS, reach=1e3, axes="xyz"),
    Figure("tactile", "mN", TACTILE_ARRAYS, field="tactile"),
    Figure("external_force", "mN", PUSHED, "largest force from outside, its amount", "max", In.CSV, reach=1e4),
    Figure("contact_count", "1", PAIRS, "number of pressing contacts", "sum"),
    Figure("normal_force", "mN", PAIRS, "sum of the normal forces", "sum", EVERYWHERE, "normal force [mN]", 5e3),
    Figure("friction_force", "mN", PAIRS, "sum of the amounts of friction", "sum", LISTED, "friction force [mN]", 5e3),
    Figure("slip_speed", "mm/s", PAIRS, "fastest sliding", recorded=FILES, reach=100.0),
    Figure("contact_area", "mm^2", PAIRS, "area in contact", "sum", LISTED, "area in contact [mm²]", 1e3),
    Figure("contact_area_error", "mm^2", PAIRS, recorded=In.CSV | In.FINAL),
    Figure("peak_pressure", "kPa", PAIRS, "highest pressure", "max", ON_PAGE, "highest contact pressure [kPa]", 200.0),
    Figure("peak_pressure_error", "kPa", PAIRS, recorded=In.CSV),
)
"""All figures, in the order of columns and plots. An observation has each, by its `field`, but for those of a model."""
BY_NAME = {figure.name: figure for figure in FIGURES}
