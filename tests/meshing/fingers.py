"""Fingers for the tests: from tables, from files, and of all kinds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st

from taichisoft.errors import MeshError
from taichisoft_meshing.finger_dimensions import FingerParameters
from taichisoft_meshing.geometry_file import read_tables
from taichisoft_meshing.pneunet_finger import PneunetFinger


def finger_from_dict(tables: Mapping[str, Any], source: str = "finger") -> FingerParameters:
    """The finger that tables describe; `source` begins errors."""
    return PneunetFinger(tables, Path(source)).table


def refusal(tables: Mapping[str, Any]) -> str:
    """The one line about what is wrong in the tables of a finger, without its file."""
    with pytest.raises(MeshError) as refused:
        finger_from_dict(tables, source="finger.toml")
    message = str(refused.value)
    assert message.startswith("finger.toml: ")
    assert "\n" not in message
    return message.removeprefix("finger.toml: ")


def read_finger(path: Path, size: float | None = None) -> FingerParameters:
    """The finger that a file describes, with largest elements of `size` [mm]."""
    return PneunetFinger(read_tables(path)[1], path).sized(size)


def lengths(low: float, high: float) -> st.SearchStrategy[float]:
    """Lengths [mm] as a user would write them, with at most two decimals."""
    return st.integers(round(100 * low), round(100 * high)).map(lambda hundredths: hundredths / 100)


@st.composite
def sharp_fingers(draw: st.DrawFn) -> dict[str, Any]:
    """Valid tables of a finger without fillets and inlet, built up from its walls, at a coarse size."""
    count = draw(st.integers(1, 5))
    chamber, wall, slot = draw(lengths(2, 8)), draw(lengths(0.8, 4)), draw(lengths(0.8, 4))
    start, tip = draw(lengths(6, 25)), draw(lengths(4, 20))
    pitch = chamber + 2 * wall + slot
    end = start + (count - 1) * pitch + chamber
    floor, chamber_height = draw(lengths(2, 10)), draw(lengths(4, 15))
    channel_height, back = draw(lengths(1.5, 5)), draw(lengths(2, 10))
    bottom = floor + chamber_height
    top = bottom + channel_height
    depth, side = draw(lengths(5, 20)), draw(lengths(0.8, 5))
    channel_width = draw(st.sampled_from([depth, round(0.6 * depth, 2)]))
    thinnest = min(wall, side, floor, back)
    size = draw(lengths(2.5, 5)) * thinnest
    slots = draw(st.sampled_from([0, count - 1]))
    return {
        "body": {
            "length": end + tip,
            "height": top + back,
            "width": depth + 2 * side,
            "tip_height": draw(lengths(2, top)),
            "taper_length": draw(lengths(1, tip)),
            "base_length": start / 2,
        },
        "slots": {
            "count": slots,
            "width": slot,
            "depth": bottom - draw(lengths(0.8, chamber_height)),
            "pitch": pitch,
            "first": start + chamber + wall,
        },
        "channel": {"start": start, "end": end, "bottom": bottom, "top": top, "width": channel_width},
        "chambers": {
            "count": count,
            "width": chamber,
            "pitch": pitch,
            "first": start,
            "height": chamber_height,
            "depth": depth,
        },
        "stiff_layer": {"thickness": 0.0},
        "mesh": {"largest": min(size * draw(lengths(1, 3)), end + tip), "smallest": min(size, end + tip)},
    }
