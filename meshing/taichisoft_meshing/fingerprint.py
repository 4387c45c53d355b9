"""A hash of all inputs of a mesh: meshes with the same hash are the same."""

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft_meshing.gmsh_session import gmsh_version

OWN_CODE = Path(__file__).resolve().parent


def fingerprint(kind: Callable[..., Any], tables: Mapping[str, Any], folder: Path, request: Mapping[str, Any]) -> str:
    """Hash the tables after overrides, the files that they name, the request, and the code that makes the mesh.

    Args:
        kind: class or function that makes the geometry; its whole package counts as code.
        tables: tables of the geometry file, its `kind` included.
        folder: folder of the files that the tables name: any text in them that is the path of a file there.
        request: size, preset or number of nodes.

    Raises:
        OSError: a file that the tables name cannot be read, or the code of the kind cannot be found.
    """
    parts = [
        json.dumps([tables, request], sort_keys=True, default=str).encode(),
        *(file.read_bytes() for file in named_files(tables, folder)),
        f"taichisoft {taichisoft.__version__}, gmsh {gmsh_version()}".encode(),
        *(_digest_of_code(root) for root in dict.fromkeys((OWN_CODE, _package_of(kind)))),
    ]
    whole = hashlib.sha256()
    for part in parts:
        whole.update(hashlib.sha256(part).digest())
    return whole.hexdigest()


def named_files(value: Any, folder: Path) -> Iterator[Path]:
    """The files that texts in the tables name, by sorted keys."""
    if isinstance(value, Mapping):
        for key in sorted(value):
            yield from named_files(value[key], folder)
    elif isinstance(value, list):
        for item in value:
            yield from named_files(item, folder)
    elif isinstance(value, str) and value:
        path = folder / Path(value).expanduser()
        try:
            found = path.is_file()
        except (OSError, ValueError):  # text that can be no path
            found = False
        if found:
            yield path


def _package_of(kind: Callable[..., Any]) -> Path:
    """The outermost package folder that holds the source of a class or function, or its file where it is in none."""
    try:
        source = inspect.getsourcefile(inspect.unwrap(kind))
    except TypeError as error:
        raise OSError(f"the source of {kind!r} cannot be found") from error
    if source is None:
        raise OSError(f"the source of {kind!r} cannot be found")
    place = Path(source).resolve()
    while (place.parent / "__init__.py").is_file():
        place = place.parent
    return place


@functools.cache  # what runs is what was loaded when the process began
def _digest_of_code(place: Path) -> bytes:
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    digests = [hashlib.sha256(file.read_bytes()).digest() for file in files]
    return b"".join(digests)
