"""What the conditions of a script can ask about: names, units, and how each is taken from an observation."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import called, cavities_called, fingers_called, object_called, pairs_called
from taichisoft_controllers.scripted.condition_reader import Quantity

if TYPE_CHECKING:
    from taichisoft.model import Model


@dataclass(frozen=True)
class Moment:
    """When a condition is looked at.

    Attributes:
        observation: what the controller sees.
        elapsed: since the script's step began [s].
    """

    observation: Observation
    elapsed: float


Reading = Callable[[Moment], float]
Bind = Callable[["Model", str | None], Reading]
Combine = Callable[[Sequence[float]], float]


@dataclass(frozen=True)
class QuantityKind:
    """A row of the table of quantities.

    Attributes:
        unit: of its values.
        meaning: what it is when nothing stands in brackets behind it.
        key: what may stand in brackets, to have one of several; empty when nothing may.
        bind: makes the reading for a key, or for None, of a model; raises SceneError when the key does not fit.
    """

    unit: str
    meaning: str
    key: str
    bind: Bind


def bind_quantity(quantity: Quantity, model: "Model") -> Reading:
    """How to read a quantity while a model runs.

    Raises:
        SceneError: the key in its brackets is none of the model's, or the model has nothing of the kind.
    """
    kind = QUANTITIES[quantity.name]
    if quantity.key is not None and not kind.key:
        raise SceneError(f"{quantity}: nothing can stand in brackets behind {quantity.name}")
    try:
        return kind.bind(model, quantity.key)
    except SceneError as error:
        raise SceneError(f"{quantity}: {error}") from error


def _of_cavities(values: str, combine: Combine) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        chosen = cavities_called(key, model.cavities.names)
        return lambda moment: combine([getattr(moment.observation, values)[name] for name in chosen])

    return bind


def _of_fingers(measure: Callable[[Observation, str], float], combine: Combine) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        chosen = fingers_called(key, model)
        return lambda moment: combine([measure(moment.observation, name) for name in chosen])

    return bind


def _of_pairs(values: str, combine: Combine) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        chosen = pairs_called(key, model)
        # Bodies that are far apart are not in an observation: nothing presses.
        return lambda moment: combine([getattr(moment.observation, values).get(pair, 0.0) for pair in chosen])

    return bind


def _of_base(values: str, factor: float) -> Bind:
    def bind(model: "Model", key: str | None) -> Reading:
        if key is None:
            return lambda moment: factor * float(np.linalg.norm(getattr(moment.observation, values)))
        axis = "xyz".index(called(key, ["x", "y", "z"], "axis")[0])
        return lambda moment: factor * float(getattr(moment.observation, values)[axis])

    return bind


def _height(model: "Model", key: str | None) -> Reading:
    name = object_called(key, model)
    size = float(np.linalg.norm(model.gravity))
    up = -model.gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    return lambda moment: float(moment.observation.object_positions[name] @ up)


def _lift(model: "Model", key: str | None) -> Reading:
    height = _height(model, key)
    position = {body.name: body.start_position for body in model.rigid_bodies}
    start = height(Moment(Observation(0.0, 0, object_positions=position), 0.0))
    return lambda moment: height(moment) - start


def _speed(model: "Model", key: str | None) -> Reading:
    name = object_called(key, model)
    return lambda moment: float(np.linalg.norm(moment.observation.object_velocities[name]))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _bending_angle(observation: Observation, finger: str) -> float:
    return math.degrees(observation.bending_angles[finger])


def _tip_speed(observation: Observation, finger: str) -> float:
    return float(np.linalg.norm(observation.tip_velocities[finger]))


def _kind(unit: str, meaning: str, bind: Bind, key: str = "") -> QuantityKind:
    return QuantityKind(unit, meaning, key, bind)


ON_OBJECT = "of the soft bodies on the object"
CAVITY, FINGER, OBJECT, PAIR, AXIS = "finger or cavity", "finger", "rigid body", "pair of bodies", "x, y or z"

QUANTITIES: Mapping[str, QuantityKind] = {
    "time": _kind("s", "since the run began", lambda model, key: lambda moment: moment.observation.time),
    "elapsed": _kind("s", "since this step of the script began", lambda model, key: lambda moment: moment.elapsed),
    "contact_force": _kind("mN", f"sum of the normal forces {ON_OBJECT}", _of_pairs("normal_forces", sum), PAIR),
    "normal_force": _kind("mN", "another name of `contact_force`", _of_pairs("normal_forces", sum), PAIR),
    "friction_force": _kind(
        "mN", f"sum of the amounts of friction {ON_OBJECT}", _of_pairs("friction_forces", sum), PAIR
    ),
    "slip_speed": _kind("mm/s", f"fastest sliding {ON_OBJECT}", _of_pairs("slip_speeds", max), PAIR),
    "contact_count": _kind("1", f"contacts that press, {ON_OBJECT}", _of_pairs("contact_counts", sum), PAIR),
    "pressure": _kind("kPa", "mean of all cavities", _of_cavities("pressures", _mean), CAVITY),
    "volume": _kind("mm^3", "sum of all cavities", _of_cavities("volumes", sum), CAVITY),
    "flow": _kind("mm^3/s", "growth of the volume, sum of all cavities", _of_cavities("flows", sum), CAVITY),
    "bending_angle": _kind(
        "degrees", "turn of the tip against the base, mean of all fingers", _of_fingers(_bending_angle, _mean), FINGER
    ),
    "tip_speed": _kind("mm/s", "of the fastest fingertip", _of_fingers(_tip_speed, max), FINGER),
    "height": _kind("mm", "coordinate of the object's centre of mass, upwards", _height, OBJECT),
    "lift": _kind("mm", "height of the object over its height at the start", _lift, OBJECT),
    "speed": _kind("mm/s", "of the object's centre of mass", _speed, OBJECT),
    "base_translation": _kind("mm", "distance of the base from its rest", _of_base("base_translation", 1.0), AXIS),
    "base_rotation": _kind(
        "degrees", "angle by which the base is turned", _of_base("base_rotation", math.degrees(1.0)), AXIS
    ),
}
"""By name. "The object" is the goal's; in a scene without a goal all rigid bodies together, or the only one."""
