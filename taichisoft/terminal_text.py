"""Text from elsewhere, as a terminal may show it."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text


def printable(text: str) -> str:
    r"""A text in which control characters are written out: "\x1b" for the one with which a terminal is told things.

    Those that turn the direction of writing are written out as well, since they let one name look like another.
    """
    return "".join(one if one.isprintable() or one in "\n\t" else ascii(one)[1:-1] for one in text)


def plain(text: object) -> "Text":
    """A cell, heading or title of a table for rich, which would take a bare "[kPa]" for its own markup."""
    from rich.text import Text  # takes a moment, which --help need not wait for

    return Text(printable(str(text)))


def say(line: object) -> None:
    """Print a line with a name or a path in it, which need not be one that a terminal should show as it is."""
    print(printable(str(line)), flush=True)
