"""Arithmetic and comparisons in a user's text, evaluated without Python's own evaluation.

An expression has numbers, names, entries (`table["key"]`), arithmetic, comparisons, also in chains, `and`, `or`, `not`,
`A if B else C`, and the functions below. Python's parser finds the structure, nothing else of it is used: there are no
builtins, attributes, assignments nor calls of anything else, so that a text from a stranger can compute a wrong number
but do nothing. What the names mean, and whether an expression may have less, is for the caller to say.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping
from typing import Any

from taichisoft.errors import TaichisoftError, nearest

FUNCTIONS: Mapping[str, Callable[..., Any]] = {
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
ARITHMETIC: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: math.pow,  # of floats: whole numbers could grow without end
}
COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
KNOWN = (
    ast.Constant, ast.Name, ast.Load, ast.Subscript, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp,
    ast.Call, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or, *ARITHMETIC, *COMPARISONS,
)  # fmt: skip
LONGEST_TEXT, LONGEST_SHOWN = 1000, 60
"""Most characters of an expression, and of the part of one that an error shows."""
DEEPEST_NESTING = 100
"""Most levels of an expression; a sum of n terms has n."""
CANNOT_BE_COMPUTED = (ArithmeticError, ValueError, TypeError, AttributeError, RecursionError)
"""What `evaluate` raises beside an `ExpressionError` where values do not suit an expression."""


class ExpressionError(TaichisoftError):
    """A text is not an expression, or cannot be computed; the caller says where the text stands."""


def parse(text: str) -> ast.expr:
    """The structure of a text, of which nothing is known but that it is short and not deep.

    Raises:
        ExpressionError: there is none.
    """
    if len(text) > LONGEST_TEXT:
        raise ExpressionError(f"has {len(text)} characters; {LONGEST_TEXT} are the most")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's warnings about its own syntax are none of the user's business
            tree = ast.parse(in_one_line(text), mode="eval").body
    except SyntaxError as error:
        problem = " ".join((error.msg or "invalid syntax").split())
        place = f"character {error.offset}" if error.offset else "the end"
        raise ExpressionError(f"not understood at {place}: {problem}") from error
    except (ValueError, MemoryError, RecursionError) as error:
        problem = " ".join(str(error).split()) or "nested too deeply"
        raise ExpressionError(f"not understood: {problem}") from error
    depth, level = 0, list[ast.AST]([tree])
    while level:
        depth, level = depth + 1, [child for node in level for child in ast.iter_child_nodes(node)]
    if depth > DEEPEST_NESTING:
        raise ExpressionError(f"is nested too deeply; {DEEPEST_NESTING} levels are the most")
    return tree


def in_one_line(text: str) -> str:
    """The text that the places of `parse` count in."""
    return text.replace("\n", " ").strip()


def shown(node: ast.expr, text: str) -> str:
    """A part of a text as it was written, shortened where it is long."""
    part = " ".join((ast.get_source_segment(in_one_line(text), node) or text).split())
    return part if len(part) <= LONGEST_SHOWN else f"{part[:LONGEST_SHOWN]}..."


def read_expression(text: str) -> ast.expr:
    """The structure of an expression, ready for `evaluate`.

    Raises:
        ExpressionError: it is none, or has a part that expressions do not have.
    """
    tree = parse(text)
    for node in ast.walk(tree):
        if not isinstance(node, KNOWN):
            raise ExpressionError(f"expressions have no {type(node).__name__}")
        if isinstance(node, ast.Constant) and not isinstance(node.value, int | float | str):
            raise ExpressionError(f"expressions have no {node.value!r}")
        if isinstance(node, ast.Call) and (
            node.keywords or not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS
        ):
            raise ExpressionError(f"{shown(node.func, text)}: unknown function; there are: {', '.join(FUNCTIONS)}")
    return tree


def evaluate(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """The value of an expression, or of a part of one, with these values of names.

    What need not be known is not evaluated, as in Python: `time > 0 and 1 / time < 2` never divides by zero.

    Raises:
        ExpressionError: a name or an entry is missing, or a part is none of those that expressions have.
        ArithmeticError, ValueError, TypeError, AttributeError: the values do not suit the expression.
    """
    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            if name in names:
                return names[name]
            if name in CONSTANTS:
                return CONSTANTS[name]
            raise ExpressionError(f"there is no '{name}'; {nearest(name, list(names), 'there are')}")
        case ast.Subscript(value=table, slice=place):
            return _entry(evaluate(table, names), evaluate(place, names))
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in ARITHMETIC:
            return ARITHMETIC[type(sign)](float(evaluate(left, names)), float(evaluate(right, names)))
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return not evaluate(operand, names)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -evaluate(operand, names)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return evaluate(operand, names)
        case ast.BoolOp(op=sign, values=parts):
            return (all if isinstance(sign, ast.And) else any)(evaluate(part, names) for part in parts)
        case ast.Compare(left=left, ops=signs, comparators=others):
            return _chain_holds(left, signs, others, names)
        case ast.IfExp(test=test, body=body, orelse=other):
            return evaluate(body if evaluate(test, names) else other, names)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            return FUNCTIONS[name](*(evaluate(argument, names) for argument in arguments))
    raise ExpressionError(f"expressions have no {type(node).__name__}")


def _chain_holds(left: ast.expr, signs: list[ast.cmpop], others: list[ast.expr], names: Mapping[str, Any]) -> bool:
    value = evaluate(left, names)
    for sign, part in zip(signs, others, strict=True):
        other = evaluate(part, names)
        if not COMPARISONS[type(sign)](value, other):
            return False
        value = other
    return True


def _entry(table: Any, place: Any) -> Any:
    """An entry of a table by its name, or of a list by its index."""
    if isinstance(table, Mapping):
        if place in table:
            return table[place]
        raise ExpressionError(f"there is no {place!r}; {nearest(str(place), [*map(str, table)], 'there are')}")
    try:
        return table[int(place)]
    except (IndexError, TypeError, ValueError, KeyError) as error:
        raise ExpressionError(f"entry {place!r} does not exist") from error
