"""What the colours and arrows of a page mean: bars of pressure and tension, and the force of the longest arrow."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.drawing.scales import AIR, LINE, ColourScale, scale_of


class Scales:
    """How far pressures, tensions and forces reach so far; scales begin at zero.

    Attributes:
        pressure, tension: colours by value; None as long as all are zero.
        force: the largest contact force [mN].
    """

    def __init__(self) -> None:
        """Begin with zeros alone."""
        self._pressures, self._tensions = np.zeros(2), np.zeros(2)
        self.pressure: ColourScale | None = None
        self.tension: ColourScale | None = None
        self.force = 0.0

    def reach_to(self, pressures: np.ndarray, tensions: np.ndarray, force: float) -> bool:
        """Widen the scales so that these are on them; returns whether one of them is another now."""
        before = self.pressure, self.tension, self.force
        self._pressures, self._tensions = _ends(self._pressures, pressures), _ends(self._tensions, tensions)
        self.pressure = scale_of("pressure [kPa]", self._pressures, AIR)
        self.tension = scale_of("tension [mN]", self._tensions, LINE)
        self.force = max(self.force, float(force))
        return before != (self.pressure, self.tension, self.force)

    def html(self, arrows: tuple[int, int, int]) -> str:
        """The scales for the panel; `arrows` is the colour of arrows, red, green and blue from 0 to 255."""
        parts = [_bar(scale) for scale in (self.pressure, self.tension) if scale is not None]
        if self.force > 0.0:
            arrow = f'<span style="color:{_css(np.array(arrows) / 255)}">&#10230;</span>'
            parts.append(f"<div>{arrow} contact forces: longest arrow {self.force:.3g} mN</div>")
        return (
            f'<div style="box-sizing:border-box;width:100%;padding:0 0.9em;font-size:0.85em">{"".join(parts)}</div>'
            if parts
            else ""
        )


def _ends(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.array([np.min(values, initial=known[0]), np.max(values, initial=known[1])])


def _bar(scale: ColourScale) -> str:
    """The title, and the colours between the values of the two ends."""
    colours = ",".join(map(_css, scale.steps))
    bar = f'<span style="flex:1;height:0.8em;margin:0 0.5em;background:linear-gradient(to right,{colours})"></span>'
    row = f'<div style="display:flex;align-items:center">{scale.low:g}{bar}{scale.high:g}</div>'
    return f'<div style="margin-bottom:0.4em"><div>{scale.title}</div>{row}</div>'


def _css(colour: Sequence[float] | np.ndarray) -> str:
    return "#" + "".join(f"{round(255 * float(part)):02x}" for part in colour)
