"""A finger's dimensions from TOML; errors name the file, the key, its value and what would be valid."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from taichisoft.errors import MeshError
from taichisoft.validation_errors import first_problem
from taichisoft_meshing.finger import FingerParameters


def read_finger(path: str | Path, size: float | None = None) -> FingerParameters:
    """Read a finger file; `size` [mm] replaces its largest element size and scales the smallest with it.

    Raises:
        MeshError: the file is missing or no TOML, or a dimension is not valid.
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MeshError(f"{path}: no such file; a finger file (.toml) is needed") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise MeshError(f"{path}: not readable as TOML: {error}") from error
    finger = finger_from_dict(document, source=str(path))
    if size is None:
        return finger
    sizes = {"largest": size, "smallest": size * finger.mesh.smallest / finger.mesh.largest}
    return finger_from_dict({**document, "mesh": sizes}, source=str(path))


def finger_from_dict(document: Mapping[str, Any], source: str = "finger") -> FingerParameters:
    """Make a finger from plain tables, as TOML gives them; `source` begins every error.

    Raises:
        MeshError: a dimension is not valid.
    """
    try:
        return FingerParameters.model_validate(dict(document))
    except ValidationError as error:
        raise MeshError(f"{source}: {first_problem(error, FingerParameters)}") from error
