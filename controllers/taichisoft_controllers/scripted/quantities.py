"""The quantities that a condition can name: units, meanings, and how each is taken from an observation."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorFigure, ActuatorKind
from taichisoft.control import Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import actuators_called, called, fingers_called, object_called, pairs_called
from taichisoft_controllers.scripted.condition import Quantity

if TYPE_CHECKING:
    from taichisoft.model import Model

Reading = Callable[[Observation, float], float]
"""A function of an observation and of the time since the script's step began [s], which gives a quantity's value."""
Bind = Callable[["Model", str | None], Reading]
Combine = Callable[[Sequence[float]], float]


@dataclass(frozen=True)
class QuantityKind:
    """A row of the table of quantities.

    Attributes:
        unit: unit of its values.
        meaning: the meaning of the name without brackets.
        bind: makes the reading for a key, or for None, of a model; raises SceneError when the key does not fit.
        key: what may stand in brackets, to have one of several; empty when nothing may.
    """

    unit: str
    meaning: str
    bind: Bind
    key: str = ""


def bind_quantity(quantity: Quantity, model: "Model") -> Reading:
    """The function that reads a quantity while a model runs.

    Raises:
        SceneError: the model does not have the key in the brackets, or has nothing of the kind.
    """
    kind = QUANTITIES[quantity.name]
    if quantity.key is not None and not kind.key:
        raise SceneError(f"{quantity}: nothing can stand in brackets behind {quantity.name}")
    try:
        return kind.bind(model, quantity.key)
    except SceneError as error:
        raise SceneError(f"{quantity}: {error}") from error


def _actuators(kind: ActuatorKind, figure: ActuatorFigure) -> QuantityKind:
    """The row of a figure of actuators."""
    combine = sum if figure.total else _mean

    def bind(model: "Model", key: str | None) -> Reading:
        chosen = actuators_called(key, model.actuators.names_of(kind), kind.name)
        return lambda seen, elapsed: combine([getattr(seen, figure.observed)[name] for name in chosen])

    return QuantityKind(figure.unit, figure.meaning, bind, f"finger or {kind.name}")


def _fingers(measure: Callable[[Observation, str], float], combine: Combine) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        chosen = fingers_called(key, model)
        return lambda seen, elapsed: combine([measure(seen, name) for name in chosen])

    return bind


def _pairs(values: str, combine: Combine) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        chosen = pairs_called(key, model)
        # Bodies that are far apart are not in an observation: nothing presses.
        return lambda seen, elapsed: combine([getattr(seen, values).get(pair, 0.0) for pair in chosen])

    return bind


def _base(values: str, factor: float) -> Bind:
    """A vector of the base: its length, or one of its coordinates."""

    def bind(model: "Model", key: str | None) -> Reading:
        if key is None:
            return lambda seen, elapsed: factor * float(np.linalg.norm(getattr(seen, values)))
        axis = "xyz".index(called(key, ["x", "y", "z"], "axis")[0])
        return lambda seen, elapsed: factor * float(getattr(seen, values)[axis])

    return bind


def _frame(values: str, factor: float = 1.0) -> Bind:
    """Of frames beside the base, or of those with a hinge: a number with its sign, or the length of a vector."""
    of_hinges = values in ("frame_angles", "frame_moments")

    def bind(model: "Model", key: str | None) -> Reading:
        frames = model.scene.frames.items()
        chosen = called(key, [name for name, one in frames if not of_hinges or one.hinge is not None], "frame")

        def read(seen: Observation, elapsed: float) -> float:
            found = [getattr(seen, values)[name] for name in chosen]
            return factor * float(max(found if of_hinges else map(np.linalg.norm, found), key=abs))

        return read

    return bind


def _height(model: "Model", key: str | None) -> Reading:
    name, up = object_called(key, model), model.scene.up
    return lambda seen, elapsed: float(seen.object_positions[name] @ up)


def _lift(model: "Model", key: str | None) -> Reading:
    name, height = object_called(key, model), _height(model, key)
    (start,) = (float(body.start_position @ model.scene.up) for body in model.rigid_bodies if body.name == name)
    return lambda seen, elapsed: height(seen, elapsed) - start


def _speed(model: "Model", key: str | None) -> Reading:
    name = object_called(key, model)
    return lambda seen, elapsed: float(np.linalg.norm(seen.object_velocities[name]))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _bending_angle(seen: Observation, finger: str) -> float:
    return math.degrees(seen.bending_angles[finger])


def _tip_speed(seen: Observation, finger: str) -> float:
    return float(np.linalg.norm(seen.tip_velocities[finger]))


ON_OBJECT = "of the soft bodies on the object"
FINGER, OBJECT, PAIR, AXIS, FRAME = "finger", "rigid body", "pair of bodies", "x, y or z", "frame"

QUANTITIES: Mapping[str, QuantityKind] = {
    "time": QuantityKind("s", "time since the run began", lambda model, key: lambda seen, elapsed: seen.time),
    "elapsed": QuantityKind(
        "s", "time since this step of the script began", lambda model, key: lambda seen, elapsed: elapsed
    ),
    "contact_force": QuantityKind("mN", f"sum of the normal forces {ON_OBJECT}", _pairs("normal_forces", sum), PAIR),
    "normal_force": QuantityKind("mN", "another name of `contact_force`", _pairs("normal_forces", sum), PAIR),
    "friction_force": QuantityKind(
        "mN", f"sum of the amounts of friction {ON_OBJECT}", _pairs("friction_forces", sum), PAIR
    ),
    "slip_speed": QuantityKind("mm/s", f"fastest sliding {ON_OBJECT}", _pairs("slip_speeds", max), PAIR),
    "contact_count": QuantityKind("1", f"number of pressing contacts {ON_OBJECT}", _pairs("contact_counts", sum), PAIR),
    **{
        figure.name: _actuators(kind, figure)
        for kind in ACTUATOR_KINDS
        for figure in (*kind.drives, kind.value, kind.rate, *kind.figures)
        if figure is not None
    },
    "bending_angle": QuantityKind(
        "degrees", "turn of the tip against the base, mean of all fingers", _fingers(_bending_angle, _mean), FINGER
    ),
    "tip_speed": QuantityKind("mm/s", "speed of the fastest fingertip", _fingers(_tip_speed, max), FINGER),
    "height": QuantityKind("mm", "coordinate of the object's centre of mass, upwards", _height, OBJECT),
    "lift": QuantityKind("mm", "height of the object over its height at the start", _lift, OBJECT),
    "speed": QuantityKind("mm/s", "speed of the object's centre of mass", _speed, OBJECT),
    "base_translation": QuantityKind("mm", "distance of the base from its rest", _base("base_translation", 1.0), AXIS),
    "base_force": QuantityKind("mN", "force on the base, its amount", _base("base_force", 1.0), AXIS),
    "base_torque": QuantityKind(
        "mN mm", "torque on the base about its pivot, its amount", _base("base_torque", 1.0), AXIS
    ),
    "frame_translation": QuantityKind(
        "mm", "distance of the farthest frame from its rest", _frame("frame_translations"), FRAME
    ),
    "frame_force": QuantityKind("mN", "largest force on a frame, its amount", _frame("frame_forces"), FRAME),
    "frame_torque": QuantityKind("mN mm", "largest torque on a frame about its pivot", _frame("frame_torques"), FRAME),
    "frame_angle": QuantityKind(
        "degrees", "largest angle of a hinge", _frame("frame_angles", math.degrees(1.0)), FRAME
    ),
    "frame_moment": QuantityKind("mN mm", "largest moment about a hinge", _frame("frame_moments"), FRAME),
    "base_rotation": QuantityKind(
        "degrees", "angle of the base's turn", _base("base_rotation", math.degrees(1.0)), AXIS
    ),
}
"""Quantities by name. "The object" is that of the goal; without a goal it is all rigid bodies, or the only one."""
