"""A drawing of a finger with the names of its dimensions.

python -m taichisoft_meshing.finger.drawing docs/finger.svg
"""

import sys
from pathlib import Path
from typing import Any

from taichisoft_meshing.finger.parameters import FingerParameters

SILICONE, STIFF, AIR, WALL = "#cfe3ee", "#9fc3d6", "#ffffff", "#a03010"
SCALE = 0.047
"""Inches of paper for a millimetre of the finger."""
ROW = 8.0
"""[mm] of the finger between dimensions above each other."""
GAP = 60.0
"""[mm] From the base to the middle of the cross-section beside it."""


def draw_finger(finger: FingerParameters, path: Path) -> None:
    """Side view, and cross-section through a chamber, to scale, as a small SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    body = finger.body
    left, right = -body.length - 11, GAP + body.width / 2 + 5
    low, high = -3.1 * ROW, body.height + 5.2 * ROW
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 6.5}):
        figure = Figure(figsize=(SCALE * (right - left), SCALE * (high - low)))
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        _side_view(axes, finger)
        _lengths_above(axes, finger)
        _lengths_below(axes, finger)
        _heights(axes, finger)
        _walls(axes, finger)
        _roundings(axes, finger)
        _cross_section(axes, finger)
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})


def _side_view(axes: Any, finger: FingerParameters) -> None:
    slots, channel, chambers, layer = finger.slots, finger.channel, finger.chambers, finger.stiff_layer
    axes.fill(*zip(*finger.outline, strict=True), facecolor=SILICONE, edgecolor="black", linewidth=0.6)
    if layer.thickness:
        _box(axes, -layer.end, layer.bottom, layer.end - layer.start, layer.thickness, STIFF)
    for start in _starts(slots):
        _box(axes, -start - slots.width, 0, slots.width, slots.depth)
    for start in _starts(chambers):
        _box(axes, -start - chambers.width, channel.bottom - chambers.height, chambers.width, chambers.height)
    _box(axes, -channel.end, channel.bottom, channel.end - channel.start, channel.top - channel.bottom)


def _lengths_above(axes: Any, finger: FingerParameters) -> None:
    channel, chambers, layer, top = finger.channel, finger.chambers, finger.stiff_layer, finger.body.height
    starts = _starts(chambers)
    _length(axes, -layer.end, 0, top + 4.4 * ROW, top, "stiff_layer.end", layer.end)
    _length(axes, -channel.end, 0, top + 3.4 * ROW, top, "channel.end", channel.end)
    _length(axes, -layer.start, 0, top + 2.4 * ROW, top, "stiff_layer.start", layer.start)
    _length(axes, -channel.start, 0, top + 1.4 * ROW, top, "channel.start", channel.start)
    _length(axes, -chambers.first, 0, top + 0.4 * ROW, top, "chambers.first", chambers.first)
    if chambers.count > 2:
        _length(axes, -starts[2], -starts[1], top + 0.4 * ROW, top, "chambers.pitch", chambers.pitch)
    last = starts[-1]
    _length(axes, -last - chambers.width, -last, top + 0.4 * ROW, top, "chambers.width", chambers.width)
    middle = -(starts[0] + last + chambers.width) / 2
    axes.text(middle, top + 1.5 * ROW, f"chambers.count = {chambers.count}", ha="center")


def _lengths_below(axes: Any, finger: FingerParameters) -> None:
    body, slots, starts = finger.body, finger.slots, _starts(finger.slots)
    if slots.count:
        _length(axes, -slots.first, 0, -0.8 * ROW, 0, "slots.first", slots.first)
        _length(axes, -starts[-1] - slots.width, -starts[-1], -0.8 * ROW, 0, "slots.width", slots.width)
        axes.text(-starts[0] - slots.width, -1.7 * ROW, f"slots.count = {slots.count}", ha="center")
    if slots.count > 2:
        _length(axes, -starts[2], -starts[1], -0.8 * ROW, 0, "slots.pitch", slots.pitch)
    _length(axes, -body.base_length, 0, -1.8 * ROW, 0, "body.base_length", body.base_length)
    taper = body.length - body.taper_length
    _length(axes, -body.length, -taper, -1.8 * ROW, 0, "body.taper_length", body.taper_length)
    _length(axes, -body.length, 0, -2.8 * ROW, 0, "body.length", body.length)


def _heights(axes: Any, finger: FingerParameters) -> None:
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    low, layer = channel.bottom - chambers.height, finger.stiff_layer
    _height(axes, body.height - body.tip_height, body.height, -body.length - 7, "body.tip_height", body.tip_height)
    _height(axes, 0, channel.bottom, 5, "channel.bottom", channel.bottom)
    _height(axes, 0, channel.top, 12, "channel.top", channel.top)
    _height(axes, 0, layer.bottom, 19, "stiff_layer.bottom", layer.bottom)
    _height(axes, 0, body.height, 26, "body.height", body.height)
    middle = -(layer.start + layer.end) / 2
    _arrow(axes, (middle, layer.bottom), (middle, layer.bottom + layer.thickness))
    axes.text(
        middle + 1, layer.bottom + layer.thickness / 2, f"stiff_layer.thickness = {layer.thickness:g}", va="center"
    )
    if slots.count > 1:
        _height(axes, 0, slots.depth, -_starts(slots)[1] - slots.width / 2, "slots.depth", slots.depth)
    middle = -_starts(chambers)[0] - chambers.width / 2
    _height(axes, low, channel.bottom, middle, "chambers.height", chambers.height)


def _walls(axes: Any, finger: FingerParameters) -> None:
    """Thicknesses that decide the positions above; without numbers, since they follow from these."""
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    starts, low = _starts(chambers), channel.bottom - chambers.height
    style: Any = {"color": WALL, "va": "center"}
    x = -starts[-1] - chambers.width - 6
    _arrow(axes, (x, channel.top), (x, body.height), WALL)
    axes.text(x - 1, (channel.top + body.height) / 2, "walls.back", ha="right", **style)
    x = -starts[chambers.count // 2] - chambers.width / 2
    _arrow(axes, (x, 0), (x, low), WALL)
    axes.text(x - 0.5, low / 2, "walls.floor", ha="right", rotation=90, **style)
    if slots.count:
        x = -_starts(slots)[-1] - slots.width / 2
        _arrow(axes, (x, slots.depth), (x, channel.bottom), WALL)
        axes.annotate(
            "walls.web", (x, channel.bottom), (x - 10, channel.top + 2.2), color=WALL, arrowprops=_leader(WALL)
        )
        side = -starts[0] - chambers.width
        _arrow(axes, (-slots.first, low + 1), (side, low + 1), WALL)
        axes.annotate("walls.slot", (side, low + 1), (side + 6, low - 4), color=WALL, arrowprops=_leader(WALL))


def _roundings(axes: Any, finger: FingerParameters) -> None:
    """Fillets and the inlet, which the tutorial's finger has not."""
    slots, channel, chambers, inlet = finger.slots, finger.channel, finger.chambers, finger.inlet
    corner = (-_starts(chambers)[-1] - chambers.width, channel.bottom - chambers.height)
    text = f"chambers.fillet_radius = {chambers.fillet_radius:g}"
    axes.annotate(text, corner, (-finger.body.length - 9, 3.0), arrowprops=_leader())
    if slots.count > 3:
        corner = (-_starts(slots)[3] - slots.width, slots.depth)
        text = f"slots.fillet_radius = {slots.fillet_radius:g}"
        axes.annotate(text, corner, (corner[0] - 9, -1.7 * ROW), arrowprops=_leader())
    middle = (channel.bottom + channel.top) / 2
    axes.plot([-channel.start, 1.5], [middle, middle], color="black", linewidth=0.4, dashes=(8, 3, 2, 3))
    axes.plot([-inlet.plug, -inlet.plug], [middle - 1, middle + 1], color="black", linewidth=0.8)
    axes.text(-inlet.plug, middle + 1.2, f"inlet.plug = {inlet.plug:g}", ha="center", fontsize=5)
    axes.text(-0.5, middle - 1.2, f"inlet.diameter = {inlet.diameter:g}", ha="right", va="top", fontsize=5)


def _cross_section(axes: Any, finger: FingerParameters) -> None:
    """Seen along the finger, through a chamber."""
    body, channel, chambers, layer = finger.body, finger.channel, finger.chambers, finger.stiff_layer
    low = channel.bottom - chambers.height
    for width, start, height, colour in (
        (body.width, 0, body.height, SILICONE),
        (layer.width, layer.bottom, layer.thickness, STIFF),
        (chambers.depth, low, chambers.height, AIR),
        (channel.width, channel.bottom, channel.top - channel.bottom, AIR),
    ):
        _box(axes, GAP - width / 2, start, width, height, colour)
    for key, width, y, start in (
        ("stiff_layer.width", layer.width, body.height + 1.4 * ROW, layer.bottom + layer.thickness),
        ("channel.width", channel.width, body.height + 0.4 * ROW, channel.top),
        ("chambers.depth", chambers.depth, -0.8 * ROW, low),
        ("body.width", body.width, -1.8 * ROW, 0),
    ):
        _length(axes, GAP - width / 2, GAP + width / 2, y, start, key, width)
    edge = GAP + chambers.depth / 2
    _arrow(axes, (edge, low + 2), (GAP + body.width / 2, low + 2), WALL)
    where = (GAP + body.width / 2 + 2, low + 2)
    axes.text(*where, "wall, or walls.side", color=WALL, rotation=90, va="bottom", ha="center")


def _starts(row: Any) -> list[float]:
    """Distances from the base at which slots or chambers begin [mm]."""
    return [row.first + number * row.pitch for number in range(row.count)]


def _box(axes: Any, x: float, y: float, width: float, height: float, colour: str = AIR) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    axes.fill(*zip(*corners, strict=True), facecolor=colour, edgecolor="black", linewidth=0.6)


def _length(axes: Any, left: float, right: float, y: float, from_y: float, key: str, value: float) -> None:
    """A dimension along the page, at `y`, with thin lines from where it is measured."""
    for x in (left, right):
        axes.plot([x, x], [from_y, y], color="0.6", linewidth=0.3)
    _arrow(axes, (left, y), (right, y))
    axes.text((left + right) / 2, y + 0.5, f"{key} = {value:g}", ha="center", va="bottom")


def _height(axes: Any, low: float, high: float, x: float, key: str, value: float) -> None:
    """A dimension up the page, at `x`."""
    _arrow(axes, (x, low), (x, high))
    axes.text(x + 0.5, (low + high) / 2, f"{key} = {value:g}", ha="left", va="center", rotation=90)


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], colour: str = "black") -> None:
    style = {"arrowstyle": "<->", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 5, "color": colour}
    axes.annotate("", start, end, arrowprops=style)


def _leader(colour: str = "black") -> dict[str, Any]:
    return {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 1, "shrinkB": 0, "color": colour}


if __name__ == "__main__":
    draw_finger(FingerParameters(), Path(sys.argv[1]))
