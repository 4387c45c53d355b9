"""How good a mesh must be: the table [quality] of a geometry file, whatever its kind."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from taichisoft.errors import MeshError
from taichisoft.scenes.validation_errors import first_problem

QUALITY = "quality"
"""Name of the table."""

Share = Annotated[float, Field(ge=0, le=1)]
Angle = Annotated[float, Field(ge=0, le=180)]


class QualityLimits(BaseModel):
    """What a mesh must keep to be written without `--force`; the defaults refuse what breaks in a large bend."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    radius_ratio: Share = 0.03
    """[-] smallest of any element: 1 for a regular tetrahedron, 0 for a flat one (gmsh's gamma)."""
    smallest_dihedral_angle: Angle = 2.0
    """[degrees] between two faces of an element."""
    largest_dihedral_angle: Angle = 177.0
    """[degrees] between two faces of an element."""
    shortest_edge: Annotated[float, Field(ge=0)] = 0.0
    """[mm]"""
    elements_across_walls: Annotated[int, Field(ge=1, le=5)] = 1
    """How many elements 95 % of each cavity's wall must be thick, at least."""


class _File(BaseModel):
    """What of a geometry file is the same for every kind."""

    quality: QualityLimits = QualityLimits()


def quality_limits(tables: Mapping[str, Any], path: Path) -> QualityLimits:
    """The limits in the tables of a geometry file, or the defaults.

    Raises:
        MeshError: one is not valid; begins with the file.
    """
    try:
        return _File.model_validate({key: tables[key] for key in (QUALITY,) if key in tables}).quality
    except ValidationError as error:
        raise MeshError(f"{path}: {first_problem(error, _File)}") from error
