"""A finger's dimensions from TOML; errors name the file, the key, its value and what would be valid."""

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from taichisoft.errors import MeshError
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
        raise MeshError(f"{source}: {_first_problem(error)}") from error


def _first_problem(error: ValidationError) -> str:
    problem = error.errors()[0]
    key = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "value_error":  # a rule between several keys; it names them itself
        return problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        return f"{key}: unknown key; {_nearest_key(problem['loc'])}"
    if problem["type"] == "model_type":
        return f"{key} = {problem['input']!r}: must be a table, [{key}]"
    return f"{key} = {problem['input']!r}: {problem['msg'][0].lower()}{problem['msg'][1:]}"


def _nearest_key(location: tuple[int | str, ...]) -> str:
    table: type[BaseModel] = FingerParameters
    for part in location[:-1]:
        table = table.model_fields[str(part)].annotation  # type: ignore[assignment]
    near = difflib.get_close_matches(str(location[-1]), table.model_fields, n=1)
    return f"did you mean '{near[0]}'?" if near else f"valid keys: {', '.join(table.model_fields)}"
