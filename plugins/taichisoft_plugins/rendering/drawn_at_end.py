"""What outputs have in common that are drawn from the recording when the run is over."""

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.session.output import Output
from taichisoft_plugins.recording.needed import NeededRecording
from taichisoft_plugins.rendering.render import RenderError

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step.report import StepReport


class DrawnAtEnd(Output):
    """An output that does nothing while the simulation runs, and cannot harm what was computed.

    Attributes:
        what: is drawn; name of the output.
        folder: of the run.
    """

    what = ""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._recording = NeededRecording(folder)
        self._moved = False

    def begin(self, model: "Model", state: "State") -> None:
        """Nothing is drawn yet.

        Raises:
            RecordingNeeded: this run has no recording.
        """
        self._recording.require(self.what)

    def record(self, state: "State", report: "StepReport") -> None:
        """Note that there is something to draw."""
        self._moved = True

    def end(self, outcome: str) -> None:
        """Draw; not after an interruption, where nobody wants to wait, nor when no step was made.

        Raises:
            RenderError: drawing is not possible on this machine, or somebody ended it.
        """
        if outcome == "interrupted" or not self._moved:
            return
        try:
            self.draw(self._recording.path)
        except KeyboardInterrupt:
            # The run itself is complete, and other outputs have to end.
            later = f"`taichisoft render {self._recording.path}` draws later"
            raise RenderError(f"no {self.what}: interrupted; {later}") from None

    @abstractmethod
    def draw(self, recording: Path) -> None:
        """Draw from the complete recording."""
