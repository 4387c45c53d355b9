"""The language of conditions: "contact_force > 60 and lift < 1", read without executing any of it.

    condition  = comparison | condition "and" condition | condition "or" condition | "not" condition
    comparison = number ("<" | "<=" | ">" | ">=" | "==" | "!=") number, also in chains: 20 < pressure < 50
    number     = 60 | 1.5e3 | quantity | quantity["key"] | number (+ - * /) number | -number | abs, min, max of numbers

and parentheses: less than `taichisoft.expressions` evaluates, and each part known to be a truth or a number beforehand.
"""

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from taichisoft.errors import SceneError, nearest
from taichisoft.expressions import COMPARISONS, ExpressionError, evaluate, parse, shown

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
        """Whether it is true for values of its quantities.

        Raises:
            ZeroDivisionError: it divides by zero.
        """
        return bool(evaluate(self._tree, {str(quantity): value for quantity, value in values.items()}))


def read_condition(text: str, names: Sequence[str]) -> Condition:
    """Understand a condition about quantities of the given names.

    Raises:
        SceneError: it is not in the language; one line that says what is wrong and what would be valid.
    """
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
        """Check a part that is true or false.

        Raises:
            SceneError: it is a number, or nothing that a condition may have.
        """
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
        """Check a part that is a number.

        Raises:
            SceneError: it is true or false, or nothing that a condition may have.
        """
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
