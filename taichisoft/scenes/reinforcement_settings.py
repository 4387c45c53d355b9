"""Membranes and fibres of a soft body as a user describes them: thin things that resist stretch, but not bending."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from taichisoft.scenes.table import KeySets, Positive, Table, Vector

Count = Annotated[int, Field(strict=True, ge=1, le=1000)]

MOST_PIECES = 100_000
"""Straight pieces of a helix's fibres in all: far more than windings have, and some seconds to lay out."""


class MembraneSettings(Table):
    """A thin sheet on or in a soft body, such as paper or a woven fabric: it resists stretch, and bends freely."""

    group: str
    """Name of the mesh's surface group that it covers."""
    thickness: Positive
    """Its thickness [mm]."""
    young_modulus: Positive
    """Young's modulus [kPa]; paper has some 3e6."""
    poisson_ratio: Annotated[float, Field(strict=True, ge=0.0, lt=1.0, allow_inf_nan=False)] = 0.0
    """Poisson's ratio within the sheet [-]."""
    directions: Annotated[list[Vector], Field(max_length=2)] = []
    """Directions of its threads, one or two, in the mesh's own axes; it resists stretch along them alone, each with
    thickness and young_modulus. Without any it resists in all directions."""

    tension_only: Annotated[bool, Field(strict=True)] = False
    """Whether it wrinkles where it would be compressed, and carries nothing there, as paper and fabric that nothing
    keeps flat; otherwise it resists compression as it resists tension, as in silicone that keeps it from buckling."""

    @model_validator(mode="after")
    def _check_directions(self) -> Self:
        if any(not any(one) for one in self.directions):
            raise ValueError("directions has one without length")
        if len(self.directions) == 2 and not np.cross(*np.array(self.directions)).any():
            raise ValueError("directions has two along one line; threads of twice the thickness are one direction")
        if self.directions and self.poisson_ratio:
            raise ValueError("poisson_ratio is that of a sheet without directions; remove one of them")
        return self


class Helix(Table):
    """Fibres wound around an axis."""

    start: Vector
    """A point of the axis, where the fibres begin, in the mesh's own coordinates [mm]."""
    end: Vector
    """The point of the axis where they end [mm]."""
    radius: Positive
    """Distance of the fibres from the axis [mm]."""
    angle: Annotated[float, Field(strict=True, gt=0.0, lt=90.0)]
    """Angle between the fibres and the axis [degrees]; a cylinder with both hands of 54.7 keeps its shape under
    pressure, a smaller angle shortens it, a larger one makes it longer."""
    hand: Literal["right", "left", "both"] = "both"
    """Sense of the winding; fibres of one hand twist the body."""
    count: Count = 1
    """Fibres of each hand, evenly around the axis."""
    spacing: Positive | None = None
    """Length of the straight pieces [mm], at least six a turn; a third of the radius when it is not given."""

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if self.start == self.end:
            raise ValueError("start and end are the same point; they give the axis")
        longest = self.radius / np.sin(np.radians(self.angle))
        if self.spacing is not None and self.spacing > longest:
            raise ValueError(
                f"spacing = {self.spacing:g} must be at most {longest:.4g} mm, six pieces a turn: longer ones leave "
                "the helix"
            )
        pieces = self._pieces() * self.count * (2 if self.hand == "both" else 1)
        if pieces > MOST_PIECES:
            raise ValueError(f"asks for {pieces:.0f} straight pieces, at most {MOST_PIECES}; give a longer spacing")
        return self

    def _pieces(self) -> float:
        """Straight pieces of each fibre, a whole number."""
        wound = np.linalg.norm(np.subtract(self.end, self.start)) / np.cos(np.radians(self.angle))
        return float(np.ceil(wound / (self.spacing or self.radius / 3.0)))

    def lines(self) -> list[np.ndarray]:
        """The points of each fibre in the mesh's own coordinates [mm], each of shape (point_count, 3)."""
        start = np.array(self.start)
        along = np.array(self.end) - start
        length = float(np.linalg.norm(along))
        along /= length
        aside = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        aside /= np.linalg.norm(aside)
        across = np.cross(along, aside)
        share = np.linspace(0.0, 1.0, int(self._pieces()) + 1)[:, None]
        turn = share * length * np.tan(np.radians(self.angle)) / self.radius
        found = []
        for sense in {"right": [1.0], "left": [-1.0], "both": [1.0, -1.0]}[self.hand]:
            for first in 2.0 * np.pi * np.arange(self.count) / self.count:
                angle = first + sense * turn
                ring = np.cos(angle) * aside + np.sin(angle) * across
                found.append(start + share * length * along + self.radius * ring)
        return found


class FibreSettings(Table):
    """Fibres that are glued to a soft body along lines: they resist stretch, and bend freely."""

    points: Annotated[list[Vector], Field(min_length=2)] | None = None
    """Points of a line in the mesh's own coordinates [mm]."""
    helix: Helix | None = None
    """Lines around an axis."""
    diameter: Positive
    """Diameter of a fibre [mm]."""
    young_modulus: Positive
    """Young's modulus [kPa]; aramid has 1e8."""
    alternatives: ClassVar[KeySets] = (("points", "helix"),)

    def lines(self) -> list[np.ndarray]:
        """The points of each line in the mesh's own coordinates [mm], each of shape (point_count, 3)."""
        return [np.array(self.points)] if self.helix is None else self.helix.lines()
