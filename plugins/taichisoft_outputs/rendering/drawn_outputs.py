"""The outputs "pictures" and "video": the key moments and the whole of a run, drawn from its recording at the end."""

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.session import Output
from taichisoft_outputs.drawing.style import FPS, Style, parse_size
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.recording.recording_output import NeededRecording
from taichisoft_outputs.rendering.render import RenderError, key_moments, render_pictures, require_open3d
from taichisoft_outputs.rendering.video import check_slow_motion, frame_progress, render_video
from taichisoft_outputs.rendering.video_file import check_video

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State
    from taichisoft.step import StepReport


class DrawnAtEnd(Output):
    """An output that does nothing while the simulation runs, and cannot harm what was computed.

    Attributes:
        name: name of the output.
        folder: folder of the run, where the recording is.
    """

    name = ""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._recording = NeededRecording(folder)
        self._moved = False

    def begin(self, model: "Model", state: "State") -> None:
        """Check that there will be something to draw from.

        Raises:
            PackageMissing: Open3D is not installed.
            RecordingNeeded: this run has no recording.
        """
        require_open3d()
        self._recording.require(self.name)

    def record(self, state: "State", report: "StepReport") -> None:
        """Note that there is something to draw."""
        self._moved = True

    def end(self, outcome: str) -> None:
        """Draw, unless the run was interrupted or made no step.

        Raises:
            RenderError: drawing is not possible on this machine, or was interrupted.
        """
        if outcome == "interrupted" or not self._moved:
            return
        try:
            self.draw(self._recording.path)
        except KeyboardInterrupt:
            # The run itself is complete, and other outputs have to end.
            later = f"`taichisoft render {self._recording.path}` draws later"
            raise RenderError(f"no {self.name}: interrupted; {later}") from None

    @abstractmethod
    def draw(self, recording: Path) -> None:
        """Draw the complete recording."""


class PicturesOutput(DrawnAtEnd):
    """Draws the key moments of the run into its folder."""

    name = "pictures"

    def draw(self, recording: Path) -> None:
        """Draw the key moments."""
        with read_recording(recording) as opened:
            moments = key_moments(opened)
        render_pictures(recording, moments, self.folder)


class VideoOutput(DrawnAtEnd):
    """Draws the whole run into a video.

    Args:
        folder: folder of the run, where the recording is.
        file: "NAME.mp4", "NAME.gif", or a folder for PNG files; None for video.mp4 in the run's folder.
        fps: frames per second.
        size: width and height [pixels], "1280x720".
        slow_motion: factor by which things move slower than in reality.
        view: where the camera stands, see `Style`.

    Raises:
        RenderError, StyleError: one of these is impossible.
    """

    name = "video"

    def __init__(
        self,
        folder: Path,
        file: Path | None = None,
        fps: float = FPS,
        size: str = "1280x720",
        slow_motion: float = 1.0,
        view: str | None = None,
    ):
        super().__init__(folder)
        self.file = file if file is not None else self.folder / "video.mp4"
        self.fps, self.slow_motion = fps, slow_motion
        self.style = Style(size=parse_size(size), view=view)
        self._frames = 0
        check_video(self.file, fps)
        check_slow_motion(slow_motion)

    def begin(self, model: "Model", state: "State") -> None:
        """Check that there will be something to draw from, and the body to follow.

        Raises:
            RecordingNeeded: this run has no recording.
            StyleError: the view follows a body that is not there.
        """
        super().begin(model, state)
        self.style.check(model.scene)

    def draw(self, recording: Path) -> None:
        """Draw the whole run, with a progress bar."""
        with frame_progress(self.file.name) as show:
            self._frames = render_video(recording, self.file, self.style, self.fps, self.slow_motion, show)

    def summary(self) -> dict[str, str]:
        """Where the video is, and how long."""
        if not self._frames:
            return {}
        return {"video": f"{self.file}, {self._frames} frames, {self._frames / self.fps:.1f} s"}
