"""What outputs have in common that are drawn from the recording when the run is over."""

from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft_plugins.recording_layout import FILE_NAME
from taichisoft_plugins.rendering import RenderError

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.simulation import StepReport
    from taichisoft.state import State


class DrawnAtEnd:
    """An output that does nothing while the simulation runs, and cannot harm what was computed.

    Attributes:
        needs_recording: see `recording_needed`.
        what: is drawn, for messages.
    """

    needs_recording = True
    what = ""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._moved = False

    def begin(self, model: "Model", state: "State") -> None:
        """Nothing is needed yet."""

    def record(self, state: "State", report: "StepReport") -> None:
        """Note that there is something to draw."""
        self._moved = True

    def end(self, outcome: str) -> None:
        """Draw; not after an interruption, where nobody wants to wait, nor when no step was made.

        Raises:
            RenderError: this run has no recording, drawing is not possible on this machine, or somebody ended it.
        """
        if outcome == "interrupted" or not self._moved:
            return
        path = self.folder / FILE_NAME
        if not path.is_file():
            raise RenderError(f"{path}: no recording; the output '{self.what}' needs the output 'recording'")
        try:
            self.draw(path)
        except KeyboardInterrupt:
            # The run itself is complete, and other outputs have to end.
            raise RenderError(f"no {self.what}: interrupted; `taichisoft render {path}` draws them") from None

    def draw(self, recording: Path) -> None:
        """Draw from the complete recording."""
        raise NotImplementedError
