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
        place: how far the object may stand from its place in each horizontal direction [mm].
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
        for name, value in dict(told or {}).items():  # type: ignore[arg-type]
            if name not in names:
                raise SceneError(f"randomisation: there is no '{name}'; {nearest(name, names, 'there are')}")
            low, high = (0.0, value) if name == "place" else value
            if not (0.0 <= low <= high and np.isfinite(high)) or (name in ("mass", "modulus") and low == 0.0):
                raise SceneError(f"randomisation['{name}'] = {value!r}: must be a lowest and a highest positive number")
        return cls(**dict(told or {}))  # type: ignore[arg-type]

    def draw(self, random: np.random.Generator) -> dict[str, float]:
        """A value for each range that is given; "place right" and "place front" [mm] for the place."""
        ranges = {"friction": self.friction, "mass": self.mass, "modulus": self.modulus}
        drawn = {name: random.uniform(*between) for name, between in ranges.items() if between is not None}
        if self.place:
            drawn |= {f"place {axis}": random.uniform(-self.place, self.place) for axis in ("right", "front")}
        return drawn
