"""The output "pictures": the key moments of a run as PNG files, drawn from its recording at the end."""

from pathlib import Path

import numpy as np

from taichisoft_plugins.recording.reader import Recording, read_recording
from taichisoft_plugins.rendering.drawn_at_end import DrawnAtEnd
from taichisoft_plugins.rendering.render import render_pictures


class PicturesOutput(DrawnAtEnd):
    """Draws nothing while the simulation runs; the recording stays whatever happens to the pictures."""

    what = "pictures"

    def draw(self, recording: Path) -> None:
        """Draw the key moments."""
        with read_recording(recording) as opened:
            moments = key_moments(opened)
        render_pictures(recording, moments, self.folder)


def key_moments(recording: Recording) -> dict[str, float]:
    """Times [s] of the pictures of a run: before, grasped (the last moment before the base rises), lifted.

    Where the base does not move there is only before and after.
    """
    times = recording.times[recording.last_start :]
    base = recording.column("base_translation")[recording.last_start :]
    moved = np.any(base != base[0], axis=1)
    if not moved.any():
        return {"before": float(times[0]), "after": float(times[-1])}
    grasped = max(int(np.argmax(moved)) - 1, 0)
    return {"before": float(times[0]), "grasped": float(times[grasped]), "lifted": float(times[-1])}
