"""Kinds of values of data: conversion from text, numbers and lists."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Valid ranges of the numbers of data.


@dataclass(frozen=True)
class Bounds:
    """A range of numbers.

    Attributes:
        lowest: smallest number.
        highest: largest number.
        ends: whether `lowest` and `highest` themselves are valid.
        infinite: whether infinity is valid, for no limit.
    """

    lowest: float = -np.inf
    highest: float = np.inf
    ends: bool = True
    infinite: bool = False

    def problem(self, value: Any) -> str:
        """Error in a number or an array of numbers, with the valid range; "" if valid."""
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "fiu" or not numbers.size:
            return ""
        within = (numbers >= self.lowest) & (numbers <= self.highest)
        if not self.ends:
            within &= (numbers != self.lowest) & (numbers != self.highest)
        if not self.infinite:
            within &= np.isfinite(numbers)
        return "" if within.all() else f"{numbers[~within].flat[0]:g} must be {self._valid()}"

    def _valid(self) -> str:
        low, high = np.isfinite([self.lowest, self.highest])
        if low and high:
            return (
                f"{'from' if self.ends else 'between'} {self.lowest:g} {'to' if self.ends else 'and'} {self.highest:g}"
            )
        if low:
            return f"{self.lowest:g} or more" if self.ends else f"above {self.lowest:g}"
        return "a number" if self.infinite else "a finite number"


FINITE = Bounds()
FROM_0 = Bounds(0.0)
ABOVE_0 = Bounds(0.0, ends=False)
LIMIT = Bounds(infinite=True)
LIMIT_FROM_0 = Bounds(0.0, infinite=True)
RATIO = Bounds(-1.0, 0.5, ends=False)
"""Poisson's ratios."""


TRUE = {"true", "t", "yes", "1"}
FALSE = {"false", "f", "no", "0"}
LARGEST_INTEGER = 2**53
"""Larger integers are not distinct as floating-point numbers."""


POINT, POSE = 3, 7
"""Numbers of a point and of a frame's pose."""


class WrongValue(ValueError):
    """A value is not of its data's kind; the message has the value and what would be valid."""


@dataclass(frozen=True)
class ValueKind:
    """A kind of value.

    Attributes:
        name: name in error messages.
        convert: converts a value written by a scene; raises WrongValue.
        empty: makes the value of a data without a written value.
        row: numbers per row of the list that the older generation returns for such a value; 0: not a list there.
    """

    name: str
    convert: Callable[[Any], Any]
    empty: Callable[[], Any]
    row: int = 0


# The kind of a data may depend on other data of its component, such as a template.
KindOf = ValueKind | Callable[[Any], ValueKind]


@dataclass(frozen=True)
class Declared:
    """Declaration of a data of a type of component.

    Attributes:
        kind: kind of the values.
        default: value without a written one; None: the kind's.
        bounds: range of valid numbers; unlimited for data added by a scene.
        unused: whether the data affects the motion of bodies in SOFA, but not here.
        live: whether a run reads it in every step, so that a scene's controllers may change it.
        compute: makes the value of other data of the component, unless a controller writes it.
    """

    kind: KindOf
    default: Any = None
    bounds: Bounds | None = FINITE
    unused: bool = False
    live: bool = False
    compute: Callable[[Any], Any] | None = None


ALIASES = {
    **dict.fromkeys(("EulerImplicit", "EulerImplicitIntegrationScheme"), "EulerImplicitSolver"),
    "StaticIntegrationScheme": "StaticSolver",
    "CollisionResponse": "RuleBasedContactManager",
    "DefaultContactManager": "RuleBasedContactManager",
    "DefaultPipeline": "CollisionPipeline",
    "FixedConstraint": "FixedProjectiveConstraint",
    "PartialFixedConstraint": "PartialFixedProjectiveConstraint",
    "GenericConstraintSolver": "BlockGaussSeidelConstraintSolver",
    "FreeMotionMasterSolver": "FreeMotionAnimationLoop",
    "LinearMovementConstraint": "LinearMovementProjectiveConstraint",
    "RegularGrid": "RegularGridTopology",
    "SparseGrid": "SparseGridTopology",
    "HexahedralFEMForceField": "HexahedronFEMForceField",
    "RigidRigidMapping": "RigidMapping",
    "Mesh": "MeshTopology",
    "MeshObjLoader": "MeshOBJLoader",
    **{
        f"{shape}{ending}": f"{shape}CollisionModel"
        for shape in ("Sphere", "Triangle", "Line", "Point")
        for ending in ("", "Model", "Set")
    },
}
"""Present names of types of components, by those of older versions of SOFA."""


def canonical(type_name: str) -> str:
    """Present name of a type of component, given any of its names."""
    return ALIASES.get(type_name, type_name)


def numbers(value: Any, dtype: type = float, bools: bool = False) -> NDArray[Any]:
    """Numbers of a text, a number, or a nested list of these, shape (n,).

    Args:
        value: value written by a scene.
        dtype: type of the numbers: float or int.
        bools: whether true and false are valid.
    """
    if isinstance(value, str):
        return np.array([_number(word, dtype, bools) for word in value.split()], dtype)
    try:
        found = np.asarray(value)
    except ValueError:  # lists of different lengths
        found = np.empty(0, object)
    if found.dtype.kind in ("fiub" if bools else "fiu"):
        if dtype is int and np.any(broken := (found != np.floor(found)) | (np.abs(found) > LARGEST_INTEGER)):
            raise WrongValue(f"{found[broken].flat[0]:g} is not an integer")
        return np.array(found, dtype).ravel()
    if isinstance(value, list | tuple | np.ndarray):
        parts = [numbers(item, dtype, bools) for item in value]
        return np.concatenate(parts) if parts else np.empty(0, dtype)
    if hasattr(type(value), "array"):
        return numbers(value.array(), dtype, bools)
    raise WrongValue(f"{value!r} is not a number")


def _number(word: str, dtype: type, bools: bool) -> float:
    if bools and word.lower() in ("true", "false"):
        return float(word.lower() == "true")
    try:
        number = float(word)
    except ValueError:
        raise WrongValue(f"'{word}' is not a number") from None
    if dtype is int and not (number.is_integer() and abs(number) <= LARGEST_INTEGER):
        raise WrongValue(f"'{word}' is not an integer")
    return number


def _indices(value: Any) -> NDArray[Any]:
    """Indices, shape (n,); a text may have ranges such as 3-7."""
    if isinstance(value, str) and "-" in value:
        found: list[int] = []
        for word in value.split():
            ends = re.fullmatch(r"(\d+)-(\d+)", word)
            found += range(int(ends[1]), int(ends[2]) + 1) if ends else [int(_number(word, int, False))]
        return np.array(found, int)
    return numbers(value, int)


def _one(value: Any, dtype: type) -> Any:
    found = numbers(value, dtype)
    if len(found) != 1:
        raise WrongValue(f"{value!r} must be a single number")
    return dtype(found[0])


def _bool(value: Any) -> bool:
    if isinstance(value, str):
        if value.strip().lower() not in TRUE | FALSE:
            raise WrongValue(f"'{value}' must be true or false")
        return value.strip().lower() in TRUE
    found = _bools(value)
    if len(found) != 1:
        raise WrongValue(f"{value!r} must be true or false")
    return bool(found[0])


def _bools(value: Any) -> NDArray[Any]:
    found = numbers(value, bools=True)
    if not np.isin(found, (0.0, 1.0)).all():
        raise WrongValue(f"{value!r} must be true or false each")
    return found.astype(bool)


def _text(value: Any) -> str:
    if isinstance(value, list | tuple | np.ndarray):
        return " ".join(_text(item) for item in value)
    return value if isinstance(value, str) else str(value)


def _texts(value: Any) -> list[str]:
    return value.split() if isinstance(value, str) else [str(item) for item in value]


def _rows(value: Any, width: int, dtype: type) -> NDArray[Any]:
    if width == POINT and isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == POSE:
        value = value[:, :POINT]  # of frames whose poses are linked where points are needed, the origins
    found = _indices(value) if dtype is int else numbers(value, dtype)
    if len(found) % width:
        raise WrongValue(f"{len(found)} numbers are not rows of {width}")
    return found.reshape(-1, width)


def _exactly(value: Any, count: int) -> NDArray[Any]:
    found = numbers(value)
    if (len(found), count) == (3, 4):  # a colour without its opacity
        return np.append(found, 1.0)
    if len(found) != count:
        raise WrongValue(f"has {len(found)} numbers; {count} are needed")
    return found


SCALAR = ValueKind("a number", lambda value: _one(value, float), lambda: 0.0)
INTEGER = ValueKind("an integer", lambda value: _one(value, int), lambda: 0)
BOOL = ValueKind("true or false", _bool, lambda: False)
TEXT = ValueKind("a text", _text, lambda: "")
TEXTS = ValueKind("texts", _texts, list)
# A vector of any length: shape (n,).
VECTOR = ValueKind("numbers", numbers, lambda: np.empty(0), 1)
BOOLS = ValueKind("true or false each", _bools, lambda: np.empty(0, bool), 1)
INDICES = ValueKind("indices", _indices, lambda: np.empty(0, int), 1)
# Any value.
ANY = ValueKind("anything", lambda value: value, lambda: None)
# The path of another component, which is not resolved when the data is read.
LINK = ValueKind("a link", _text, lambda: "")


@cache
def fixed(count: int) -> ValueKind:
    """A vector of exactly `count` numbers: shape (count,)."""
    return ValueKind(f"{count} numbers", lambda value: _exactly(value, count), lambda: np.zeros(count), count)


@cache
def vectors(width: int) -> ValueKind:
    """Any number of vectors of `width` numbers, such as positions: shape (n, width)."""
    return ValueKind(f"rows of {width}", lambda value: _rows(value, width, float), lambda: np.empty((0, width)), width)


@cache
def index_rows(width: int) -> ValueKind:
    """Any number of rows of `width` indices, such as triangles: shape (n, width)."""
    return ValueKind(
        f"rows of {width} indices", lambda value: _rows(value, width, int), lambda: np.empty((0, width), int), width
    )


SINGLE = {
    **dict.fromkeys(("double", "float", "Real", "SReal"), SCALAR),
    **dict.fromkeys(("int", "unsigned int", "Index", "long", "size_t"), INTEGER),
    **dict.fromkeys(("bool", "boolean"), BOOL),
    **dict.fromkeys(("string", "str", "filename", "DataFileName"), TEXT),
    **dict.fromkeys(("Link", "link"), LINK),
    **dict.fromkeys(("Quat", "Quatd", "Quatf", "RGBAColor"), fixed(4)),
    **dict.fromkeys(("Rigid3", "Rigid3d", "Rigid3::Coord", "Rigid3d::Coord", "RigidCoord"), fixed(7)),
}


def kind_called(type_name: str) -> ValueKind:
    """Kind of a data by SOFA's name of the type: `double`, `Vec3d`, `vector<Vec3d>`, `string`."""
    if type_name in SINGLE:
        return SINGLE[type_name]
    if width := re.fullmatch(r"Vec(\d+)[dfiu]?", type_name):
        return fixed(int(width[1]))
    if inner := re.fullmatch(r"(?:std::)?vector<\s*(.+?)\s*>", type_name):
        kind = kind_called(inner[1])
        listed = {SCALAR: VECTOR, INTEGER: INDICES, BOOL: BOOLS, TEXT: TEXTS}
        return listed.get(kind) or (vectors(kind.row) if kind.row else ANY)
    return ANY
