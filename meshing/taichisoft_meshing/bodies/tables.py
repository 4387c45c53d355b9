"""What the files of bodies from elsewhere have in common: their base and the sizes of their elements."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError, model_validator

from taichisoft.errors import MeshError
from taichisoft.scenes.scene import Positive, Table, Vector
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_meshing.bodies.surface_repair import NEAR, diagonal

AnyTable = TypeVar("AnyTable", bound=Table)
Count = Annotated[int, Field(strict=True, ge=0)]

# The diagonal of the body over the size of the elements: nodes of the tutorial's finger 600, 2000 and 6000.
PRESETS = {"coarse": 12.0, "medium": 24.0, "fine": 48.0}

# More elements than any machine meshes and simulates in a sensible time.
MOST_ELEMENTS = 5_000_000


class Base(Table):
    """The triangles of the outer surface that a gripper holds: in a plane, or in a box."""

    point: Vector | None = None
    """[mm] anywhere in the plane."""
    normal: Vector | None = None
    """Of the plane, of any length."""
    box: tuple[Vector, Vector] | None = None
    """Lower and upper corner [mm]; a triangle belongs when its three nodes lie inside."""

    @model_validator(mode="after")
    def _check_selection(self) -> "Base":
        self.require_one_of("point", "box")
        if (self.point is None) != (self.normal is None):
            raise ValueError("a plane needs both, point and normal; a box has neither")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal = [0, 0, 0]: has no direction")
        if self.box is not None and any(low > high for low, high in zip(*self.box, strict=True)):
            raise ValueError("the first corner of a box must be below the second in x, y and z")
        return self

    def select(self, nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Whether each triangle belongs, shape (triangle_count,); nodes in [mm].

        Raises:
            ValueError: none does.
        """
        near = NEAR * diagonal(nodes)
        if self.box is not None:
            lower, upper = np.array(self.box)
            inside = np.all((nodes >= lower - near) & (nodes <= upper + near), axis=1)
        else:
            normal = np.array(self.normal, dtype=float)
            inside = np.abs((nodes - np.array(self.point)) @ (normal / np.linalg.norm(normal))) <= near
        chosen: np.ndarray = inside[triangles].all(axis=1)
        if not chosen.any():
            lower, upper = np.round(nodes.min(axis=0), 3).tolist(), np.round(nodes.max(axis=0), 3).tolist()
            where = "in this box" if self.box is not None else "in this plane"
            raise ValueError(f"base: no triangle of the outer surface lies {where}; it spans {lower} to {upper} mm")
        return chosen


@dataclass(frozen=True)
class FittedSizes:
    """How fine the tetrahedra of a certain body are; the attributes are those of `Sizes`."""

    largest: float
    smallest: float
    curvature: int
    elements_across_walls: int = 2


class Sizes(Table):
    """How fine the tetrahedra are."""

    largest: Positive | None = None
    """[mm] edge length far from the cavities; a twelfth of the body's diagonal when it is not given."""
    smallest: Positive | None = None
    """[mm] edge length at the cavities; the largest when it is not given."""
    curvature: Count = 16
    """Edges around a full turn of a curved surface; 0: no finer where it is curved."""
    elements_across_walls: Literal[1, 2] = 2
    """At least: with 2, edges from one side of a wall to the other are cut, which about doubles the nodes."""

    @model_validator(mode="after")
    def _check_order(self) -> "Sizes":
        if self.largest is not None and self.smallest is not None and self.smallest > self.largest:
            raise ValueError(f"smallest = {self.smallest:g}: must be at most largest, {self.largest:g}")
        if self.largest is None and self.smallest is not None:
            raise ValueError(f"smallest = {self.smallest:g}: needs largest beside it")
        return self

    def fitted(self, extent: np.ndarray, volume: float, size: float | None = None) -> FittedSizes:
        """The sizes for a body.

        Args:
            extent: of the body along x, y and z [mm], shape (3,).
            volume: of the silicone [mm^3].
            size: replaces the largest and scales the smallest with it [mm].

        Raises:
            ValueError: a size is larger than the body, or so small that the mesh would not end.
        """
        largest = size or self.largest or preset_sizes(extent)["coarse"]
        if not largest <= extent.max():
            raise ValueError(f"size {largest:g}: is larger than the body; must be at most {extent.max():.4g} mm")
        smallest = largest * (self.smallest / self.largest if self.smallest and self.largest else 1.0)
        # A regular tetrahedron of edge s has the volume s^3 / (6 sqrt 2).
        least = (8.5 * volume / MOST_ELEMENTS) ** (1 / 3)
        if largest < least:
            raise ValueError(f"size {largest:g}: must be at least {least:.2g} mm, or the mesh would not end")
        return FittedSizes(largest, smallest, self.curvature, self.elements_across_walls)


def preset_sizes(extent: np.ndarray) -> dict[str, float]:
    """Largest element size [mm] of each preset, for a body of an extent along x, y and z [mm]."""
    return {name: float(f"{np.linalg.norm(extent) / parts:.3g}") for name, parts in PRESETS.items()}


def checked(table: type[AnyTable], tables: Mapping[str, Any], file: Path) -> AnyTable:
    """The tables of a file, checked.

    Raises:
        MeshError: something in them is not valid; begins with the file.
    """
    try:
        return table.model_validate(dict(tables))
    except ValidationError as error:
        raise MeshError(f"{file}: {first_problem(error, table)}") from error
