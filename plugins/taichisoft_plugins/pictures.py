"""The output "pictures": the key moments of a run as PNG files, drawn from its recording at the end."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft_plugins.recording_layout import FILE_NAME
from taichisoft_plugins.recording_reader import Recording, read_recording
from taichisoft_plugins.rendering import RenderError, render_pictures

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.simulation import StepReport
    from taichisoft.state import State


class PicturesOutput:
    """Draws nothing while the simulation runs; the recording stays whatever happens to the pictures."""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._last_time = 0.0

    def begin(self, model: "Model", state: "State") -> None:
        """Nothing is needed yet."""
        self._last_time = state.time

    def record(self, state: "State", report: "StepReport") -> None:
        """Remember how far the recording must reach."""
        self._last_time = state.time

    def end(self, outcome: str) -> None:
        """Draw; not after an interruption, where nobody wants to wait.

        Raises:
            RenderError: this run has no recording, or drawing is not possible on this machine.
        """
        if outcome == "interrupted":
            return
        path = self.folder / FILE_NAME
        if not path.is_file():
            raise RenderError(f"{path}: no recording; the output 'pictures' needs the output 'recording'")
        with read_recording(path) as recording:
            if recording.frame_count == 0 or recording.times[-1] != self._last_time:
                raise RenderError(
                    f"{path}: does not end with this run; the output 'recording' must stand before 'pictures'"
                )
            moments = key_moments(recording)
        render_pictures(path, moments, self.folder)


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
