"""Input files: existence, tables of TOML, and arrays of numpy."""

import io
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

DEEPEST = 50
"""Largest depth of nested tables and lists, which are processed recursively."""
LONG_INTEGER = re.compile(r"(?<![\w.])[+-]?\d[\d_]{400,}(?![\w.])")
"""An integer of hundreds of digits; Python refuses to parse thousands, and no number of a scene has that many."""


def is_file(path: Path) -> bool:
    """Whether a readable file exists; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a readable folder exists; False for a name that no folder can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def from_home(path: str | Path) -> Path:
    """Replace a leading "~" by the home folder; unchanged if the user does not exist."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML to tables.

    Raises:
        ValueError: the text is not TOML, or nested too deep.
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
    """Read the tables of a TOML file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not TOML, or nested too deep.
    """
    return parse_toml(path.read_text(encoding="utf-8"))


def read_arrays(path: str | Path) -> "dict[str, np.ndarray]":
    """Read the arrays of an .npz file by name; the checksum of each is compared before it is interpreted.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged, or does not contain plain arrays.
    """
    import zipfile  # imported here, so that --help need not wait

    from numpy.lib.format import read_array

    try:
        with Path(path).open("rb") as file, zipfile.ZipFile(file) as archive:
            file.seek(-12 - len(archive.comment), io.SEEK_END)
            count = int.from_bytes(file.read(2), "little")
            if len(archive.namelist()) != count:  # a wrong length in the directory hides entries from zipfile
                raise ValueError(f"its directory has {len(archive.namelist())} arrays instead of {count}")
            if len(set(archive.namelist())) != count:
                raise ValueError("two of its arrays have one name")
            contents = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
        return {name: read_array(io.BytesIO(content), allow_pickle=False) for name, content in contents.items()}
    except OSError:
        raise
    except Exception as error:  # of any kind: flags and versions of a damaged zip file lead to RuntimeError and more
        raise ValueError(f"not a whole .npz file: {error or type(error).__name__}") from error
