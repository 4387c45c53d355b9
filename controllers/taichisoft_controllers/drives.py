"""The ways to drive actuators: cavities by pressure, cables by how far they are pulled in or by their tension."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichisoft.control.observation import Observation

if TYPE_CHECKING:
    from taichisoft.model import Model


@dataclass(frozen=True)
class Drive:
    """A way to drive the actuators of one kind.

    Attributes:
        name: what is driven, as keys of scripts and settings call it.
        unit: its unit.
        kind: what the actuators are: "cavity" or "cable".
        rate: key of its rate of change.
        asked: field of a `Control` that asks for it.
        observed: field of an `Observation` that has it.
    """

    name: str
    unit: str
    kind: str
    rate: str
    asked: str
    observed: str

    @property
    def plural(self) -> str:
        """The actuators, more than one."""
        return {"cavity": "cavities", "cable": "cables"}[self.kind]

    def actuators(self, model: "Model") -> tuple[str, ...]:
        """Names of all actuators of the kind."""
        names: tuple[str, ...] = getattr(model, self.plural).names
        return names

    def read(self, observation: Observation, actuator: str) -> float:
        """What an actuator was driven with in the last step, or what came of it."""
        value: Any = getattr(observation, self.observed)[actuator]
        return float(value)


PRESSURE = Drive("pressure", "kPa", "cavity", "pressure_rate", "pressure", "pressures")
PULL = Drive("pull", "mm", "cable", "pull_speed", "cable_pull", "cable_pulls")
TENSION = Drive("tension", "mN", "cable", "tension_rate", "cable_tension", "cable_tensions")
DRIVES = (PRESSURE, PULL, TENSION)
"""All of them; the last two exclude each other for a cable."""
