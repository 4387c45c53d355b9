"""What kind of value a data has: how text, numbers and lists become it."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichisoft_sofa.tree.bounds import FINITE, Bounds

TRUE = {"true", "t", "yes", "1"}
FALSE = {"false", "f", "no", "0"}
LARGEST_INTEGER = 2**53
"""Floating-point numbers tell larger ones no longer apart."""


class WrongValue(ValueError):
    """A value is not of its data's kind; the text says what it is and what would be valid."""


@dataclass(frozen=True)
class Kind:
    """A kind of value.

    Attributes:
        name: what it is called in errors.
        convert: makes a value of this kind of what a scene wrote; raises WrongValue.
        empty: makes the value of a data that nothing was written to.
        row: how many numbers the older generation puts in a row of the list that it gives for such a value; 0: the
            value is no list there.
    """

    name: str
    convert: Callable[[Any], Any]
    empty: Callable[[], Any]
    row: int = 0


# The kind of a data may depend on other data of its component, such as a template.
KindOf = Kind | Callable[[Any], Kind]


@dataclass(frozen=True)
class Declared:
    """A data that a type of component has.

    Attributes:
        kind: its kind.
        default: its value while nothing was written to it; none: that of its kind.
        bounds: which numbers it may have; any where a scene adds the data itself.
        unused: whether it decides in SOFA how bodies move, and has no effect here.
    """

    kind: KindOf
    default: Any = None
    bounds: Bounds | None = FINITE
    unused: bool = False


# The data that each type of component has, by its name.
KINDS: dict[str, dict[str, Declared]] = {}
# Other names of a type: {"EulerImplicit": "EulerImplicitSolver"}.
ALIASES: dict[str, str] = {}


def declare(type_name: str, /, **data: "KindOf | tuple[Any, ...]") -> None:
    """Say which data a type of component has: `box=vectors(6)`; with a default, `youngModulus=(SCALAR, 5000)`.

    After the default may stand the bounds of its numbers: `youngModulus=(SCALAR, 5000, ABOVE_0)`.
    """
    known = KINDS.setdefault(canonical(type_name), {})
    for name, declared in data.items():
        known[name] = Declared(*declared) if isinstance(declared, tuple) else Declared(declared)


def declare_unused(type_name: str, /, **defaults: Any) -> None:
    """Say which data of a type decide in SOFA how bodies move and have no effect here, with SOFA's defaults."""
    known = KINDS.setdefault(canonical(type_name), {})
    for name, default in defaults.items():
        kind = {bool: BOOL, int: INTEGER, float: SCALAR, tuple: VECTOR}.get(type(default), TEXT)
        known[name] = Declared(kind, default, unused=True)


def declare_without_effect(type_name: str, names: str) -> None:
    """Say which other data a type has: how it is drawn, or how equations are solved. Any value of them is valid."""
    known = KINDS.setdefault(canonical(type_name), {})
    for name in names.split():
        known.setdefault(name, Declared(ANY))


def canonical(type_name: str) -> str:
    """The name under which a type of component is known, whichever of its names a scene uses."""
    return ALIASES.get(type_name, type_name)


def declared(type_name: str) -> Mapping[str, Declared]:
    """The data that a type of component is known to have; none for a type that nobody declared."""
    return KINDS.get(canonical(type_name), {})


def numbers(value: Any, dtype: type = float, bools: bool = False) -> NDArray[Any]:
    """The numbers of a text, a number, or a list of such, nested or not; shape (n,).

    Args:
        value: what a scene wrote.
        dtype: type of the numbers: float or int.
        bools: whether true and false are numbers, too.

    Raises:
        WrongValue: something in it is no number, or no integer.
    """
    if isinstance(value, str):
        return np.array([_number(word, dtype, bools) for word in value.split()], dtype)
    try:
        found = np.asarray(value)
    except ValueError:  # lists of different lengths
        found = np.empty(0, object)
    if found.dtype.kind in ("fiub" if bools else "fiu"):
        if dtype is int and np.any(broken := (found != np.floor(found)) | (np.abs(found) > LARGEST_INTEGER)):
            raise WrongValue(f"{found[broken].flat[0]:g} is no integer")
        return np.array(found, dtype).ravel()
    if isinstance(value, list | tuple | np.ndarray):
        parts = [numbers(item, dtype, bools) for item in value]
        return np.concatenate(parts) if parts else np.empty(0, dtype)
    if hasattr(value, "array"):
        return numbers(value.array(), dtype, bools)
    raise WrongValue(f"{value!r} is no number")


def _number(word: str, dtype: type, bools: bool) -> float:
    if bools and word.lower() in ("true", "false"):
        return float(word.lower() == "true")
    try:
        number = float(word)
    except ValueError:
        raise WrongValue(f"'{word}' is no number") from None
    if dtype is int and not (number.is_integer() and abs(number) <= LARGEST_INTEGER):
        raise WrongValue(f"'{word}' is no integer")
    return number


def _indices(value: Any) -> NDArray[Any]:
    """Indices, of which a text may give ranges such as 3-7; shape (n,)."""
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
    found = _indices(value) if dtype is int else numbers(value, dtype)
    if len(found) % width:
        raise WrongValue(f"{len(found)} numbers are no rows of {width}")
    return found.reshape(-1, width)


def _exactly(value: Any, count: int) -> NDArray[Any]:
    found = numbers(value)
    if (len(found), count) == (3, 4):  # a colour without its opacity
        return np.append(found, 1.0)
    if len(found) != count:
        raise WrongValue(f"has {len(found)} numbers; {count} are needed")
    return found


SCALAR = Kind("a number", lambda value: _one(value, float), lambda: 0.0)
INTEGER = Kind("an integer", lambda value: _one(value, int), lambda: 0)
BOOL = Kind("true or false", _bool, lambda: False)
TEXT = Kind("a text", _text, lambda: "")
TEXTS = Kind("texts", _texts, list)
# A vector of any length: shape (n,).
VECTOR = Kind("numbers", numbers, lambda: np.empty(0), 1)
BOOLS = Kind("true or false each", _bools, lambda: np.empty(0, bool), 1)
INDICES = Kind("indices", _indices, lambda: np.empty(0, int), 1)
# Whatever the scene wrote.
ANY = Kind("anything", lambda value: value, lambda: None)
# The path of another component, which is not followed when the data is read.
LINK = Kind("a link", _text, lambda: "")


@cache
def fixed(count: int) -> Kind:
    """A vector of exactly `count` numbers: shape (count,)."""
    return Kind(f"{count} numbers", lambda value: _exactly(value, count), lambda: np.zeros(count), count)


@cache
def vectors(width: int) -> Kind:
    """Any number of vectors of `width` numbers, such as positions: shape (n, width)."""
    return Kind(f"rows of {width}", lambda value: _rows(value, width, float), lambda: np.empty((0, width)), width)


@cache
def index_rows(width: int) -> Kind:
    """Any number of rows of `width` indices, such as triangles: shape (n, width)."""
    return Kind(
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


def kind_called(type_name: str) -> Kind:
    """The kind of a data whose type a scene names as SOFA does: `double`, `Vec3d`, `vector<Vec3d>`, `string`."""
    if type_name in SINGLE:
        return SINGLE[type_name]
    if width := re.fullmatch(r"Vec(\d+)[dfiu]?", type_name):
        return fixed(int(width[1]))
    if inner := re.fullmatch(r"(?:std::)?vector<\s*(.+?)\s*>", type_name):
        kind = kind_called(inner[1])
        listed = {SCALAR: VECTOR, INTEGER: INDICES, BOOL: BOOLS, TEXT: TEXTS}
        return listed.get(kind) or (vectors(kind.row) if kind.row else ANY)
    return ANY
