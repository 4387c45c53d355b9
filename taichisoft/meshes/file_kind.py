"""Errors about a mesh or surface file that is of another kind, missing or broken."""

from collections.abc import Sequence
from pathlib import Path

from taichisoft.errors import MeshError
from taichisoft.input_file import is_file


def require_suffix(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, if its suffix is one of `suffixes`.

    Raises:
        MeshError: the suffix is another one; the message names the kind of file and the valid suffixes.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise MeshError(f"{path}: '{path.suffix}' is not a kind of {what} file; valid: {', '.join(suffixes)}")
    return path


def existing_file(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, if a file with one of `suffixes` exists and is not empty.

    Raises:
        MeshError: the file does not exist, is empty or has another suffix; the message names the kind of file.
    """
    path = require_suffix(path, what, suffixes)
    if not is_file(path):
        raise MeshError(f"{path}: no such file; a {what} ({', '.join(suffixes)}) is needed")
    if not path.stat().st_size:
        raise MeshError(f"{path}: is empty; a {what} ({', '.join(suffixes)}) is needed")
    return path


def unreadable(path: Path, error: BaseException) -> MeshError:
    """One line about the error of a parser."""
    why = " ".join(str(error).split()) or "broken, or another kind of file"
    if "gmsh:physical" in why:  # meshio's limit: MSH 4.0 with all elements saved, only some of them in a group
        why = "some elements are in no physical group; save it from gmsh without 'Save all elements', or as MSH 4.1"
    return MeshError(f"{path}: not readable as {path.suffix[1:].upper()}: {why}")
