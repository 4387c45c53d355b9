"""Names of actuators by their kind, and where each kind stands in arrays over all actuators."""

from collections.abc import Mapping, Sequence

import numpy as np

from taichisoft.actuators.kind import ActuatorKind, Drive


class ActuatorNames:
    """The actuators of a model or of a recording by name, in the order of the kinds.

    Attributes:
        names: all names, "body.actuator".
    """

    def __init__(self, by_kind: Mapping[str, Sequence[str]]):
        """Take the names by the name of the kind, in the order of the kinds; a kind that is missing has none."""
        self.names = tuple(name for names in by_kind.values() for name in names)
        self._place: dict[str, slice] = {}
        first = 0
        for kind, names in by_kind.items():
            self._place[kind] = slice(first, first + len(names))
            first += len(names)

    def place(self, kind: ActuatorKind) -> slice:
        """Where the actuators of a kind stand among all."""
        return self._place.get(kind.name, slice(0, 0))

    def names_of(self, kind: ActuatorKind) -> tuple[str, ...]:
        """The names of a kind's actuators."""
        return self.names[self.place(kind)]

    def driven_by(self, kind: ActuatorKind, drive: Drive) -> tuple[str, ...]:
        """The names of a kind's actuators that can be driven so, as far as names tell: all, by effort or coordinate."""
        return self.names_of(kind) if drive in (kind.effort, kind.coordinate) else ()

    def of(self, kind: ActuatorKind, values: np.ndarray) -> np.ndarray:
        """The part of a kind in values of all actuators, such as `State.actuator_effort`, (..., actuator_count)."""
        return values[..., self.place(kind)]
