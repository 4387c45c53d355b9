"""The language of conditions: "contact_force > 60 and lift < 1", read without executing any of it.

    condition  = comparison | condition "and" condition | condition "or" condition | "not" condition
    comparison = number ("<" | "<=" | ">" | ">=" | "==" | "!=") number, also in chains: 20 < pressure < 50
    number     = 60 | 1.5e3 | quantity | quantity["key"] | number (+ - * /) number | -number | abs, min, max of numbers

and parentheses. Python's own parser finds the structure; what is not in the list above is refused.
"""

import ast
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from taichisoft.errors import SceneError
from taichisoft_controllers.scripted.condition_reader import ConditionReader, Quantity, Values

LONGEST_TEXT = 1000
DEEPEST_NESTING = 50


@dataclass(frozen=True)
class Condition:
    """A condition that has been read.

    Attributes:
        text: as it was written.
        quantities: all that it names, each once.
    """

    text: str
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
    tree = _structure(text)
    if _depth(tree) > DEEPEST_NESTING:
        raise SceneError(f"is nested too deeply; {DEEPEST_NESTING} levels are the most")
    reader = ConditionReader(text, names)
    holds = reader.truth(tree)
    if not reader.quantities:
        raise SceneError("names no quantity, so that it never changes: there is nothing to wait for")
    return Condition(text, tuple(dict.fromkeys(reader.quantities)), holds)


def _structure(text: str) -> ast.expr:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Python's about its own syntax
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
