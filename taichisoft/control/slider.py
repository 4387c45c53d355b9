"""Numbers that a controller lets its user set at once, where there is something to set them with."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Slider:
    """A number that a controller lets its user set.

    Attributes:
        value: where it stands, also after keys that changed it.
        lowest: from here on.
        highest: up to here.
        step: between two values.
        unit: of all of them, "kPa".
    """

    value: float
    lowest: float
    highest: float
    step: float
    unit: str
