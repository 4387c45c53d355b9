"""Timetables that excite a body: ramps, steps and waves of its actuators, gravity and the motion of its base."""

import math
from collections.abc import Sequence

import numpy as np

from taichisoft_reduction.actuator_ranges import Ranges
from taichisoft_reduction.run_request import Timetable

RISE = 0.8
"""Time of a ramp [s]."""
PAUSE = 0.4
"""Time in which a body settles [s]."""
FREQUENCY = 1.5
"""Of waves [Hz]."""
TURN = math.radians(40.0)
"""How far the base turns."""
AXES = ("x", "y", "z")
FURTHER, HEAVIER = 1.6, 6.0
"""How far actuators, and gravity across, go beyond the training, over what they do in it."""

Channels = dict[str, tuple[float, ...]]


def excitations(ranges: Ranges, gravity: Sequence[float], shift: float) -> dict[str, Timetable]:
    """Timetables of the training by name.

    Args:
        ranges: ranges of the body's actuators.
        gravity: of the scene [mm/s^2], shape (3,).
        shift: how far the base moves [mm].
    """
    found = {}
    if ranges:
        found["ramp"] = ramp(ranges)
        found["step"] = _step(ranges, 0.6)
        found["wave"] = wave(ranges, FREQUENCY)
        if any(low < 0.0 for _, low, _ in ranges.values()):
            found["suction"] = _lowest(ranges)
    if len(ranges) > 1:
        found |= {f"alone-{_plain(name)}": ramp({name: one}) for name, one in ranges.items()}
        found["out-of-step"] = wave(ranges, FREQUENCY, apart=True)
    found |= {f"gravity-{number}": table for number, table in enumerate(_gravities(ranges, gravity))}
    for level in (0.0, 0.6) if ranges else (0.0,):
        found[f"shaken-{level:g}"] = _moved(ranges, level, "base_translation", shift)
        found[f"turned-{level:g}"] = _moved(ranges, level, "base_rotation", TURN)
    return found


def unseen(ranges: Ranges, shift: float) -> dict[str, Timetable]:
    """Timetables of the validation by name: other frequencies, levels and directions than any of the training."""
    found = {}
    if ranges:
        found["unseen-wave"] = wave(ranges, 0.9, level=0.85, apart=len(ranges) > 1)
    times = np.linspace(0.0, 2.0, 81)
    channels = _constant_after_rise(ranges, 0.4, times)
    way = np.sin(2.0 * math.pi * 1.1 * times) * np.minimum(1.0, times / 0.5)
    for axis, share in zip(AXES, (0.5, -0.35, 0.4), strict=True):
        channels[f"base_translation/{axis}"] = tuple((shift * share * way).tolist())
        channels[f"base_rotation/{axis}"] = tuple((TURN * 0.5 * share * way[::-1] * np.minimum(1.0, times)).tolist())
    found["unseen-sway"] = Timetable(tuple(times.tolist()), channels)
    return found


def ramp(ranges: Ranges, level: float = 1.0) -> Timetable:
    """Up to the largest values, and let go."""
    times = (0.0, RISE, RISE + PAUSE / 2, RISE + PAUSE / 2 + 1e-6, RISE + 2 * PAUSE)
    return Timetable(times, _channels(ranges, level, (0.0, 1.0, 1.0, 0.0, 0.0)))


def wave(ranges: Ranges, frequency: float, level: float = 1.0, apart: bool = False) -> Timetable:
    """Waves from 0 to `level` times the largest values; `apart`: each actuator at a frequency of its own."""
    times = np.linspace(0.0, 1.6, 65)
    channels: Channels = {}
    for number, (name, (key, _, high)) in enumerate(ranges.items()):
        own = frequency * (1.0 + 0.37 * number * apart)
        shape = 0.5 * (1.0 - np.cos(2.0 * math.pi * own * times))
        channels[f"{key}/{name}"] = tuple((level * high * shape).tolist())
    return Timetable(tuple(times.tolist()), channels)


def _step(ranges: Ranges, level: float) -> Timetable:
    return Timetable((0.0, 2.0 * PAUSE), _channels(ranges, level, (1.0, 1.0)))


def _lowest(ranges: Ranges) -> Timetable:
    lows = {name: (key, 0.0, low) for name, (key, low, _) in ranges.items() if low < 0.0}
    return Timetable((0.0, RISE, RISE + PAUSE), _channels(lows, 1.0, (0.0, 1.0, 1.0)))


def beyond(ranges: Ranges, gravity: Sequence[float]) -> dict[str, Timetable]:
    """Timetables far beyond those of the training, by which its errors there are estimated."""
    found = {"beyond-ramp": ramp(ranges, FURTHER)} if ranges else {}
    heavy = _gravities(ranges, [HEAVIER * one for one in gravity])
    return found | {f"beyond-gravity-{number}": table for number, table in enumerate(heavy) if number in (1, 3)}


def _gravities(ranges: Ranges, gravity: Sequence[float]) -> list[Timetable]:
    """Ramps under gravity in the other directions."""
    own = np.array(gravity)
    strength = float(np.linalg.norm(own))
    if strength == 0.0:
        return []
    first = np.cross(own, np.roll(np.eye(3)[np.argmax(np.abs(own))], 1))
    first *= strength / np.linalg.norm(first)
    second = np.cross(own, first) / strength
    times = (0.0, RISE, RISE + PAUSE)
    found = []
    for direction in (-own, first, -first, second, -second):
        fixed: Channels = {f"gravity/{axis}": (one,) * 3 for axis, one in zip(AXES, direction.tolist(), strict=True)}
        found.append(Timetable(times, {**_channels(ranges, 0.8, (0.0, 1.0, 1.0)), **fixed}))
    return found


def _moved(ranges: Ranges, level: float, key: str, size: float) -> Timetable:
    """The base goes along, or turns about, each axis and comes back, one after the other."""
    times = np.linspace(0.0, PAUSE + 3 * 0.6, 89)
    channels = _constant_after_rise(ranges, level, times)
    for number, axis in enumerate(AXES):
        phase = np.clip((times - PAUSE - 0.6 * number) / 0.6, 0.0, 1.0)
        channels[f"{key}/{axis}"] = tuple((size * np.sin(2.0 * math.pi * phase)).tolist())
    return Timetable(tuple(times.tolist()), channels)


def _constant_after_rise(ranges: Ranges, level: float, times: np.ndarray) -> Channels:
    return _channels(ranges, level, tuple(np.minimum(1.0, times / PAUSE).tolist()))


def _channels(ranges: Ranges, level: float, shape: Sequence[float]) -> Channels:
    """The actuators' channels: the shape times their largest values."""
    return {f"{key}/{name}": tuple(level * high * one for one in shape) for name, (key, _, high) in ranges.items()}


def _plain(name: str) -> str:
    return name.partition(".")[2]
