"""The contents of a script's file: keyframes or steps, as plain validated data."""

import csv
import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import Field, PlainValidator, ValidationError, model_validator
from pydantic_core import PydanticKnownError

from taichisoft.base import parse_toml
from taichisoft.errors import SceneError, nearest
from taichisoft.mechanics import ActuatorKind, Drive, kind_of
from taichisoft.scene import NotNegative, Number, Positive, Table, Vector, first_problem
from taichisoft_controllers.settings import DRIVES, table_of_drives

# Keyframes as comma-separated values: a row for each, with columns "time [s]", "pressure finger1 [kPa]" ...

EFFORTS = tuple(drive.name for drive in DRIVES)
UNITS = {
    "time": "s",
    **{drive.name: drive.unit for drive in DRIVES},
    **{f"base_translation {axis}": "mm" for axis in "xyz"},
    **{f"base_rotation {axis}": "degrees" for axis in "xyz"},
}
"""Columns and their units. Instead of "pressure" there may be several "pressure NAME" of fingers or cavities; likewise
for "pull" and "tension"."""
HEADING = re.compile(r"\s*(?P<name>[^\[\]]*?)\s*(\[\s*(?P<unit>[^\[\]]*?)\s*\])?\s*")


def read_keyframes(text: str) -> dict[str, Any]:
    """Give the tables that the same script has in TOML. Empty lines and lines that begin with # are comments."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    try:
        headings, *rows = csv.reader(lines, skipinitialspace=True)
    except (csv.Error, ValueError) as error:
        raise SceneError(f"needs a first line with the names of the columns, as in: time,pressure ({error})") from error
    columns = [_column(heading) for heading in headings]
    twice = next((name for name in columns if columns.count(name) > 1), None)
    if twice is not None:
        raise SceneError(f"there are {columns.count(twice)} columns '{twice}'; keep one")
    for effort in EFFORTS:
        by_name = [name for name in columns if name.startswith(f"{effort} ")]
        if effort in columns and by_name:
            raise SceneError(f"the columns '{effort}' and '{by_name[0]}' exclude each other")
    if "time" not in columns:
        raise SceneError(f"the column 'time' is missing; columns are: {', '.join(columns)}")
    return {"keyframes": [_keyframe(columns, row) for row in rows]}


def _column(heading: str) -> str:
    """The name of a column, without its unit."""
    match = HEADING.fullmatch(heading)
    name, unit = (" ".join(match["name"].split()), match["unit"]) if match else (heading, None)
    first = name.partition(" ")[0]
    known = first if first in EFFORTS else name
    if known not in UNITS:
        raise SceneError(f"column '{heading}': unknown; {nearest(name, list(UNITS), 'valid columns')}")
    if unit not in (None, UNITS[known]):
        raise SceneError(f"column '{heading}': its unit is {UNITS[known]}, not {unit}")
    return name


def _keyframe(columns: list[str], cells: list[str]) -> dict[str, Any]:
    """The table of a keyframe, whose values the script's tables check."""
    if len(cells) != len(columns):
        raise SceneError(f"{','.join(cells)}: has {len(cells)} cells; {len(columns)} are needed, one for each column")
    try:
        values = {name: float(cell) for name, cell in zip(columns, cells, strict=True)}
    except ValueError as error:
        raise SceneError(f"{','.join(cells)}: each cell must be a number, as in 0.5: {error}") from error
    keyframe: dict[str, Any] = {"time": values["time"]}
    for effort in EFFORTS:
        by_name = {name.removeprefix(f"{effort} "): values[name] for name in columns if name.startswith(f"{effort} ")}
        keyframe[effort] = by_name or values.get(effort)
    for key in ("base_translation", "base_rotation"):
        keyframe[key] = [values.get(f"{key} {axis}", 0.0) for axis in "xyz"]
    return keyframe


SUFFIXES = (".toml", ".csv")

Interpolation = Literal["linear", "smooth"]

RATES = {
    **{drive.name: (drive.rate, f"{drive.unit}/s") for drive in DRIVES},
    "base_translation": ("base_speed", "mm/s"),
    "base_rotation": ("base_turning_speed", "degrees/s"),
}
"""Keys of what a step can move, each with the key and the unit of its rate."""


FRAME_RATES = {"translation": ("speed", "mm/s"), "rotation": ("turning_speed", "degrees/s")}
"""The same of frames beside the base; an angle turns as a rotation does."""


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PydanticKnownError("float_type")
    if not math.isfinite(value):
        raise PydanticKnownError("finite_number")
    return float(value)


Efforts = float | dict[str, float]


def _efforts(drive: Drive) -> Callable[[Any], Efforts]:
    """The check of a number for all actuators, or of numbers by finger or actuator.

    TOML makes finger1.cavity = 50 a table in a table.
    """

    def check(value: Any, parents: tuple[str, ...] = ()) -> Efforts:
        if not isinstance(value, dict):
            return _number(value)
        if not value:
            raise ValueError(f"names no finger or {kind_of(drive).name}")
        flat: dict[str, float] = {}
        for name, inner in value.items():
            path = (*parents, name)
            try:
                read = check(inner, path)
            except PydanticKnownError as error:
                raise ValueError(f"{'.'.join(path)} = {inner!r} must be a finite number [{drive.unit}]") from error
            flat |= read if isinstance(read, dict) else {".".join(path): read}
        return flat

    return lambda value: check(value)


def _value(drive: Drive, kind: ActuatorKind) -> tuple[str, Any, str]:
    of_all = f"{drive.words.capitalize()} of all {kind.plural} [{drive.unit}], or a table by finger or {kind.name}"
    every = f" that names every {kind.name}" if kind.always_driven and drive is kind.effort else ""
    return drive.name, Annotated[Efforts, PlainValidator(_efforts(drive))], f"{of_all}{every}."


def _target(drive: Drive, kind: ActuatorKind) -> tuple[str, Any, str]:
    of_all = f"Target of the {drive.words} of all {kind.plural} [{drive.unit}], or a table by finger or {kind.name}"
    return drive.name, _value(drive, kind)[1], f"{of_all}; what it does not name stays."


def _rate(drive: Drive, kind: ActuatorKind) -> tuple[str, Any, str]:
    return drive.rate, Positive, f"Rate of each {drive.words} on its way [{drive.unit}/s]."


Driven: Any = table_of_drives("Driven", Table, _value)
Moved: Any = table_of_drives("Moved", table_of_drives("Aimed", Table, _target), _rate)


class FramePlace(Table):
    """Where a frame is: a pose, or the angle of one with a hinge."""

    translation: Vector | None = None
    """Translation from rest [mm]."""
    rotation: Vector | None = None
    """Rotation vector about the frame's pivot [degrees]."""
    angle: Number | None = None
    """Angle of the hinge [degrees]."""

    @model_validator(mode="after")
    def _check_pose(self) -> "FramePlace":
        if self.angle is not None and (self.translation is not None or self.rotation is not None):
            raise ValueError("angle is for a hinge, which has neither translation nor rotation; give one or the other")
        return self


class FrameAim(FramePlace):
    """Where a frame goes, and how fast."""

    speed: Positive | None = None
    """Speed of the frame on its straight way [mm/s]."""
    turning_speed: Positive | None = None
    """Turning speed of the frame on its way [degrees/s]."""


class ForceTable(Table):
    """A force from outside, and a torque."""

    force: Vector = (0.0, 0.0, 0.0)
    """Force [mN]."""
    torque: Vector = (0.0, 0.0, 0.0)
    """Torque about the point [mN mm]; a soft body takes none."""
    point: Vector | None = None
    """Where it acts, as a place at rest [mm]: the centre of mass or the pivot when not given; soft bodies need one."""
    axes: Literal["world", "own"] = "world"
    """Axes of the world, or "own", which turn with what is pushed."""


class Keyframe(Driven):  # type: ignore[misc] # a table with the keys of the drives
    """The values at a time; between two keyframes they are interpolated."""

    time: NotNegative
    """Time since the start of the run [s]; later than that of the keyframe before."""
    base_translation: Vector = (0.0, 0.0, 0.0)
    """Translation from the rest position [mm]; zero when it is not given."""
    base_rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation vector about the base pivot [degrees]; zero when it is not given."""
    frames: dict[str, FramePlace] = Field(default_factory=dict)
    """Poses of other frames by name, with translation and rotation or angle; zero where it is not given."""
    forces: dict[str, ForceTable] = Field(default_factory=dict)
    """Forces from outside by body or frame, with force, torque, point and axes; zero where it is not given."""

    @model_validator(mode="after")
    def _check_efforts(self) -> "Keyframe":
        given = dict(self)
        if all(given[name] is None for name in EFFORTS) and not self.forces:
            raise ValueError(f"needs at least one of {', '.join(EFFORTS)}, forces")
        return self


class Step(Moved):  # type: ignore[misc] # as above
    """A motion to targets, which ends on arrival or when a condition is true; then the next step begins."""

    name: str = ""
    """Name of the step in messages and in the closing table."""
    base_translation: Vector | None = None
    """Target of the base, from the rest position [mm]; the base stays when it is not given."""
    base_rotation: Vector | None = None
    """Target of the base, rotation vector about the base pivot [degrees]; the base stays when it is not given."""
    frames: dict[str, FrameAim] = Field(default_factory=dict)
    """Targets of other frames by name, with translation, rotation or angle, and speeds; what is not named stays."""
    forces: dict[str, ForceTable] = Field(default_factory=dict)
    """Forces from outside by body or frame, with force, torque, point and axes, which end with the step."""
    duration: Positive | None = None
    """Duration of the way to all targets [s]; either this or a rate for each thing that moves."""
    base_speed: Positive | None = None
    """Speed of the base on its straight way [mm/s]."""
    base_turning_speed: Positive | None = None
    """Turning speed of the base on its way [degrees/s]."""
    until: str | None = None
    """Condition: as soon as it is true everything stays where it is, and the step ends."""
    timeout: Positive | None = None
    """Time after the beginning of the step at which the run fails when `until` is still not true [s]."""
    hold: Positive | None = None
    """Duration for which everything stays where it is before the next step begins [s]."""
    moving: ClassVar[tuple[str, ...]] = tuple(RATES)
    """Keys of all that a step can move."""

    @model_validator(mode="after")
    def _check_motion(self) -> "Step":
        for key, (rate, unit) in RATES.items():
            self._check_rate(self, key, rate, unit)
        for name, target in self.frames.items():
            for key, (rate, unit) in FRAME_RATES.items():
                turned = "angle" if key == "rotation" and target.angle is not None else key
                self._check_rate(target, turned, rate, unit, f"frames.{name}.")
        if self.duration is not None and not self.moves:
            raise ValueError("duration without anything that moves; to wait, give hold [s]")
        return self

    def _check_rate(self, table: Table, key: str, rate: str, unit: str, where: str = "") -> None:
        given = dict(table)
        moves, has_rate = given[key] is not None, given[rate] is not None
        if has_rate and not moves:
            raise ValueError(f"{where}{rate} without {where}{key} has no effect; remove it or say where to go")
        if has_rate and self.duration is not None:
            raise ValueError(f"duration and {where}{rate} are both given; give one of them")
        if moves and not has_rate and self.duration is None:
            raise ValueError(f"{where}{key} needs a duration [s] or a {rate} [{unit}]")

    @model_validator(mode="after")
    def _check_waiting(self) -> "Step":
        if self.until is not None and self.timeout is None:
            raise ValueError("until needs a timeout [s], after which the run fails")
        if self.timeout is not None and self.until is None:
            raise ValueError("timeout without until has no effect; remove it or give a condition")
        if not self.moves and self.until is None and self.hold is None:
            raise ValueError(f"does nothing; it needs at least one of {', '.join(self.moving)}, frames, until, hold")
        return self

    @property
    def moves(self) -> bool:
        """Whether the step moves anything."""
        return bool(self.frames) or any(value is not None for key, value in self if key in self.moving)


class Script(Table):
    """The file that a scripted controller follows: keyframes at fixed times, or steps that may wait for conditions."""

    interpolation: Interpolation = "linear"
    """"smooth" starts and ends at rest between any two keyframes and in any `duration` (3 s^2 - 2 s^3)."""
    keyframes: list[Keyframe] | None = Field(None, min_length=1)
    steps: list[Step] | None = Field(None, min_length=1)
    alternatives = (("keyframes", "steps"),)

    @model_validator(mode="after")
    def _check_order(self) -> "Script":
        times = [keyframe.time for keyframe in self.keyframes or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"the times of the keyframes must increase; they are {times}")
        return self

    def highest(self, drive: Drive) -> float:
        """The highest value that is asked for in a way to drive; minus infinity without any."""
        entries = [dict(entry)[drive.name] for entry in (*(self.keyframes or ()), *(self.steps or ()))]
        numbers = [
            list(value.values()) if isinstance(value, dict) else [value] for value in entries if value is not None
        ]
        return max(itertools.chain(*numbers), default=-math.inf)


ScriptKind = TypeVar("ScriptKind", bound=Script)


def read_script(path: Path, kind: type[ScriptKind]) -> ScriptKind:
    """Read a TOML or CSV file as a kind of script."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        tables = read_keyframes(text) if path.suffix.lower() == ".csv" else parse_toml(text)
        return kind.model_validate(tables)
    except ValidationError as error:
        raise SceneError(f"{path}: {first_problem(error, kind)}") from error
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: not readable as {path.suffix[1:].upper() or 'TOML'}: {error}") from error
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error
