"""A step of a script in progress: the quantities and conditions that it reads, its motion, and its wait."""

import ast
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taichisoft.base import COMPARISONS, ExpressionError, evaluate, parse, shown
from taichisoft.control import Observation
from taichisoft.errors import ControllerFailed, SceneError, nearest
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorFigure, ActuatorKind
from taichisoft_controllers.model_names import actuators_called, called, fingers_called, object_called, pairs_called
from taichisoft_controllers.script_targets import Way

if TYPE_CHECKING:
    from taichisoft.contact import Model

# The language of conditions: "contact_force > 60 and lift < 1", read without executing any of it.
#
#     condition  = comparison | condition "and" condition | condition "or" condition | "not" condition
#     comparison = number ("<" | "<=" | ">" | ">=" | "==" | "!=") number, also in chains: 20 < pressure < 50
#     number     = 60 | 1.5e3 | quantity | quantity["key"] | number (+ - * /) number | -number
#                | abs, min, max of numbers
#
# and parentheses: less than `taichisoft.base.expressions` evaluates, and each part known to be a truth or a number
# beforehand.

FUNCTIONS = ("abs", "min", "max")


@dataclass(frozen=True)
class Quantity:
    """Something that can be measured, as a condition names it: pressure["finger1"]."""

    name: str
    key: str | None = None

    def __str__(self) -> str:
        return self.name if self.key is None else f'{self.name}["{self.key}"]'


Values = Mapping[Quantity, float]


@dataclass(frozen=True)
class Condition:
    """A condition that has been read.

    Attributes:
        quantities: all quantities that it names, each once.
    """

    quantities: tuple[Quantity, ...]
    _tree: ast.expr

    def holds(self, values: Values) -> bool:
        """Whether it is true for values of its quantities."""
        return bool(evaluate(self._tree, {str(quantity): value for quantity, value in values.items()}))


def read_condition(text: str, names: Sequence[str]) -> Condition:
    """Understand a condition about quantities of the given names."""
    if not text.strip():
        raise SceneError("is empty; an example of a condition is: contact_force > 60")
    try:
        tree = parse(text)
    except ExpressionError as error:
        raise SceneError(str(error)) from error
    reader = _Reader(text, names)
    reader.check_truth(tree)
    if not reader.quantities:
        raise SceneError("names no quantity, so that it never changes: there is nothing to wait for")
    return Condition(tuple(dict.fromkeys(reader.quantities)), _Named().visit(tree))


class _Named(ast.NodeTransformer):
    """Makes a name of every quantity with a key: its text, by which `Condition.holds` knows its value."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.Name:
        match node:
            case ast.Subscript(ast.Name(name), ast.Constant(str(key))):
                return ast.Name(str(Quantity(name, key)), ast.Load())
        raise AssertionError("the reader has checked it")


class _Reader:
    """Checks that each part of a condition is in the language, and gives the truth or the number that is needed there.

    Attributes:
        quantities: all that were named so far.
    """

    def __init__(self, text: str, names: Sequence[str]):
        self.quantities: list[Quantity] = []
        self._text = text
        self._names = list(names)

    def check_truth(self, node: ast.expr) -> None:
        """Check a part that is true or false."""
        match node:
            case ast.BoolOp(_, parts):
                for part in parts:
                    self.check_truth(part)
            case ast.UnaryOp(ast.Not(), operand):
                self.check_truth(operand)
            case ast.Compare(left, signs, others):
                for sign in signs:
                    self._require(type(sign) in COMPARISONS, node, "compare with < <= > >= == or !=")
                for term in (left, *others):
                    self.check_number(term)
            case ast.Constant(bool()):
                raise SceneError(f"{self._show(node)} never changes: there is nothing to wait for")
            case _:
                self.check_number(node)  # raises first: an unknown name is worse than a forgotten comparison
                raise SceneError(f"{self._show(node)} is a number; compare it with something, as in contact_force > 60")

    def check_number(self, node: ast.expr) -> None:
        """Check a part that is a number."""
        match node:
            case ast.Constant(int() | float() as value) if not isinstance(value, bool):
                self._require(_is_finite(value), node, "a number must be finite")
            case ast.Name(name):
                self._note(name, None)
            case ast.Subscript(ast.Name(name), ast.Constant(str(key))):
                self._note(name, key)
            case ast.Subscript(ast.Name(name)):
                raise SceneError(f'{self._show(node)}: what stands in brackets is a name in quotes: {name}["..."]')
            case ast.UnaryOp(ast.USub() | ast.UAdd(), operand):
                self.check_number(operand)
            case ast.BinOp(left, sign, right):
                allowed = isinstance(sign, ast.Add | ast.Sub | ast.Mult | ast.Div)
                self._require(allowed, node, "calculate with + - * and /")
                self.check_number(left)
                self.check_number(right)
            case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS:
                one = name == "abs"
                enough = len(arguments) == 1 if one else len(arguments) >= 2
                self._require(enough, node, f"{name} takes {'one number' if one else 'two numbers or more'}")
                for argument in arguments:
                    self.check_number(argument)
            case ast.Call(ast.Name(name)) if name not in FUNCTIONS:
                raise SceneError(f"no function is called '{name}'; {nearest(name, FUNCTIONS, 'there are')}")
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(ast.Not()):
                raise SceneError(f"{self._show(node)} is true or false; a number is needed here")
            case _:
                raise SceneError(
                    f"{self._show(node)} has no place in a condition; it may have comparisons, and, or, not, + - * /, "
                    f"{', '.join(FUNCTIONS)}, numbers and quantities"
                )

    def _note(self, name: str, key: str | None) -> None:
        if name in FUNCTIONS:
            raise SceneError(f"{name} is a function: {name}(...)")
        if name not in self._names:
            raise SceneError(f"no quantity is called '{name}'; {nearest(name, self._names, 'there are')}")
        self.quantities.append(Quantity(name, key))

    def _require(self, fulfilled: bool, node: ast.expr, rule: str) -> None:
        if not fulfilled:
            raise SceneError(f"{self._show(node)}: {rule}")

    def _show(self, node: ast.expr) -> str:
        return repr(shown(node, self._text))


def _is_finite(value: float) -> bool:
    """Whether a number has a finite value; whole numbers may be too large for one."""
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


# The quantities that a condition can name: units, meanings, and how each is taken from an observation.

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
    """The function that reads a quantity while a model runs."""
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


# A step of a script that goes on: its way, the condition that it waits for, its rest.

ROUND_OFF = 1e-9
"""Times this close are the same [s]: times of observations are sums of time steps."""


class Waiting:
    """A condition and how long it may take to become true."""

    def __init__(self, text: str, timeout: float, where: str):
        """Read the condition.

        Args:
            text: the condition.
            timeout: time after which the run fails [s].
            where: the beginning of every error, which says where the condition stands.
        """
        self._timeout = timeout
        self._key = f"{where}: until = {text!r}"
        try:
            self._condition = read_condition(text, list(QUANTITIES))
        except SceneError as error:
            raise SceneError(f"{self._key}: {error}") from error
        self._readings: dict[Quantity, Reading] = {}

    def reset(self, model: "Model") -> None:
        """Find in a model what the condition names."""
        try:
            self._readings = {quantity: bind_quantity(quantity, model) for quantity in self._condition.quantities}
        except SceneError as error:
            raise SceneError(f"{self._key}: {error}") from error

    def is_over(self, observation: Observation, elapsed: float) -> bool:
        """Whether the condition is true, `elapsed` [s] after the waiting began."""
        values = {quantity: read(observation, elapsed) for quantity, read in self._readings.items()}
        try:
            if self._condition.holds(values):
                return True
        except ZeroDivisionError as error:
            raise ControllerFailed(
                f"{self._key} divides by zero at {observation.time:g} s: {_listed(values)}; "
                "ask first, as in: contact_force > 1 and friction_force / contact_force < 0.5"
            ) from error
        if elapsed >= self._timeout:
            raise ControllerFailed(
                f"{self._key} was not true within {self._timeout:g} s; at {observation.time:g} s: {_listed(values)}"
            )
        return False


def _listed(values: Values) -> str:
    return ", ".join(
        f"{quantity} = {value:.4g} {QUANTITIES[quantity.name].unit}".removesuffix(" 1")
        for quantity, value in values.items()
    )


class StepInProgress:
    """Goes along its way until it is done or the condition is true, then rests for `hold`.

    Attributes:
        begun: time at which the step began [s].
        values: what is asked for now, shape (value_count,).
    """

    def __init__(self, begun: float, way: Way, waiting: Waiting | None, hold: float):
        self.begun = begun
        self.values = way.start
        self._way, self._waiting, self._hold = way, waiting, hold
        self._rest_begun: float | None = None if waiting is not None else way.length

    def save(self) -> dict[str, Any]:
        """Where it is on its way; numbers of all values, in the order of the script's targets."""
        return {
            "begun": self.begun,
            "values": self.values.tolist(),
            "start": self._way.start.tolist(),
            "rest_begun": self._rest_begun,
        }

    @classmethod
    def restored(cls, saved: Mapping[str, Any], way: Way, waiting: Waiting | None, hold: float) -> Self:
        """The step that `save` described, with its way, what it waits for, and how long it then rests [s]."""
        step = cls(saved["begun"], way, waiting, hold)
        step.values, step._rest_begun = np.array(saved["values"]), saved["rest_begun"]
        return step

    def advance(self, observation: Observation, reached: np.ndarray) -> float | None:
        """Bring `values` to the observation's time.

        Args:
            observation: what is seen now.
            reached: what the scene's limits have left of `values` so far, shape (value_count,).

        Returns:
            The time at which the step ended [s], or None while it goes on.
        """
        elapsed = max(0.0, observation.time - self.begun)
        if self._waiting is None:
            self.values = self._way.at(elapsed) if elapsed + ROUND_OFF < self._way.length else self._way.target
        elif self._rest_begun is None and self._waiting.is_over(observation, elapsed + ROUND_OFF):
            self._rest_begun, self.values = elapsed, reached
        elif self._rest_begun is None:
            self.values = self._way.at(elapsed)
        if self._rest_begun is None or elapsed + ROUND_OFF < self._rest_begun + self._hold:
            return None
        return self.begun + self._rest_begun + self._hold
