"""What differs from episode to episode: friction, masses, stiffness, the object's place."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from taichisoft.errors import SceneError, nearest

Range = tuple[float, float]


@dataclass(frozen=True)
class Randomisation:
    """Ranges from which every reset draws, uniformly; what is None or 0 stays as the scene says.

    Attributes:
        friction: lowest and highest coefficient of friction [-].
        mass: lowest and highest mass of the object, in parts of the scene's [-].
        modulus: lowest and highest Young's modulus of all soft bodies together, in parts of the scene's [-].
        place: how far the object may stand from its place in each horizontal direction [mm]; places within another
            body are drawn again.
    """

    friction: Range | None = None
    mass: Range | None = None
    modulus: Range | None = None
    place: float = 0.0

    @classmethod
    def of(cls, told: "Randomisation | Mapping[str, Any] | None") -> Self:
        """Ranges from a mapping with the same keys.

        Raises:
            SceneError: a key is unknown, or a range is not one.
        """
        if isinstance(told, cls):
            return told
        names = [field.name for field in fields(cls)]
        unknown = next((name for name in told or () if name not in names), None)  # type: ignore[union-attr]
        if unknown is not None:
            raise SceneError(f"randomisation: there is no '{unknown}'; {nearest(unknown, names, 'there are')}")
        return cls(**dict(told or {}))  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            SceneError: one is none.
        """
        for name, range_ in (("friction", self.friction), ("mass", self.mass), ("modulus", self.modulus)):
            if range_ is not None and not _is_range(range_, zero_is_valid=name == "friction"):
                raise SceneError(
                    f"randomisation['{name}'] = {range_!r}: must be a lowest and a highest positive number"
                )
        if not _is_range((0.0, self.place), zero_is_valid=True):
            raise SceneError(f"randomisation['place'] = {self.place!r}: must be a distance [mm], not negative")

    def draw(self, random: np.random.Generator) -> dict[str, float]:
        """A value for each range that is given; "place right" and "place front" [mm] for the place."""
        ranges = {"friction": self.friction, "mass": self.mass, "modulus": self.modulus}
        drawn = {name: random.uniform(*between) for name, between in ranges.items() if between is not None}
        return drawn | self.draw_place(random)

    def draw_place(self, random: np.random.Generator) -> dict[str, float]:
        """A place of the object; nothing where it stays in its own."""
        if not self.place:
            return {}
        return {f"place {axis}": random.uniform(-self.place, self.place) for axis in ("right", "front")}


def _is_range(value: Any, zero_is_valid: bool) -> bool:
    try:
        low, high = map(float, value)
    except (TypeError, ValueError):
        return False
    return bool(0.0 <= low <= high and np.isfinite(high)) and (zero_is_valid or low > 0.0)
