"""Names of Python 2, built in or in the module `string`, that Python 3 does not have."""

import functools
import importlib
import string
import sys
from types import SimpleNamespace
from typing import Any

GONE = {
    *("xrange", "unicode", "basestring", "raw_input", "unichr", "long", "execfile", "reduce", "reload", "cmp", "file"),
}
"""Built-in names that Python 3 does not have."""

DIVIDE = "__python2_divide__"
STRING = "__python2_string__"


def divide(dividend: Any, divisor: Any) -> Any:
    """Divide as in Python 2: the quotient of integers is an integer."""
    if isinstance(dividend, int) and isinstance(divisor, int):
        return dividend // divisor
    return dividend / divisor


def _join(words: Any, separator: str = " ") -> str:
    return separator.join(words)


METHODS = (
    *("upper", "lower", "capitalize", "swapcase", "strip", "lstrip", "rstrip", "split", "rsplit", "replace", "find"),
    *("rfind", "index", "rindex", "count", "ljust", "rjust", "center", "zfill", "expandtabs", "translate"),
)
OF_STRING: dict[str, Any] = {
    "join": _join,
    "joinfields": _join,
    "splitfields": str.split,
    **{name: getattr(str, name) for name in METHODS},
    "atof": float,
    "atoi": int,
    "atol": int,
    "maketrans": str.maketrans,
    "letters": string.ascii_letters,
    "lowercase": string.ascii_lowercase,
    "uppercase": string.ascii_uppercase,
}
"""Functions of the module `string` that Python 3 does not have."""

NAMES: dict[str, Any] = {
    DIVIDE: divide,
    STRING: SimpleNamespace(**OF_STRING),
    "reduce": functools.reduce,
    "reload": importlib.reload,
    "intern": sys.intern,
    "cmp": lambda first, second: (first > second) - (first < second),
    "file": open,
}
"""Additional global variables of a module in Python 2."""
