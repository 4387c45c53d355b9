"""What a user names to be read: whether the file is there, and the tables of TOML in it."""

import re
import tomllib
from pathlib import Path
from typing import Any

DEEPEST = 50
"""Tables and lists may be nested so deep: what is done with them calls itself for each of them."""
LONG_INTEGER = re.compile(r"(?<![\w.])[+-]?\d[\d_]{400,}(?![\w.])")
"""Python refuses to read integers of thousands of digits, and no number of a scene has hundreds."""


def is_file(path: Path) -> bool:
    """Whether a file is there that can be looked at; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a folder is there that can be looked at; a name that no folder can have is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def from_home(path: str | Path) -> Path:
    """The path with a "~" at its beginning replaced; a home that nobody has is taken as it is written."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of TOML.

    Raises:
        ValueError: it is none, or nested too deep to be worked with.
    """
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"it is nested deeper than {DEEPEST} tables or lists") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise ValueError("it has an integer of thousands of digits" if LONG_INTEGER.search(text) else error) from None
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = [inner for one in level for inner in (one.values() if isinstance(one, dict) else one)]
        level = [one for one in level if isinstance(one, dict | list)]
        if not level:
            return tables
    raise ValueError(f"it is nested deeper than {DEEPEST} tables or lists")


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no TOML, or nested too deep to be worked with.
    """
    return parse_toml(path.read_text(encoding="utf-8"))
