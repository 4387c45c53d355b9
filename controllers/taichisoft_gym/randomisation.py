"""Randomisation of episodes: friction, masses, stiffness, place of the object."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from taichisoft.errors import SceneError, nearest

Range = tuple[float, float]
Drawn = dict[str, float | str]
"""What was drawn for an episode by name; a text is the name of an object."""
DRAWABLE = ("friction", "mass", "modulus", "place right", "place front", "object")
"""What can be drawn for an episode."""


@dataclass(frozen=True)
class Randomisation:
    """Ranges for uniform draws at every reset; None or 0: the scene's value.

    Attributes:
        friction: lowest and highest coefficient of friction [-].
        mass: lowest and highest mass of the object, relative to the scene's [-].
        modulus: lowest and highest Young's modulus of all soft bodies, relative to the scene's [-].
        place: largest shift of the object in each horizontal direction [mm]; places within another body are drawn
            again.
    """

    friction: Range | None = None
    mass: Range | None = None
    modulus: Range | None = None
    place: float = 0.0

    @classmethod
    def from_mapping(cls, ranges: "Randomisation | Mapping[str, Any] | None") -> Self:
        """Make the ranges from a mapping with the same keys; None: no randomisation.

        Raises:
            SceneError: a key is unknown, or a range is not valid.
        """
        if isinstance(ranges, cls):
            return ranges
        names = [field.name for field in fields(cls)]
        unknown = next((name for name in ranges or () if name not in names), None)  # type: ignore[union-attr]
        if unknown is not None:
            raise SceneError(f"randomisation: there is no '{unknown}'; {nearest(unknown, names, 'there are')}")
        return cls(**dict(ranges or {}))  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            SceneError: a range is not valid.
        """
        for name, range_ in (("friction", self.friction), ("mass", self.mass), ("modulus", self.modulus)):
            if range_ is not None and not _is_range(range_, zero_is_valid=name == "friction"):
                raise SceneError(
                    f"randomisation['{name}'] = {range_!r}: must be a lowest and a highest positive number"
                )
        if not _is_range((0.0, self.place), zero_is_valid=True):
            raise SceneError(f"randomisation['place'] = {self.place!r}: must be a distance [mm], not negative")

    def draw(self, random: np.random.Generator, difficulty: float = 1.0, scene_friction: float = 0.0) -> Drawn:
        """Draw a value for each given range; "place right" and "place front" [mm] for the place.

        Args:
            random: generator.
            difficulty: share of the ranges, counted from the scene's value, that is drawn from [-].
            scene_friction: the scene's coefficient of friction [-].
        """
        ranges = {"friction": self.friction, "mass": self.mass, "modulus": self.modulus}
        drawn: Drawn = {}
        for name, between in ranges.items():
            if between is not None:
                usual = scene_friction if name == "friction" else 1.0
                low, high = ((1.0 - difficulty) * usual + difficulty * end for end in between)
                drawn[name] = random.uniform(low, high)
        return drawn | self.draw_place(random, difficulty)

    def draw_place(self, random: np.random.Generator, difficulty: float = 1.0) -> Drawn:
        """Draw a place of the object; empty if the place is not randomised."""
        if not self.place:
            return {}
        furthest = difficulty * self.place
        return {f"place {axis}": random.uniform(-furthest, furthest) for axis in ("right", "front")}


def _is_range(value: Any, zero_is_valid: bool) -> bool:
    try:
        low, high = map(float, value)
    except (TypeError, ValueError):
        return False
    return bool(0.0 <= low <= high and np.isfinite(high)) and (zero_is_valid or low > 0.0)
