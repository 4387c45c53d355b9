"""The tables that geometry files of bodies from CAD share: their base and the sizes of their elements."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from taichisoft.base import SIZE, likely_unit
from taichisoft.scene import NotNegative, Positive, Table, Vector
from taichisoft_meshing.closed_shells import NEAR, diagonal
from taichisoft_meshing.size_search import element_count, refuse_too_many

Count = Annotated[int, Field(strict=True, ge=0)]

PRESETS = {"coarse": 12.0, "medium": 24.0, "fine": 48.0}
"""Diagonal of the body over the element size [-]; the tutorial's finger has 600, 2000 and 6000 nodes."""


class BasePlane(Table):
    """The triangles of the outer surface in a plane, by which a gripper holds the body."""

    point: Vector
    """A point anywhere in the plane [mm]."""
    normal: Vector
    """Normal of the plane, of any length [-]."""

    @model_validator(mode="after")
    def _check_normal(self) -> "BasePlane":
        if not any(self.normal):
            raise ValueError("normal = [0, 0, 0]: has no direction")
        return self

    def select(self, nodes: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Whether each triangle belongs to the base, shape (triangle_count,); nodes in [mm].

        Raises:
            ValueError: no triangle belongs to it.
        """
        heights = (nodes - np.array(self.point)) @ (np.array(self.normal) / np.linalg.norm(self.normal))
        chosen: np.ndarray = (np.abs(heights) <= NEAR * diagonal(nodes))[triangles].all(axis=1)
        if not chosen.any():
            lower, upper = np.round(nodes.min(axis=0), 3).tolist(), np.round(nodes.max(axis=0), 3).tolist()
            raise ValueError(
                f"base: no triangle of the outer surface lies in this plane; it spans {lower} to {upper} mm"
            )
        return chosen


@dataclass(frozen=True)
class FittedSizes:
    """Sizes of the tetrahedra in a certain body; the attributes of `Sizes`, all of them known."""

    largest: float
    smallest: float
    curvature: int
    elements_across_walls: int = 2


class Sizes(Table):
    """Sizes of the tetrahedra."""

    largest: Positive | None = None
    """Edge length far from the cavities [mm]; a twelfth of the body's diagonal when it is not given."""
    smallest: Positive | None = None
    """Edge length at the cavities [mm]; the largest when it is not given."""
    curvature: Count = 16
    """Number of edges around a full turn of a curved surface; 0: no finer where it is curved."""
    elements_across_walls: Literal[1, 2] = 2
    """Least number of elements; 2 cuts the edges that lead through a wall, which about doubles the nodes."""

    @model_validator(mode="after")
    def _check_sizes(self) -> "Sizes":
        if self.largest is not None and self.smallest is not None and self.smallest > self.largest:
            raise ValueError(f"smallest = {self.smallest:g}: must be at most largest, {self.largest:g}")
        if self.largest is None and self.smallest is not None:
            raise ValueError(f"smallest = {self.smallest:g}: needs largest beside it")
        return self

    def fitted(
        self, extent: np.ndarray, volume: float, size: float | None = None, cavity_volumes: Sequence[float] = ()
    ) -> FittedSizes:
        """The sizes for a body.

        Args:
            extent: edge lengths of the box around the body along x, y and z [mm], shape (3,).
            volume: volume of the silicone [mm^3].
            size: largest size, instead of the table's; scales the smallest with it [mm].
            cavity_volumes: volumes of the cavities, where they are known [mm^3].
        """
        largest = size or self.largest or preset_sizes(extent)["coarse"]
        if not largest <= extent.max():
            meant = likely_unit(extent.max(), SIZE) if extent.max() < SIZE.lowest else ""
            raise ValueError(
                f"size {largest:g}: is larger than the body; must be at most {extent.max():.4g} mm"
                f"{f'; is the body in another unit? {meant}' if meant else ''}"
            )
        smallest = largest * (self.smallest / self.largest if self.smallest and self.largest else 1.0)
        refuse_too_many(element_count(volume, largest, largest), "size", largest)
        refuse_too_many(element_count(volume, largest, smallest, cavity_volumes), "smallest", smallest, power=2)
        return FittedSizes(largest, smallest, self.curvature, self.elements_across_walls)


class SolidSizes(Sizes):
    """Sizes of the tetrahedra in a solid, whose surfaces are known between the nodes, and how they follow them."""

    wall_ratio: NotNegative = 0.0
    """Longest edge in a wall over the wall's thickness [-], so that thin walls get finer elements than the rest, with
    sizes that grow away from them; 0: walls are as coarse as what is around them."""

    order: Literal[1, 2] = 1
    """1: tetrahedra of four nodes; 2: of ten, whose sides follow curved surfaces, for `element = "quadratic"`."""


def preset_sizes(extent: np.ndarray) -> dict[str, float]:
    """Largest element size [mm] of each preset, for a body of an extent along x, y and z [mm]."""
    return {name: float(f"{np.linalg.norm(extent) / parts:.3g}") for name, parts in PRESETS.items()}
