"""What drives a run: the interface of a controller, what it sees and what it may ask for."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from taichisoft.model import Model


@dataclass(frozen=True)
class Control:
    """What a controller asks for in a step; whatever it does not mention keeps its last value.

    Attributes:
        pressure: [kPa] by cavity name ("finger1.cavity"); a cavity is driven by pressure or by volume.
        volume_growth: [mm^3] over the rest volume, by cavity name; the pressure is then a result.
        base_translation: [mm] of all anchors from their rest positions, shape (3,).
        base_rotation: rotation vector [rad] of all anchors about the scene's base pivot, shape (3,).
    """

    pressure: dict[str, float] = field(default_factory=dict)
    volume_growth: dict[str, float] = field(default_factory=dict)
    base_translation: np.ndarray | None = None
    base_rotation: np.ndarray | None = None


@dataclass(frozen=True)
class Observation:
    """What a controller sees before a step; it depends on the state alone. Arrays are read-only.

    Attributes:
        time: [s] at the start of the step.
        step: index of the step about to be made.
        pressures: [kPa] of the last step, by cavity name.
        volumes: cavity volumes [mm^3] now, by cavity name.
        object_positions: centre of mass [mm] of each rigid body, shape (3,), by name.
        normal_forces: sum of normal contact forces [mN] in the last step, by pair "finger1|cube".
    """

    time: float
    step: int
    pressures: dict[str, float]
    volumes: dict[str, float]
    object_positions: dict[str, np.ndarray]
    normal_forces: dict[str, float]


class Controller(Protocol):
    """Anything with these two methods drives a run."""

    def reset(self, model: "Model") -> None:
        """Called once before the first step."""

    def control(self, observation: Observation) -> Control:
        """Called before every step."""
        ...
