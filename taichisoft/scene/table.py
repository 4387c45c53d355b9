"""What every table of a scene has in common: kinds of values, and keys that are checked.

Units: millimetre, kilogram, second; so forces are in mN and pressures and moduli in kPa.
"""

import ast
import functools
import inspect
import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from operator import attrgetter
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Tag,
    ValidationError,
    model_validator,
)

from taichisoft.base.expressions import FUNCTIONS, evaluate, read_expression
from taichisoft.errors import nearest

# Errors of pydantic as one line for the user: key, value, and what would be valid.

LONGEST_VALUE = 80  # of a value that is shown: a line must stay readable when the value is a whole table


def first_problem(error: ValidationError, table: type[BaseModel], prefix: str = "") -> str:
    """One line for the first problem, and how many more there are.

    Args:
        error: error of checking data against `table`.
        table: table in which the valid keys are looked up.
        prefix: text before every key, for data that is itself part of something ("controller.settings").
    """
    problems = error.errors()
    # A misspelt key that must be there gives two problems, of which the unknown key is the cause.
    problem = min(problems, key=lambda candidate: candidate["type"] != "extra_forbidden")
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return _describe(problem, problems, table, prefix) + more


def _describe(problem: Any, problems: Sequence[Any], table: type[BaseModel], prefix: str) -> str:
    path = problem["loc"]
    # Where a key takes values of several kinds, pydantic names the kind; the tables give them names in brackets.
    location = tuple(part for part in path if not str(part).startswith("<"))
    named = location[:-1] if location[-1:] == ("[key]",) else location  # the entry, of whose name pydantic speaks
    key = ".".join([prefix] * bool(prefix) + [str(part) for part in named])
    value = f"{key} = {short_text(problem['input'])}"
    match problem["type"]:
        case "extra_forbidden":
            return f"{key}: unknown key; {nearest(str(location[-1]), _valid_keys(table, path[:-1]), 'valid keys')}"
        case "string_pattern_mismatch" if location[-1] == "[key]":  # pydantic's mark for the name of an entry
            name, table_key = problem["input"], ".".join(str(part) for part in location[:-2])
            if not name.isprintable():
                return f"{table_key} has a {name!r}: a name must not contain control characters"
            return f"{table_key} has a '{name}': a name must not be empty nor contain any of . | /"
        case "string_too_long" if location[-1] == "[key]":
            table_key, most = ".".join(str(part) for part in location[:-2]), problem["ctx"]["max_length"]
            return f"{table_key} has a '{problem['input'][:20]}...': a name must not be longer than {most} characters"
        case "literal_error" if location[-1:] == ("[key]",):
            valid = [part.strip("' ") for part in re.split(", | or ", problem["ctx"]["expected"])]
            return f"{key}: unknown name; {nearest(problem['input'], valid, 'valid names')}"
        case "missing" if isinstance(location[-1], int):  # the entries that a list of fixed length lacks
            absent = [other for other in problems if other["type"] == "missing" and other["loc"][:-1] == path[:-1]]
            given = len(problem["input"])
            parent = key.rpartition(".")[0]
            return f"{parent} = {short_text(problem['input'])}: has {given} values; {given + len(absent)} are needed"
        case "missing":
            return f"{key}: this key is missing"
        case "too_long" if "max_length" in problem["ctx"]:
            return f"{value}: has {problem['ctx']['actual_length']} values; {problem['ctx']['max_length']} are needed"
        case "too_short":
            return f"{value}: at least {problem['ctx']['min_length']} is needed"
        case "model_type" | "dict_type":
            in_list = any(isinstance(part, int) for part in location)
            return f"{value}: must be a table" + ("" if in_list else f", [{key}]")
        case "list_type" | "tuple_type":
            return f"{value}: must be a list"
        case "value_error":  # a rule of the table's own, mostly between several keys: the message names the values
            return f"{key + ': ' if key else ''}{problem['msg'].removeprefix('Value error, ')}"
        case _:
            return f"{value}: {problem['msg'][0].lower()}{problem['msg'][1:]}"


def short_text(value: Any) -> str:
    """A value as a line shows it."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


def _valid_keys(table: type[BaseModel], path: Sequence[Any]) -> list[str]:
    annotation: Any = table
    for part in path:
        annotation = _inside(annotation, part)
    holder = next((inner for inner in (annotation, *get_args(annotation)) if _is_table(inner)), None)
    return list(holder.model_fields) if holder is not None else []


def _inside(annotation: Any, part: Any) -> Any:
    """The type of a table's field or of any entry of a dictionary or list; None when there is none."""
    if _is_table(annotation):
        return annotation.model_fields[part].annotation if part in annotation.model_fields else None
    if any(isinstance(mark, Tag) and mark.tag == part for mark in getattr(annotation, "__metadata__", ())):
        return get_args(annotation)[0]
    if get_origin(annotation) in (dict, list):
        return get_args(annotation)[-1]
    return next((inside for inner in get_args(annotation) if (inside := _inside(inner, part)) is not None), None)


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


# Colours as scenes and options write them: "#rrggbb".


def red_green_blue(colour: str) -> tuple[float, float, float]:
    """Red, green and blue [-], each from 0 to 1, of a colour that is written "#rrggbb".

    Raises:
        ValueError: it is written otherwise; the message says how it must be.
    """
    if not isinstance(colour, str) or not re.fullmatch("#[0-9a-fA-F]{6}", colour):
        raise ValueError(f'{colour!r} must be written #rrggbb in hexadecimal digits, as "#c8321e"')
    red, green, blue = (byte / 255 for byte in bytes.fromhex(colour[1:]))
    return red, green, blue


def _checked(value: Any) -> Any:
    red_green_blue(value)
    return value


Colour = Annotated[str, BeforeValidator(_checked)]
"""A colour in a table of a scene."""


LARGEST, LONGEST, SMALLEST = 1e30, 1e9, 1e-18
"""What exceeds these is not a number of any robot in any unit, and would only be found out as a singular matrix."""
SHORTEST = 1e-9
"""Length below which a vector has no direction."""


def _not_vanishing(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"{value:g} must be {SMALLEST:g} or more")
    return value


def _has_direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*vector) < SHORTEST:
        raise ValueError(f"{list(vector)} has no direction; its length must not vanish")
    return vector


# Strict: no text and no truth value is taken for a number.
Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST), AfterValidator(_not_vanishing)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
PoissonRatio = Annotated[float, Field(strict=True, gt=-1, lt=0.5)]
Component = Annotated[float, Field(strict=True, ge=-LONGEST, le=LONGEST)]
Vector = tuple[Component, Component, Component]
Direction = Annotated[Vector, AfterValidator(_has_direction)]
Count = Annotated[int, Field(strict=True, ge=1, le=1000)]
NodeNumber = Annotated[int, Field(strict=True, ge=0)]
Groups = list[Annotated[int, Field(strict=True)]]
KeySets = tuple[tuple[str, ...], ...]
# Without the signs that join names: "finger.cavity" is a cavity, "finger|cube" a pair, "base/cube.h5" a path. Without
# control characters, which terminals obey and at which texts in files end.
Name = Annotated[str, Field(pattern=r"^[^.|/\x00-\x1f\x7f-\x9f]+$", max_length=200)]


class Rule(NamedTuple):
    """What must hold between the keys of a table.

    Attributes:
        condition: an expression (`base/expressions.py`) in keys and properties of the table, dotted for those of a
            table in it; where `of` is given also in `value`. It is not looked at while one of them is not given.
        message: what is wrong otherwise; expressions in braces are filled in, and `path` where `of` is given.
        of: keys of which the condition speaks, one for each, "*" for all entries: "soft_bodies.*.velocity".
    """

    condition: str
    message: str
    of: str = ""


def ordered(*quantities: str) -> tuple[Rule, ...]:
    """The lowest value of a quantity does not exceed the highest."""
    return tuple(
        Rule(
            f"lowest_{name} <= highest_{name}",
            f"lowest_{name} ({{lowest_{name}:g}}) must not exceed highest_{name} ({{highest_{name}:g}})",
        )
        for name in quantities
    )


class Table(BaseModel):
    """A table of a scene: unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)

    alternatives: ClassVar[KeySets] = ()
    """Sets of keys; exactly one key of each set must be given."""
    no_effect_beside: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that another one makes useless; they are no mistake at their defaults: a scene written out has them all."""
    own_keys: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that have an effect under a condition alone, such as 'kind == "placed"'."""
    needs: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys that must be given under a condition, or beside another key."""
    rules: ClassVar[Sequence[Rule]] = ()

    def is_given(self, key: str) -> bool:
        """Whether a key differs from its default."""
        return bool(getattr(self, key) != type(self).model_fields[key].default)

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for keys in self.alternatives:
            given = [key for key in keys if getattr(self, key) is not None]
            if len(given) != 1:
                raise ValueError(f"exactly one of {', '.join(keys)} is needed; given: {', '.join(given) or 'none'}")
        for chosen, keys in self.no_effect_beside.items():
            useless = [key for key in keys if self.is_given(key)]
            if useless and self.is_given(chosen):
                raise ValueError(f"{', '.join(useless)} would have no effect beside {chosen}; remove it")
        for condition, keys in self.needs.items():
            missing = [key for key in keys if not self.is_given(key)]
            if missing and self._computed(condition):
                raise ValueError(f"{condition.replace('==', '=')} needs the key {' and the key '.join(missing)}")
        for condition, keys in self.own_keys.items():
            useless = [key for key in keys if self.is_given(key)]
            if useless and not self._computed(condition):
                raise ValueError(
                    f"{', '.join(useless)} would have no effect unless {condition.replace('==', '=')}; remove it"
                )
        for rule in self.rules:
            for path, value in entries(self, rule.of) if rule.of else [("", True)]:
                self._check_rule(rule, {"path": path, "value": value})
        return self

    def _check_rule(self, rule: Rule, names: Mapping[str, Any]) -> None:
        holds = self._computed(rule.condition, names)
        if holds is not None and not holds:
            raise ValueError(
                IN_BRACES.sub(lambda part: format(self._computed(part[1], names), part[2] or ""), rule.message)
            )

    def _computed(self, text: str, names: Mapping[str, Any] = MappingProxyType({})) -> Any:
        """The value of an expression in `names` and the table's own; None where one of these is not given."""
        tree, keys = _read_condition(text)
        values = {key: names[key] if key in names else attrgetter(key.replace("__", "."))(self) for key in keys}
        return None if None in values.values() else evaluate(tree, values)


IN_BRACES = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")
DOT = re.compile(r"(?<=[a-z])\.(?=[a-z])")


@functools.cache
def _read_condition(text: str) -> tuple[ast.expr, tuple[str, ...]]:
    """An expression, and its names, with two underscores in the place of a dot."""
    tree = read_expression(DOT.sub("__", text))
    return tree, tuple(node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id not in FUNCTIONS)


def entries(table: Any, keys: str, path: str = "") -> Iterator[tuple[str, Any]]:
    """What is given at `keys`, "*" for all entries of a table or list, each with its path."""
    key, _, rest = keys.partition(".")
    members: Iterable[tuple[Any, Any]] = [(key, getattr(table, key, None))]
    if key == "*":
        members = table.items() if isinstance(table, Mapping) else enumerate(table)
    for name, value in members:
        place = f"{path}.{name}" if path else str(name)
        if value is not None:
            yield from entries(value, rest, place) if rest else [(place, value)]


def key_descriptions(table: type[BaseModel]) -> dict[str, str]:
    """Docstrings of a table's keys. Pydantic would read them from the source at every start, in a third of a second."""
    described = {key: field.description or "" for key, field in table.model_fields.items()}
    for kind in reversed(table.__mro__):
        with suppress(OSError, TypeError):  # a class without source
            (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            for key, docstring in pairwise(definition.body):  # type: ignore[attr-defined]
                match key, docstring:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                        described[name] = inspect.cleandoc(text)
    return {key: described[key] for key in table.model_fields}
