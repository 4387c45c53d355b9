"""The language of conditions: "contact_force > 60 and lift < 1", read without executing any of it.

    condition  = comparison | condition "and" condition | condition "or" condition | "not" condition
    comparison = number ("<" | "<=" | ">" | ">=" | "==" | "!=") number, also in chains: 20 < pressure < 50
    number     = 60 | 1.5e3 | quantity | quantity["key"] | number (+ - * /) number | -number | abs, min, max of numbers

and parentheses. Python's own parser finds the structure; what is not in the list above is refused.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from taichisoft.errors import SceneError, nearest

LONGEST_TEXT = 1000
DEEPEST_NESTING = 50

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
    _holds: Callable[[Values], bool]

    def holds(self, values: Values) -> bool:
        """Whether it is true for values of its quantities.

        Raises:
            ZeroDivisionError: it divides by zero.
        """
        return self._holds(values)


def read_condition(text: str, names: Sequence[str]) -> Condition:
    """Understand a condition about quantities of the given names.

    Raises:
        SceneError: it is not in the language; one line that says what is wrong and what would be valid.
    """
    if len(text) > LONGEST_TEXT:
        raise SceneError(f"has {len(text)} characters; {LONGEST_TEXT} are the most")
    text = text.replace("\n", " ").strip()
    if not text:
        raise SceneError("is empty; an example of a condition is: contact_force > 60")
    tree = _syntax_tree(text)
    if _depth(tree) > DEEPEST_NESTING:
        raise SceneError(f"is nested too deeply; {DEEPEST_NESTING} levels are the most")
    reader = _Reader(text, names)
    holds = reader.truth(tree)
    if not reader.quantities:
        raise SceneError("names no quantity, so that it never changes: there is nothing to wait for")
    return Condition(tuple(dict.fromkeys(reader.quantities)), holds)


def _syntax_tree(text: str) -> ast.expr:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's warnings about its own syntax are none of the user's business
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        problem = " ".join((error.msg or "invalid syntax").split())
        place = f"character {error.offset}" if error.offset else "the end"
        raise SceneError(f"not understood at {place}: {problem}") from error
    except (ValueError, MemoryError, RecursionError) as error:
        raise SceneError(f"not understood: {' '.join(str(error).split()) or 'nested too deeply'}") from error


def _depth(tree: ast.AST) -> int:
    depth, level = 0, [tree]
    while level:
        depth, level = depth + 1, [child for node in level for child in ast.iter_child_nodes(node)]
    return depth


class _Reader:
    """Turns Python's syntax tree into functions of the quantities' values, each known to give a truth or a number.

    Attributes:
        quantities: all that were named so far.
    """

    def __init__(self, text: str, names: Sequence[str]):
        self.quantities: list[Quantity] = []
        self._text = text
        self._names = list(names)

    def truth(self, node: ast.expr) -> Callable[[Values], bool]:
        """The function of a node that is true or false.

        Raises:
            SceneError: the node is a number, or nothing that a condition may have.
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
            case _:
                self.number(node)  # raises first: an unknown name is worse than a forgotten comparison
                raise SceneError(f"{self._show(node)} is a number; compare it with something, as in contact_force > 60")

    def number(self, node: ast.expr) -> Callable[[Values], float]:
        """The function of a node that is a number.

        Raises:
            SceneError: the node is true or false, or nothing that a condition may have.
        """
        match node:
            case ast.Constant(int() | float() as value) if not isinstance(value, bool):
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
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(ast.Not()):
                raise SceneError(f"{self._show(node)} is true or false; a number is needed here")
            case _:
                raise SceneError(
                    f"{self._show(node)} has no place in a condition; it may have comparisons, and, or, not, + - * /, "
                    f"{', '.join(FUNCTIONS)}, numbers and quantities"
                )

    def _constant(self, node: ast.expr, value: float) -> Callable[[Values], float]:
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

    def _show(self, node: ast.expr) -> str:
        return repr(ast.get_source_segment(self._text, node) or self._text)
