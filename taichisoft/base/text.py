"""Text for users: safe on a terminal, short for any size, warnings that point to the user's line, missing packages."""

import reprlib
import sys
import textwrap
import warnings
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from itertools import islice
from typing import TYPE_CHECKING, Any

from taichisoft.errors import PackageMissing

if TYPE_CHECKING:
    from rich.text import Text

# Warnings that point to the line of the user's program that led to them, and not to one in here.

_PACKAGES = ("taichisoft", "functools")
"""All import names of this project begin so; `functools` is between two of them where a value is cached."""


def warn_caller(line: str) -> None:
    """Warn in one line, at the innermost call that no package of this project makes."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(_PACKAGES):
        frame, level = frame.f_back, level + 1
    warnings.warn(line, stacklevel=level)


@cache
def warn_caller_once(line: str) -> None:
    """Warn like `warn_caller` when a line is first given in this process."""
    warn_caller(line)


# Packages that need not be installed: a missing one is one line that says what installs it.

WHOLE = "pip install taichisoft"
"""Command that installs what an installation of the engine alone has left out."""


def extra(name: str) -> str:
    """The command that installs an extra."""
    return f"pip install 'taichisoft[{name}]'"


def require(what: str, *modules: str, install: str = WHOLE) -> None:
    """See that modules can be imported, without importing them.

    Args:
        what: the thing that needs them, which begins the error.
        modules: import names.
        install: command that installs them.

    Raises:
        PackageMissing: one cannot be found.
    """
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        raise PackageMissing(f"{what}: needs {' and '.join(missing)}, which {are} not installed: {install}")


# Safe display of external text on a terminal.


def printable(text: str) -> str:
    r"""Write control characters of a text as escapes, such as "\x1b" for terminal commands.

    Characters that change the direction of writing are escaped too, since they make one name look like another.
    """
    return "".join(letter if letter.isprintable() or letter in "\n\t" else ascii(letter)[1:-1] for letter in text)


def plain(text: object) -> "Text":
    """Text for a rich table without markup; rich would interpret a bare "[kPa]" as markup."""
    from rich.text import Text  # imported here, so that --help need not wait

    return Text(printable(str(text)))


def say(line: object) -> None:
    """Print a line that may contain names or paths, with control characters escaped."""
    print(printable(str(line)), flush=True)


# What the prompt of Python and a notebook show of states, observations and reports.

MOST_LINES, LINE = 10, 110
MOST_ENTRIES = 3
"""Numbers of an array and entries of a mapping that are shown one by one."""


def brief(name: str, values: Mapping[str, Any]) -> str:
    """A representation of at most ten lines, without what is empty: long arrays by their shapes."""
    given = {key: value for key, value in values.items() if not (hasattr(value, "__len__") and len(value) == 0)}
    lines = textwrap.wrap(", ".join(f"{key}={_brief_value(value)}" for key, value in given.items()), LINE)
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], "..."]
    return f"{name}({f'{chr(10)}    '.join(lines)})"


def _brief_value(value: Any) -> str:
    if hasattr(value, "tolist"):
        shape = "x".join(map(str, value.shape))
        return _brief_value(value.tolist()) if value.size <= MOST_ENTRIES else f"array[{shape}]"
    if isinstance(value, Mapping):
        entries = [f"{key!r}: {_brief_value(entry)}" for key, entry in islice(value.items(), MOST_ENTRIES)]
        return f"{{{', '.join([*entries, *['...'] * (len(value) > MOST_ENTRIES)])}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_brief_value, value))}]"
    return f"{value:.4g}" if isinstance(value, float) else reprlib.repr(value)
