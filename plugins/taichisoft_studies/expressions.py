"""Arithmetic in a study's file, evaluated without Python's own evaluation.

An expression has numbers, names, places of tables (`table["key"]`), arithmetic, comparisons, `and`, `or`, `not`,
`A if B else C`, and the functions below. There are no builtins, attributes, assignments nor calls of anything else, so
that a study from a stranger can compute a wrong number but do nothing.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from taichisoft.errors import nearest
from taichisoft_studies.extras import StudyError

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "get": lambda table, key, otherwise: table.get(key, otherwise),
    "abs": abs,
    "min": min,
    "max": max,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "atan2": math.atan2,
    "hypot": math.hypot,
    "degrees": math.degrees,
    "radians": math.radians,
}
CONSTANTS = {"pi": math.pi}
BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: lambda base, exponent: math.pow(base, exponent),  # of floats: whole numbers could grow without end
}
COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
LONGEST, LONGEST_SHOWN = 1000, 60
CANNOT_BE_COMPUTED = (ArithmeticError, ValueError, TypeError, AttributeError, RecursionError)


class Expression:
    """An expression that has been read, and can be evaluated many times.

    Attributes:
        text: as it was written.
    """

    def __init__(self, text: str, key: str):
        """Read it; `key` is its place in the study, which begins every error.

        Raises:
            StudyError: it is none, or has a part that expressions do not have.
        """
        self.text, self._key = text, key
        if len(text) > LONGEST:
            raise StudyError(f"{key}: longer than {LONGEST} characters")
        try:
            self._tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise StudyError(f"{key} = {text!r}: is no expression: {error}") from error
        _refuse_others(self._tree, text.strip(), f"{key} = {text!r}")

    def __call__(self, names: Mapping[str, Any]) -> float:
        """Its value, with these values of names.

        Raises:
            StudyError: a name or entry is missing, or the value is no finite number.
        """
        where = f"{self._key} = {self.text!r}"
        try:
            value = _value(self._tree, names, where)
            number = float(value)
        except CANNOT_BE_COMPUTED as error:
            raise StudyError(f"{where}: {error}") from error
        if not math.isfinite(number):
            raise StudyError(f"{where}: is {number:g}, no finite number")
        return number

    def violation(self, names: Mapping[str, Any]) -> float:
        """By how much a comparison of two values is missed: not positive where it holds.

        Raises:
            StudyError: it is no comparison of two values by <=, <, >= or >; or as of a call.
        """
        where = f"{self._key} = {self.text!r}"
        tree = self._tree
        if not (
            isinstance(tree, ast.Compare)
            and len(tree.ops) == 1
            and isinstance(tree.ops[0], ast.Lt | ast.LtE | ast.Gt | ast.GtE)
        ):
            raise StudyError(f"{where}: must compare two values by <= or >=")
        try:
            left, right = (float(_value(side, names, where)) for side in (tree.left, tree.comparators[0]))
        except CANNOT_BE_COMPUTED as error:
            raise StudyError(f"{where}: {error}") from error
        if not (math.isfinite(left) and math.isfinite(right)):
            raise StudyError(f"{where}: compares {left:g} with {right:g}; both must be finite numbers")
        return left - right if isinstance(tree.ops[0], ast.Lt | ast.LtE) else right - left


def _refuse_others(tree: ast.AST, text: str, where: str) -> None:
    """Refuse every part of a text that `_value` does not know, before anything is evaluated."""
    known = (
        ast.Constant, ast.Name, ast.Load, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp,
        ast.Call, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or, *BINARY, *COMPARISONS,
    )  # fmt: skip
    for node in ast.walk(tree):
        if not isinstance(node, known):
            raise StudyError(f"{where}: expressions have no {type(node).__name__}")
        if isinstance(node, ast.Constant) and not isinstance(node.value, int | float | str):
            raise StudyError(f"{where}: expressions have no {node.value!r}")
        if isinstance(node, ast.Call) and (
            node.keywords or not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS
        ):
            called = " ".join((ast.get_source_segment(text, node.func) or text).split())
            shown = called if len(called) <= LONGEST_SHOWN else f"{called[:LONGEST_SHOWN]}..."
            raise StudyError(f"{where}: {shown}: unknown function; there are: {', '.join(FUNCTIONS)}")


def _value(node: ast.AST, names: Mapping[str, Any], where: str) -> Any:
    """The value of a part."""

    def inner(part: ast.AST) -> Any:
        return _value(part, names, where)

    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            if name in names:
                return names[name]
            if name in CONSTANTS:
                return CONSTANTS[name]
            raise StudyError(f"{where}: there is no '{name}'; {nearest(name, list(names), 'there are')}")
        case ast.Subscript(value=table, slice=place):
            return _entry(inner(table), inner(place), where)
        case ast.BinOp(left=left, op=sign, right=right):
            return BINARY[type(sign)](float(inner(left)), float(inner(right)))
        case ast.UnaryOp(op=sign, operand=operand):
            value = inner(operand)
            return not value if isinstance(sign, ast.Not) else -value if isinstance(sign, ast.USub) else value
        case ast.BoolOp(op=sign, values=parts):
            return (all if isinstance(sign, ast.And) else any)(inner(part) for part in parts)
        case ast.Compare(left=left, ops=signs, comparators=others):
            values = [inner(left), *map(inner, others)]
            return all(
                COMPARISONS[type(sign)](one, other) for one, sign, other in zip(values, signs, values[1:], strict=False)
            )
        case ast.IfExp(test=test, body=body, orelse=other):
            return inner(body) if inner(test) else inner(other)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name](*map(inner, arguments))
    raise StudyError(f"{where}: expressions have no {type(node).__name__}")


def _entry(table: Any, place: Any, where: str) -> Any:
    """An entry of a table by its name, or of a list by its index."""
    if isinstance(table, Mapping):
        if place in table:
            return table[place]
        raise StudyError(f"{where}: there is no {place!r}; {nearest(str(place), [*map(str, table)], 'there are')}")
    try:
        return table[int(place)]
    except (IndexError, TypeError, ValueError, KeyError) as error:
        raise StudyError(f"{where}: there is no entry {place!r}") from error
