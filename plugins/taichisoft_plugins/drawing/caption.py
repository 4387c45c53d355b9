"""The caption of a frame: time, pressures, and how far the rigid bodies have risen."""

from typing import Any

import numpy as np

from taichisoft_plugins.drawing.painting import SMALLEST, Colour, font, write
from taichisoft_plugins.recording.reader import Recording

SINGLE_PRESSURES = 4
"""More are written as a range."""
BODIES = 3
"""So many rigid bodies are written."""


def caption_parts(recording: Recording, frame: int) -> list[str]:
    """What the caption says; pressures only where and when there are any."""
    parts = [f"{recording.times[frame]:.2f} s"]
    if recording.cavities:
        pressures = recording.row("pressure", frame)
        if not np.isnan(pressures).all():
            parts.append(_pressures(pressures))
    start = recording.row("rigid_position", recording.last_start if frame >= recording.last_start else 0)
    rises = (recording.row("rigid_position", frame) - start) @ recording.scene.up
    for name, rise in list(zip(recording.scene.rigid_bodies, rises, strict=True))[:BODIES]:
        # Less than half of the last digit is not "-0.0".
        parts.append(f"{name} raised {round(float(rise), 1) + 0.0:.1f} mm")
    return parts


def paint_caption(picture: Any, parts: list[str], ink: Colour) -> None:
    """Write the parts into the upper left corner of a Pillow image, in as few lines as they fit."""
    height = picture.height
    letters, edge = height / 32, 0.03 * height
    lines: list[str] = []
    for part in parts:
        longer = f"{lines[-1]}     {part}" if lines else part
        if lines and font(letters).getlength(longer) <= picture.width - 2 * edge:
            lines[-1] = longer
        else:
            lines.append(part)
    for number, line in enumerate(lines):
        write(picture, (edge, edge + number * 1.4 * max(letters, SMALLEST)), line, letters, ink, "la")


def _pressures(values: np.ndarray) -> str:
    texts = [f"{round(float(value), 1) + 0.0:.1f}" for value in values]
    if len(set(texts)) == 1:
        return f"pressure {texts[0]} kPa"
    if len(texts) <= SINGLE_PRESSURES:
        return f"pressures {', '.join(texts)} kPa"
    return f"pressures from {np.nanmin(values):.1f} to {np.nanmax(values):.1f} kPa"
