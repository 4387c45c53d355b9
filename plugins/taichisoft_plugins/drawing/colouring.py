"""The colours of the surfaces of a recording in its frames, before light falls on them."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.embedding import embed
from taichisoft_plugins.drawing import node_values
from taichisoft_plugins.drawing.scales import AIR, SOFT, ColourScale, round_up, sample_frames
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import RecordedSoftBody, RecordedSurface, Recording

PLAIN = {
    "soft": (0.96, 0.93, 0.88),
    "cavity": (0.10, 0.52, 0.55),
    "rigid": (0.16, 0.33, 0.72),
    "obstacle": (0.62, 0.65, 0.69),
}
"""Red, green and blue [-] by the kind of surface."""

QUANTITIES = {
    "displacement": (node_values.displacement, "displacement [mm]"),
    "stress": (node_values.stress, "stress [kPa]"),
}
SAMPLES = 40
"""Number of frames, at most, in which the range of a quantity is looked for."""
COVERED_SHARE = 0.995
"""Part of the values that the range covers: single elements at an edge would make all others look alike."""


class Colouring:
    """Gives every surface its colours.

    Args:
        recording: The recording, which stays open.
        style: What the user chose.
        frames: All frames that will be drawn.
        surfaces: All surfaces that will be drawn.

    Attributes:
        scales: What the colours mean.

    Raises:
        RecordingError: What colours shall mean was not recorded.
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int], surfaces: Sequence[RecordedSurface]):
        self._recording = recording
        self._bodies: dict[str, tuple[RecordedSoftBody, np.ndarray, np.ndarray]] = {}
        self._scale: ColourScale | None = None
        if style.colour_by in QUANTITIES:
            quantity, title = QUANTITIES[style.colour_by]
            self._values = quantity(recording)
            self._scale = ColourScale(title, 0.0, self._highest(frames), SOFT)
            self._bodies = _embedded(recording, surfaces)
        seen = style.cavity_pressure and style.opacity < 1.0
        self._pressure_scale = _pressure_scale(recording, frames) if seen else None
        self.scales = tuple(scale for scale in (self._scale, self._pressure_scale) if scale is not None)

    def colours(self, surface: RecordedSurface, frame: int) -> np.ndarray:
        """Red, green and blue [-] of a surface, shape (3,), or of each of its vertices, shape (vertex_count, 3)."""
        if surface.kind == "soft" and self._scale is not None:
            body, nodes, weights = self._bodies[surface.name]
            values = np.einsum("vk,vk->v", weights, self._values(body, frame)[nodes])
            return self._scale.colours(values)
        if surface.kind == "cavity" and self._pressure_scale is not None:
            pressure = self._recording.row("pressure", frame)[self._recording.cavities.index(surface.name)]
            # Before the first step no pressure is known.
            return self._pressure_scale.colours(np.nan_to_num([pressure]))[0]
        return np.array(PLAIN[surface.kind])

    def _highest(self, frames: Sequence[int]) -> float:
        """The high end of the range of the quantity in the frames."""
        samples = sample_frames(frames, SAMPLES)
        values = [self._values(body, frame) for body in self._recording.soft_bodies for frame in samples]
        highest = max((float(np.quantile(some, COVERED_SHARE)) for some in values), default=0.0)
        return round_up(highest) if highest > 0 else 1.0


def _embedded(
    recording: Recording, surfaces: Sequence[RecordedSurface]
) -> dict[str, tuple[RecordedSoftBody, np.ndarray, np.ndarray]]:
    """By name, each soft body with the nodes and the weights of its surface's vertices, each (vertex_count, 4)."""
    vertices = {surface.name: surface.vertices(0) for surface in surfaces if surface.kind == "soft"}
    position = recording.row("position", 0)
    return {
        body.name: (body, *embed(vertices[body.name], position[body.nodes], body.elements))
        for body in recording.soft_bodies
    }


def _pressure_scale(recording: Recording, frames: Sequence[int]) -> ColourScale | None:
    """The scale of the pressures; None where there is no cavity, or no pressure but zero."""
    if not recording.cavities:
        return None
    pressures = recording.column("pressure")[np.unique(frames)]
    lowest, highest = np.nanmin(pressures, initial=0.0), np.nanmax(pressures, initial=0.0)
    if highest == lowest:
        return None
    ends = [round_up(abs(end)) * np.sign(end) if end else 0.0 for end in (lowest, highest)]
    return ColourScale("pressure [kPa]", float(ends[0]), float(ends[1]), AIR)
