"""Pictures of a simulation while it goes on, from a child process that stays and can neither hang nor crash it."""

import pickle
import subprocess
import threading
import warnings
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.child_process import PYTHON, how_it_ended
from taichisoft.plugin_system.renderer import Renderer
from taichisoft_plugins.drawing.style import Style, StyleError
from taichisoft_plugins.recording.output import RecordingOutput
from taichisoft_plugins.recording.reader import live_values
from taichisoft_plugins.rendering.frame_process import REFUSED
from taichisoft_plugins.rendering.render import FRAME_LIMIT, START_LIMIT, RenderError
from taichisoft_plugins.system_libraries import install_line, packages_for

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft.state import State

WORKER = ("-m", "taichisoft_plugins.rendering.live_process")


class LiveRenderer(Renderer):
    """Draws what a camera would see: bodies, floor and shadows, without captions, arrows and colour bars.

    A process that crashes or hangs is replaced once in a picture.
    """

    def __init__(self, model: "Model", size: tuple[int, int], camera: str | tuple[tuple[float, ...], ...]):
        """Nothing is started before the first picture.

        Args:
            model: model whose states are drawn.
            size: width and height [pixels].
            camera: a view of `Style`, or the points of eye and target [mm].

        Raises:
            StyleError: the size or the camera is not possible, or follows a body that is not there.
        """
        self._model = model
        self._style = _style(size, camera)
        self._style.check(model.scene)
        self._process: _Process | None = None

    def picture(self, state: "State", marks: np.ndarray) -> np.ndarray:
        """Draw a state with marks at points [mm], shape (height, width, 3), dtype uint8.

        Raises:
            RenderError: drawing failed twice, or cannot succeed; the message says what to install if that could help.
        """
        problem = ""
        for _ in range(2):
            if self._process is None:
                self._process = _Process(self._model, self._style)
            try:
                drawn = self._process.draw(state, marks)
            except BaseException:  # Ctrl and c: the rest of this picture must not be taken for the next one
                self.close()
                raise
            if drawn is not None:
                return drawn
            problem, refused = self._process.end()
            self._process = None
            if refused:
                raise RenderError(problem)
            warnings.warn(f"the renderer stopped: {problem}; another takes its place", stacklevel=2)
        raise RenderError(
            f"no picture: {problem}; off-screen drawing needs Mesa's libraries "
            f"({install_line(packages_for(problem, 'open3d'))}); `taichisoft doctor` checks them"
        )

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.end()
            self._process = None


class _Process:
    """The child process, and a folder with the recording that describes the model to it."""

    def __init__(self, model: "Model", style: Style):
        self._style = style
        self._limit = START_LIMIT + FRAME_LIMIT
        self._log = TemporaryFile()  # noqa: SIM115 - closed in `end`
        self._folder = TemporaryDirectory(prefix="taichisoft-renderer-")
        recording = RecordingOutput(Path(self._folder.name))
        first = model.initial_state()
        recording.begin(model, first)
        recording.end("picture")
        self._child = subprocess.Popen(
            [*PYTHON, *WORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            start_new_session=True,  # Ctrl and c is for whoever simulates
        )
        self._first: tuple[object, ...] = ((str(recording.path), asdict(style)), live_values(first))

    def draw(self, state: "State", marks: np.ndarray) -> np.ndarray | None:
        """The picture of a state with its marks; None where the process has failed or needs too long."""
        assert self._child.stdin is not None and self._child.stdout is not None
        width, height = self._style.size
        watchdog = threading.Timer(self._limit, self._child.kill)
        watchdog.start()
        try:
            for message in (*self._first, live_values(state), marks):
                pickle.dump(message, self._child.stdin, protocol=pickle.HIGHEST_PROTOCOL)
            self._child.stdin.flush()
            drawn = self._child.stdout.read(width * height * 3)
        except OSError:
            return None
        finally:
            watchdog.cancel()
        if len(drawn) < width * height * 3:
            return None
        self._first, self._limit = (), FRAME_LIMIT * max(1.0, width * height / 1e6)
        return np.frombuffer(drawn, np.uint8).reshape(height, width, 3).copy()

    def end(self) -> tuple[str, bool]:
        """End the process: one line that says why it ended by itself, and whether another would fail likewise."""
        assert self._child.stdin is not None and self._child.stdout is not None
        for pipe in (self._child.stdin, self._child.stdout):
            with suppress(OSError):  # what was not written yet cannot be any more
                pipe.close()
        try:
            code = self._child.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            code = self._child.wait()
        self._log.seek(0)
        problem = how_it_ended(code, self._log.read()) or "the process ended"
        self._log.close()
        self._folder.cleanup()
        return problem, code == REFUSED


def _style(size: tuple[int, int], camera: str | tuple[tuple[float, ...], ...]) -> Style:
    signs = ("cavity_pressure", "cable_tension", "arrows", "axes", "body_axes", "caption")
    plain = dict.fromkeys(signs, False)
    if isinstance(camera, str):
        if camera == "orbit":
            raise StyleError("camera 'orbit' needs a whole run; there are: iso, front, top, follow:BODY, two points")
        return Style(size=size, view=camera, **plain)  # type: ignore[arg-type]
    if len(camera) != 2:
        raise StyleError(
            f"camera {camera!r}: must be the name of a view or two points, of the eye and what it looks at"
        )
    return Style(size=size, eye=camera[0], target=camera[1], **plain)  # type: ignore[arg-type]
