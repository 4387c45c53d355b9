"""Draws docs/finger.svg: the tutorial's finger with the names of its dimensions; a test compares the texts.

python docs/draw_finger.py
"""

from operator import attrgetter
from pathlib import Path
from typing import Any

from taichisoft_meshing.finger_dimensions import FingerParameters, end, starts
from taichisoft_meshing.pneunet_finger import chamber_boxes, channel_box, slot_boxes, stiff_layer_box

SILICONE, STIFF, AIR, WALL = "#cfe3ee", "#9fc3d6", "#ffffff", "#a03010"
SCALE = 0.047
"""Inches of paper for a millimetre of the finger."""
ROW = 8.0
"""Distance between dimensions above each other, in the scale of the finger [mm]."""
GAP = 60.0
"""Distance from the base to the middle of the cross-section beside it, in the scale of the finger [mm]."""


def draw_finger(finger: FingerParameters, path: Path) -> None:
    """Draw a side view, and a cross-section through a chamber, to scale, as a small SVG."""
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
        for part in (_side_view, _lengths_above, _lengths_below, _heights, _walls, _roundings, _cross_section):
            part(axes, finger)
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})


def _side_view(axes: Any, finger: FingerParameters) -> None:
    axes.fill(*zip(*finger.outline, strict=True), facecolor=SILICONE, edgecolor="black", linewidth=0.6)
    layer = stiff_layer_box(finger)
    if layer is not None:
        _rectangle(axes, *layer.corner[:2], *layer.size[:2], STIFF)
    for box in (*slot_boxes(finger), *chamber_boxes(finger), channel_box(finger)):
        _rectangle(axes, *box.corner[:2], *box.size[:2], AIR)


def _lengths_above(axes: Any, finger: FingerParameters) -> None:
    channel, chambers, layer, top = finger.channel, finger.chambers, finger.stiff_layer, finger.body.height
    begin, last = starts(chambers), end(chambers)
    for left, right, row, key in (
        (layer.end, 0, 4.4, "stiff_layer.end"),
        (channel.end, 0, 3.4, "channel.end"),
        (layer.start, 0, 2.4, "stiff_layer.start"),
        (channel.start, 0, 1.4, "channel.start"),
        (chambers.first, 0, 0.4, "chambers.first"),
        *([(begin[2], begin[1], 0.4, "chambers.pitch")] if chambers.count > 2 else []),
        (last, begin[-1], 0.4, "chambers.width"),
    ):
        _length(axes, -left, -right, top + row * ROW, top, _named(finger, key))
    axes.text(-(begin[0] + last) / 2, top + 1.5 * ROW, _named(finger, "chambers.count"), ha="center")


def _lengths_below(axes: Any, finger: FingerParameters) -> None:
    body, slots, begin = finger.body, finger.slots, starts(finger.slots)
    if slots.count:
        axes.text(-begin[0] - slots.width, -1.7 * ROW, _named(finger, "slots.count"), ha="center")
    for left, right, row, key in (
        *([(slots.first, 0, 0.8, "slots.first")] if slots.count else []),
        *([(end(slots), begin[-1], 0.8, "slots.width")] if slots.count else []),
        *([(begin[2], begin[1], 0.8, "slots.pitch")] if slots.count > 2 else []),
        (body.base_length, 0, 1.8, "body.base_length"),
        (body.length, body.length - body.taper_length, 1.8, "body.taper_length"),
        (body.length, 0, 2.8, "body.length"),
    ):
        _length(axes, -left, -right, -row * ROW, 0, _named(finger, key))


def _heights(axes: Any, finger: FingerParameters) -> None:
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    layer, low = finger.stiff_layer, finger.channel.bottom - finger.chambers.height
    for bottom, top, x, key in (
        (body.height - body.tip_height, body.height, -body.length - 7, "body.tip_height"),
        (0, channel.bottom, 5, "channel.bottom"),
        (0, channel.top, 12, "channel.top"),
        (0, layer.bottom, 19, "stiff_layer.bottom"),
        (0, body.height, 26, "body.height"),
        *([(0, slots.depth, -starts(slots)[1] - slots.width / 2, "slots.depth")] if slots.count > 1 else []),
        (low, channel.bottom, -chambers.first - chambers.width / 2, "chambers.height"),
    ):
        _arrow(axes, (x, bottom), (x, top))
        axes.text(x + 0.5, (bottom + top) / 2, _named(finger, key), ha="left", va="center", rotation=90)
    middle, bottom, top = -(layer.start + layer.end) / 2, layer.bottom, layer.bottom + layer.thickness
    _arrow(axes, (middle, bottom), (middle, top))
    axes.text(middle + 1, (bottom + top) / 2, _named(finger, "stiff_layer.thickness"), va="center")


def _walls(axes: Any, finger: FingerParameters) -> None:
    """Draw thicknesses that decide the positions above; without numbers, since they follow from these."""
    body, slots, channel, chambers = finger.body, finger.slots, finger.channel, finger.chambers
    low, style = channel.bottom - chambers.height, {"color": WALL, "va": "center", "ha": "right"}
    x = -end(chambers) - 6
    _arrow(axes, (x, channel.top), (x, body.height), WALL)
    axes.text(x - 1, (channel.top + body.height) / 2, "walls.back", **style)
    x = -starts(chambers)[chambers.count // 2] - chambers.width / 2
    _arrow(axes, (x, 0), (x, low), WALL)
    axes.text(x - 0.5, low / 2, "walls.floor", rotation=90, **style)
    if slots.count:
        x, side = -starts(slots)[-1] - slots.width / 2, -chambers.first - chambers.width
        _arrow(axes, (x, slots.depth), (x, channel.bottom), WALL)
        _note(axes, "walls.web", (x, channel.bottom), (x - 10, channel.top + 2.2), WALL)
        _arrow(axes, (-slots.first, low + 1), (side, low + 1), WALL)
        _note(axes, "walls.slot", (side, low + 1), (side + 6, low - 4), WALL)


def _roundings(axes: Any, finger: FingerParameters) -> None:
    """Draw fillets and the inlet, which the tutorial's finger has not."""
    slots, channel, chambers, inlet = finger.slots, finger.channel, finger.chambers, finger.inlet
    corner = (-end(chambers), channel.bottom - chambers.height)
    _note(axes, _named(finger, "chambers.fillet_radius"), corner, (-finger.body.length - 9, 3.0))
    if slots.count > 3:
        corner = (-starts(slots)[3] - slots.width, slots.depth)
        _note(axes, _named(finger, "slots.fillet_radius"), corner, (corner[0] - 9, -1.7 * ROW))
    middle = (channel.bottom + channel.top) / 2
    axes.plot([-channel.start, 1.5], [middle, middle], color="black", linewidth=0.4, dashes=(8, 3, 2, 3))
    axes.plot([-inlet.plug, -inlet.plug], [middle - 1, middle + 1], color="black", linewidth=0.8)
    axes.text(-inlet.plug, middle + 1.2, _named(finger, "inlet.plug"), ha="center", fontsize=5)
    axes.text(-0.5, middle - 1.2, _named(finger, "inlet.diameter"), ha="right", va="top", fontsize=5)


def _cross_section(axes: Any, finger: FingerParameters) -> None:
    """Draw the finger as seen along it, cut through a chamber."""
    body, channel, chambers, layer = finger.body, finger.channel, finger.chambers, finger.stiff_layer
    top, low = body.height, channel.bottom - chambers.height
    parts = (
        (0, body.height, SILICONE, -1.8 * ROW, 0, "body.width"),
        (layer.bottom, layer.thickness, STIFF, top + 1.4 * ROW, layer.bottom + layer.thickness, "stiff_layer.width"),
        (low, chambers.height, AIR, -0.8 * ROW, low, "chambers.depth"),
        (channel.bottom, channel.top - channel.bottom, AIR, top + 0.4 * ROW, channel.top, "channel.width"),
    )
    for bottom, height, colour, *_, key in parts:
        width = attrgetter(key)(finger)
        _rectangle(axes, GAP - width / 2, bottom, width, height, colour)
    for *_, y, from_y, key in parts:
        width = attrgetter(key)(finger)
        _length(axes, GAP - width / 2, GAP + width / 2, y, from_y, _named(finger, key))
    side = GAP + body.width / 2
    _arrow(axes, (GAP + chambers.depth / 2, low + 2), (side, low + 2), WALL)
    axes.text(side + 2, low + 2, "wall, or walls.side", color=WALL, rotation=90, va="bottom", ha="center")


def _named(finger: FingerParameters, key: str) -> str:
    """The text of a dimension, for example "body.width = 20"."""
    return f"{key} = {attrgetter(key)(finger):g}"


def _rectangle(axes: Any, x: float, y: float, width: float, height: float, colour: str) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    axes.fill(*zip(*corners, strict=True), facecolor=colour, edgecolor="black", linewidth=0.6)


def _length(axes: Any, left: float, right: float, y: float, from_y: float, text: str) -> None:
    """Draw a dimension along the page at `y`, with thin lines that rise from what it measures at `from_y`."""
    for x in (left, right):
        axes.plot([x, x], [from_y, y], color="0.6", linewidth=0.3)
    _arrow(axes, (left, y), (right, y))
    axes.text((left + right) / 2, y + 0.5, text, ha="center", va="bottom")


def _arrow(axes: Any, start: tuple[float, float], stop: tuple[float, float], colour: str = "black") -> None:
    style = {"arrowstyle": "<->", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 5, "color": colour}
    axes.annotate("", start, stop, arrowprops=style)


def _note(axes: Any, text: str, corner: tuple[float, float], place: tuple[float, float], colour: str = "black") -> None:
    """Write a text at a place, with a thin line to the corner of which it speaks."""
    line = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 1, "shrinkB": 0, "color": colour}
    axes.annotate(text, corner, place, color=colour, arrowprops=line)


if __name__ == "__main__":
    draw_finger(FingerParameters(), Path(__file__).with_name("finger.svg"))
