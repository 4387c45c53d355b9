"""Safe display of external text on a terminal."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text


def printable(text: str) -> str:
    r"""Write control characters of a text as escapes, such as "\x1b" for terminal commands.

    Characters that change the direction of writing are escaped too, since they make one name look like another.
    """
    return "".join(one if one.isprintable() or one in "\n\t" else ascii(one)[1:-1] for one in text)


def plain(text: object) -> "Text":
    """Text for a rich table without markup; rich would interpret a bare "[kPa]" as markup."""
    from rich.text import Text  # imported here, so that --help need not wait

    return Text(printable(str(text)))


def say(line: object) -> None:
    """Print a line that may contain names or paths, with control characters escaped."""
    print(printable(str(line)), flush=True)
