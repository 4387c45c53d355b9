"""STEP files as text: what can be told from it before OpenCASCADE reads it, which may never end with a wrong one."""

import re
from pathlib import Path

from taichisoft.errors import MeshError

SUFFIXES = (".step", ".stp")

FIRST, LAST = "ISO-10303-21", "END-ISO-10303-21"
SECTIONS = ("HEADER", "DATA")

QUOTED = re.compile(r"'[^']*'")
NOT_FINITE = re.compile(r"[(,]\s*[-+]?(?:nan\w*|inf\w*|1\.#\w+)\s*[,)]", re.IGNORECASE)


def refuse_broken_step(path: Path) -> None:
    """Check that a file is a whole STEP file without NaN.

    Raises:
        MeshError: it is missing, empty, of another kind, stops too early, or has a number that is not finite.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: '{path.suffix}' is not a kind of STEP file; valid: {', '.join(SUFFIXES)}")
    try:
        text = path.read_text(encoding="latin-1")  # any byte is a letter
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a STEP file ({', '.join(SUFFIXES)}) is needed") from error
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not text.strip():
        raise MeshError(f"{path}: is empty; a STEP file is needed")
    if not text.lstrip("\xef\xbb\xbf \t\r\n").startswith(FIRST):
        raise MeshError(f"{path}: is no STEP file: it does not begin with {FIRST}")
    if LAST not in text:
        raise MeshError(f"{path}: stops too early: it does not end with {LAST}; write it again")
    for section in SECTIONS:
        if not re.search(rf"\b{section}\s*[;(]", text):
            raise MeshError(f"{path}: is no STEP file: it has no section {section}")
    _refuse_not_finite(text, path)


def _refuse_not_finite(text: str, path: Path) -> None:
    # Names may read like numbers; lengths stay, so that places do, too.
    bare = QUOTED.sub(lambda quoted: " " * len(quoted[0]), text)
    wrong = NOT_FINITE.search(bare)
    if wrong is not None:
        line = text.count("\n", 0, wrong.start()) + 1
        number = wrong[0].strip("(), \t\r\n")
        raise MeshError(f"{path}: line {line} has the number {number}, which is not finite; write the file again")
