"""The outputs "pictures" and "video": the key moments and the whole of a run, drawn from its recording at the end."""

import os
import queue
import sys
import threading
from abc import abstractmethod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from taichisoft.base import warn_caller
from taichisoft.running import Output
from taichisoft_outputs.drawing.style import FPS, Style, parse_size
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.recording.recording_output import NeededRecording
from taichisoft_outputs.rendering.video import (
    RenderError,
    check_slow_motion,
    check_video,
    key_moments,
    picture_progress,
    record_state,
    render_pictures,
    render_video,
    require_open3d,
)

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.running import Session
    from taichisoft.step import StepReport

# Pictures taken by a key during a run, drawn from the present state in other processes.

MOST_WAITING = 8
"""Most pictures that may wait: a held key repeats, and does not mean hundreds of pictures."""

_takers: dict[int, "PictureTaker"] = {}


def take_picture(session: "Session") -> None:
    """Have the present state drawn into the run's folder, as `picture_1_at_2.50s.png` and so on; returns at once."""
    if session.folder is None:
        warn_caller("no picture: this run has no folder to put it in")
        return
    taker = _takers.setdefault(id(session), PictureTaker(session.folder))
    taker.take(session.simulation.model, session.simulation.state)


def finish_pictures(session: "Session") -> None:
    """Wait for the pictures of a session that are not done."""
    taker = _takers.pop(id(session), None)
    if taker is not None:
        taker.finish()


class PictureTaker:
    """Draws one picture after the other in a thread and child processes; what goes wrong is a warning."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._count = 0
        self._jobs: queue.SimpleQueue[tuple[str, Model, State] | None] = queue.SimpleQueue()
        # Not to be waited for by an interpreter that ends: `finish` does that, and an impatient user may stop it.
        self._thread = threading.Thread(target=self._work, name="pictures", daemon=True)

    def take(self, model: "Model", state: "State") -> None:
        """Have a state drawn; never waits. A state does not change, so there is nothing to copy."""
        if self._jobs.qsize() >= MOST_WAITING:
            warn_caller(f"no picture at {state.time:.2f} s: {MOST_WAITING} others are not drawn yet")
            return
        if not self._thread.is_alive():
            self._thread.start()
        self._count += 1
        self._jobs.put((f"picture_{self._count}_at_{state.time:.2f}s", model, state))

    def finish(self) -> None:
        """Wait until all are drawn."""
        self._jobs.put(None)
        self._thread.join()

    def _work(self) -> None:
        if sys.platform == "linux":
            os.nice(10)  # there of this thread and the children it starts: the run comes first
        while (job := self._jobs.get()) is not None:
            name, model, state = job
            try:
                self._draw(name, model, state)
            except Exception as error:  # no caller of a thread could report it
                warn_caller(f"no picture {self._folder / name}.png: {error}")

    def _draw(self, name: str, model: "Model", state: "State") -> None:
        """Draw a state from a recording of a single instant, since the drawing process reads recordings."""
        with TemporaryDirectory(prefix="taichisoft-picture-") as folder:
            render_pictures(record_state(Path(folder), model, state), {name: state.time}, self._folder)


class DrawnAtEnd(Output):
    """An output that does nothing while the simulation runs, and cannot harm what was computed.

    Attributes:
        folder: folder of the run, where the recording is.
    """

    name = ""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._recording = NeededRecording(folder)
        self._moved = False

    def begin(self, model: "Model", state: "State") -> None:
        """Check that there will be something to draw from."""
        require_open3d()
        self._recording.require(self.name)

    def record(self, state: "State", report: "StepReport") -> None:
        """Note that there is something to draw."""
        self._moved = True

    def end(self, outcome: str) -> None:
        """Draw, unless the run was interrupted or made no step."""
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
        file: "NAME.mp4", "NAME.gif", or a folder for PNG files; None for video.mp4 in the run's folder.
        fps: frames per second.
        size: width and height [pixels], "1280x720".
        slow_motion: factor by which things move slower than in reality.
        view: where the camera stands, see `Style`.
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
        self._count = 0
        check_video(self.file, fps)
        check_slow_motion(slow_motion)

    def begin(self, model: "Model", state: "State") -> None:
        """Check that there will be something to draw from, and the body to follow."""
        super().begin(model, state)
        self.style.check(model.scene)

    def draw(self, recording: Path) -> None:
        """Draw the whole run, with a progress bar."""
        with picture_progress(self.file.name) as show:
            self._count = render_video(recording, self.file, self.style, self.fps, self.slow_motion, show)

    def summary(self) -> dict[str, str]:
        """Where the video is, and how long."""
        if not self._count:
            return {}
        return {"video": f"{self.file}, {self._count} pictures, {self._count / self.fps:.1f} s"}
