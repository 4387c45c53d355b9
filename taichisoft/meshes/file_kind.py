"""Errors about a mesh or surface file that is of another kind, missing or broken."""

from collections.abc import Sequence
from pathlib import Path

from taichisoft.errors import MeshError
from taichisoft.input_file import is_file


def require_suffix(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, when its suffix is one of those.

    Raises:
        MeshError: it is not; the message says what kind of file is meant and lists them.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise MeshError(f"{path}: '{path.suffix}' is not a kind of {what} file; valid: {', '.join(suffixes)}")
    return path


def existing_file(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, when a file of one of those suffixes is there, and something is in it.

    Raises:
        MeshError: it is not; the message says what kind of file is meant.
    """
    path = require_suffix(path, what, suffixes)
    if not is_file(path):
        raise MeshError(f"{path}: no such file; a {what} ({', '.join(suffixes)}) is needed")
    if not path.stat().st_size:
        raise MeshError(f"{path}: is empty; a {what} ({', '.join(suffixes)}) is needed")
    return path


def unreadable(path: Path, error: BaseException) -> MeshError:
    """One line about what a parser stumbled over."""
    why = " ".join(str(error).split()) or "broken, or another kind of file"
    if "gmsh:physical" in why:  # meshio's limit: MSH 4.0 with all elements saved, only some of them in a group
        why = "some elements are in no physical group; save it from gmsh without 'Save all elements', or as MSH 4.1"
    return MeshError(f"{path}: not readable as {path.suffix[1:].upper()}: {why}")
