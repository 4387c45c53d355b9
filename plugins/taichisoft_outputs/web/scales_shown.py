"""What the colours and arrows of a page mean: bars of efforts of actuators, and the force of the longest arrow."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from taichisoft.actuators import kind_called
from taichisoft_outputs.drawing.scales import AIR, LINE, ColourScale, scale_of
from taichisoft_outputs.html_template import render

TEMPLATE = Path(__file__).with_name("scales_shown.html")


class Scales:
    """How far efforts of actuators and contact forces reach so far; scales begin at zero.

    Attributes:
        efforts: colours by value and by kind of actuator; none of a kind as long as all are zero.
        force: the largest contact force [mN].
    """

    def __init__(self) -> None:
        """Begin with zeros alone."""
        self._reach: dict[str, np.ndarray] = {}
        self.efforts: dict[str, ColourScale] = {}
        self.force = 0.0

    def reach_to(self, efforts: Mapping[str, np.ndarray], force: float) -> bool:
        """Widen the scales so that efforts by kind and a force are on them; returns whether one of them is another."""
        before = dict(self.efforts), self.force
        for name, values in efforts.items():
            kind, reach = kind_called(name), _ends(self._reach.get(name, np.zeros(2)), values)
            self._reach[name] = reach
            colours = AIR if kind.drawn == "walls" else LINE
            scale = scale_of(f"{kind.effort.words} [{kind.effort.unit}]", reach, colours)
            if scale is not None:
                self.efforts[name] = scale
        self.force = max(self.force, float(force))
        return before != (self.efforts, self.force)

    def html(self, arrow: Sequence[int]) -> str:
        """The scales for the panel, empty where all are zero; `arrow` is the colour of arrows, 3 numbers up to 255."""
        bars = [
            (scale.title, f"{scale.low:g}", f"{scale.high:g}", [_css(np.multiply(255, step)) for step in scale.steps])
            for scale in self.efforts.values()
        ]
        return render(TEMPLATE, bars=bars, force=f"{self.force:.3g}" if self.force else "", arrow=_css(arrow))


def _ends(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.array([np.min(values, initial=known[0]), np.max(values, initial=known[1])])


def _css(colour: Sequence[float] | np.ndarray) -> str:
    return "#" + "".join(f"{round(float(part)):02x}" for part in colour)
