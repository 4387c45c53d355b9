"""The parts of a condition as functions of what is measured; each is known beforehand to be a number or a truth."""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taichisoft.errors import SceneError, nearest

FUNCTIONS: Mapping[str, Callable[..., float]] = {"abs": abs, "min": min, "max": max}
ARITHMETIC: Mapping[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
COMPARISONS: Mapping[type, Callable[[float, float], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
TRUTHS = (ast.Compare, ast.BoolOp)
NUMBERS = (ast.BinOp, ast.Name, ast.Subscript, ast.Call)


@dataclass(frozen=True)
class Quantity:
    """Something that can be measured, as a condition names it: pressure["finger1"]."""

    name: str
    key: str | None = None

    def __str__(self) -> str:
        return self.name if self.key is None else f'{self.name}["{self.key}"]'


Values = Mapping[Quantity, float]


class ConditionReader:
    """Turns Python's syntax tree into functions of the quantities' values.

    Attributes:
        quantities: all that were named so far.
    """

    def __init__(self, text: str, names: Sequence[str]):
        self.quantities: list[Quantity] = []
        self._text = text
        self._names = list(names)

    def truth(self, node: ast.expr) -> Callable[[Values], bool]:
        """What is true or false.

        Raises:
            SceneError: it is not, or is nothing that a condition may have.
        """
        match node:
            case ast.BoolOp(op, parts):
                together = all if isinstance(op, ast.And) else any
                read = [self.truth(part) for part in parts]
                return lambda values: together(part(values) for part in read)
            case ast.UnaryOp(ast.Not(), operand):
                inner = self.truth(operand)
                return lambda values: not inner(values)
            case ast.Compare(left, operators, others):
                for sign in operators:
                    self._require(type(sign) in COMPARISONS, node, "compare with < <= > >= == or !=")
                compare = [COMPARISONS[type(sign)] for sign in operators]
                terms = [self.number(term) for term in (left, *others)]
                links = list(zip(compare, terms[:-1], terms[1:], strict=True))
                return lambda values: all(holds(one(values), other(values)) for holds, one, other in links)
            case ast.Constant(bool()):
                raise SceneError(f"{self._show(node)} never changes: there is nothing to wait for")
            case _ if isinstance(node, NUMBERS) or _is_sign(node) or _is_number(node):
                self.number(node)  # an unknown name is worse than a forgotten comparison
                raise SceneError(f"{self._show(node)} is a number; compare it with something, as in contact_force > 60")
            case _:
                raise self._foreign(node)

    def number(self, node: ast.expr) -> Callable[[Values], float]:
        """What is a number.

        Raises:
            SceneError: it is not, or is nothing that a condition may have.
        """
        match node:
            case ast.Constant(value) if _is_number(node):
                return self._constant(node, value)
            case ast.Name(name):
                return self._quantity(name, None)
            case ast.Subscript(ast.Name(name), ast.Constant(str(key))):
                return self._quantity(name, key)
            case ast.Subscript(ast.Name(name)):
                raise SceneError(f'{self._show(node)}: what stands in brackets is a name in quotes: {name}["..."]')
            case ast.UnaryOp(ast.USub(), operand):
                inner = self.number(operand)
                return lambda values: -inner(values)
            case ast.UnaryOp(ast.UAdd(), operand):
                return self.number(operand)
            case ast.BinOp(left, sign, right):
                self._require(type(sign) in ARITHMETIC, node, "calculate with + - * and /")
                calculate, one, other = ARITHMETIC[type(sign)], self.number(left), self.number(right)
                return lambda values: calculate(one(values), other(values))
            case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS:
                return self._function(node, name, arguments)
            case ast.Call(ast.Name(name)) if name not in FUNCTIONS:
                raise SceneError(f"no function is called '{name}'; {nearest(name, list(FUNCTIONS), 'there are')}")
            case _ if isinstance(node, TRUTHS) or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)):
                raise SceneError(f"{self._show(node)} is true or false; a number is needed here")
            case _:
                raise self._foreign(node)

    def _constant(self, node: ast.expr, value: Any) -> Callable[[Values], float]:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        self._require(math.isfinite(number), node, "a number must be finite")
        return lambda _: number

    def _quantity(self, name: str, key: str | None) -> Callable[[Values], float]:
        if name in FUNCTIONS:
            raise SceneError(f"{name} is a function: {name}(...)")
        if name not in self._names:
            raise SceneError(f"no quantity is called '{name}'; {nearest(name, self._names, 'there are')}")
        quantity = Quantity(name, key)
        self.quantities.append(quantity)
        return lambda values: values[quantity]

    def _function(self, node: ast.expr, name: str, arguments: list[ast.expr]) -> Callable[[Values], float]:
        one = name == "abs"
        enough = len(arguments) == 1 if one else len(arguments) >= 2
        self._require(enough, node, f"{name} takes {'one number' if one else 'two numbers or more'}")
        function, read = FUNCTIONS[name], [self.number(argument) for argument in arguments]
        return lambda values: function(*(argument(values) for argument in read))

    def _require(self, fulfilled: bool, node: ast.expr, rule: str) -> None:
        if not fulfilled:
            raise SceneError(f"{self._show(node)}: {rule}")

    def _foreign(self, node: ast.expr) -> SceneError:
        return SceneError(
            f"{self._show(node)} has no place in a condition; it may have comparisons, and, or, not, + - * /, "
            f"{', '.join(FUNCTIONS)}, numbers and quantities"
        )

    def _show(self, node: ast.expr) -> str:
        return repr(ast.get_source_segment(self._text, node) or self._text)


def _is_number(node: ast.expr) -> bool:
    value: Any = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_sign(node: ast.expr) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd)
