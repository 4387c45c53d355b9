"""Figures by name for rollouts, derivatives and targets: parts of an observation, such as "object_positions.cube"."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from taichisoft.control.observation import Observation
from taichisoft.errors import TaichisoftError, nearest
from taichisoft.state import State

BY_PAIR = (
    *("contact_counts", "normal_forces", "friction_forces", "slip_speeds"),
    *("contact_areas", "contact_area_errors", "peak_pressures", "peak_pressure_errors"),
)
"""Bodies that are far apart are not in an observation: nothing presses, nothing slides."""
OF_ANY_LENGTH = ("contact_points", "contact_forces", "clipped", "exact")
KNOWN = tuple(one.name for one in fields(Observation) if one.name not in OF_ANY_LENGTH)
OF_STATE = tuple(one.name for one in fields(State) if not one.name.startswith("contact_"))


@dataclass(frozen=True)
class ObservedFigure:
    """A part of an observation.

    Attributes:
        name: as the user wrote it.
        field: field of `Observation`.
        key: entry of that field, a pair of bodies, or a field of `State`; "" for all of it.
    """

    name: str
    field: str
    key: str | tuple[str, str] = ""

    def of(self, observation: Observation) -> np.ndarray:
        """Its present value without sensors; all entries of a field in the order of the scene, shape (count, ...)."""
        observation = observation.truth
        value = getattr(observation, self.field)
        if self.field == "state":
            value = getattr(value, str(self.key))
        elif isinstance(self.key, tuple):
            value = value.get(self.key, 0.0)
        elif self.key:
            value = value[self.key]
        elif isinstance(value, Mapping):
            value = list(value.values())
        return np.asarray(value, dtype=np.float64)


def find_figure(name: str, observation: Observation, bodies: tuple[str, ...]) -> ObservedFigure:
    """The figure that a name means.

    Args:
        name: "base_translation", "tip_positions", "tip_positions.finger1", "normal_forces.finger1|cube",
            "state.position".
        observation: one of the simulation, which shows the names of cavities and so on.
        bodies: names of all bodies in the order of the scene.

    Raises:
        TaichisoftError: there is no such figure, or it has no fixed shape.
    """
    field, _, key = name.partition(".")
    if field in OF_ANY_LENGTH or field not in KNOWN:
        hint = nearest(field, KNOWN, "there are")
        raise TaichisoftError(f"figures: '{name}': not a field of an observation with a fixed shape; {hint}")
    if field in BY_PAIR:
        return ObservedFigure(name, field, _pair(name, key, bodies))
    value = getattr(observation, field)
    valid = OF_STATE if field == "state" else tuple(value) if isinstance(value, Mapping) else ()
    if key not in valid and (key or field == "state"):
        hint = nearest(key, valid, "there are") if valid else f"leave out what follows {field}"
        raise TaichisoftError(f"figures: '{name}': {field} has no '{key}'; {hint}")
    return ObservedFigure(name, field, key)


def _pair(name: str, key: str, bodies: tuple[str, ...]) -> tuple[str, str]:
    """Two bodies in the order of the scene."""
    first, separator, second = key.partition("|")
    for body in (first, second) if separator else ():
        if body not in bodies:
            raise TaichisoftError(
                f"figures: '{name}': no body is called '{body}'; {nearest(body, bodies, 'there are')}"
            )
    if not separator:
        raise TaichisoftError(f"figures: '{name}': name two bodies, as in normal_forces.finger1|cube")
    return (first, second) if bodies.index(first) <= bodies.index(second) else (second, first)
