"""The output "video": the whole run as a video, drawn from its recording at the end."""

from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft_plugins.drawing.style import Style, StyleError
from taichisoft_plugins.drawing.style_options import parse_size
from taichisoft_plugins.rendering.drawn_at_end import DrawnAtEnd
from taichisoft_plugins.rendering.progress import frame_progress
from taichisoft_plugins.rendering.video import FPS, check_slow_motion, render_video
from taichisoft_plugins.rendering.video_file import check_video

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State


class VideoOutput(DrawnAtEnd):
    """Draws nothing while the simulation runs; the recording stays whatever happens to the video.

    Args:
        folder: of the run, where the recording is.
        file: "NAME.mp4", "NAME.gif", or a folder for PNG files; None for video.mp4 in the run's folder.
        fps: frames per second.
        size: width and height, "1280x720".
        slow_motion: how many times slower than in reality things move.
        view: where the camera stands, see `Style`.

    Raises:
        RenderError, StyleError: one of these is impossible.
    """

    what = "video"

    def __init__(
        self,
        folder: Path,
        file: Path | None = None,
        fps: float = FPS,
        size: str = "1280x720",
        slow_motion: float = 1.0,
        view: str = "iso",
    ):
        super().__init__(folder)
        self.file = file if file is not None else self.folder / "video.mp4"
        self.fps, self.slow_motion = fps, slow_motion
        self.style = Style(size=parse_size(size), view=view)
        self._frames = 0
        check_video(self.file, fps)
        check_slow_motion(slow_motion)

    def begin(self, model: "Model", state: "State") -> None:
        """Nothing is drawn yet.

        Raises:
            RecordingNeeded: this run has no recording.
            StyleError: the view follows a body that is not there.
        """
        super().begin(model, state)
        names = [*(body.name for body in model.soft_bodies), *(body.name for body in model.rigid_bodies)]
        if self.style.followed is not None and self.style.followed not in names:
            raise StyleError(
                f"view '{self.style.view}': no body is called '{self.style.followed}'; there are: {', '.join(names)}"
            )

    def draw(self, recording: Path) -> None:
        """Draw the whole run, with a progress bar."""
        with frame_progress(self.file.name) as show:
            self._frames = render_video(recording, self.file, self.style, self.fps, self.slow_motion, show)

    def summary(self) -> dict[str, str]:
        """How long the video is."""
        if not self._frames:
            return {}
        return {"video": f"{self.file}, {self._frames} frames, {self._frames / self.fps:.1f} s"}
